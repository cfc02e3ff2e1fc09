"""Step control of equilibrium paths, written once for all solvers: halving and growing steps, marks, limit points.

A package below the solvers. It uses a state's load factor, its stability and its number of iterations, and calls the
solver for everything else. It has no mechanics: strains, forces, tangents and Newton's method are the solvers' own. It
may import the standard library and nothing else.
"""
