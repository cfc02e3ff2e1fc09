"""A case on a mesh of nodes, as programs with shell elements of their own read it.

`grid` makes the mesh, `nodal` what holds and loads its nodes, `deck` both together. `solver` is the base of solvers on
such programs: it asks for the nodes' displacements on ever finer meshes. It may import cases, symmetry and solutions.
"""
