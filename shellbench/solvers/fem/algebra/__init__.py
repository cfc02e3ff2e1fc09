"""Matrices of a mesh in blocks and by cells, their factorisation by nested dissection, direct solves, and eigenvalues.

What the numbers mean is not known here. It may import `mesh`.
"""
