"""Matrices of a mesh in blocks and by cells, their factorisation by nested dissection, direct solves, and eigenvalues.

It does not know the meaning of the numbers. It may import `mesh`.
"""
