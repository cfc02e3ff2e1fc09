"""Strains and stiffness of a shell on one mesh, its loads and supports, and the field that is found.

Where a support is applied: `constraints`, and `clamping` for rotations. It may import `mesh` and `algebra`.
"""
