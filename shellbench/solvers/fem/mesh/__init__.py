"""Meshes of the parametric rectangle: their lines, the C1 basis, Gauss rules, and limits of values on finer ones.

Nothing here knows a shell's mechanics. It may import no other room of `fem`.
"""
