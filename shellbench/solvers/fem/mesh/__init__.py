"""Meshes of the parametric rectangle: their lines, the C1 basis, Gauss rules, and limits of values on finer ones.

The package contains no mechanics of shells. It may import no other package of `fem`.
"""
