"""Strains of a field, with their energy and forces.

Linear strains are tabulated on a quadrature; finite strains are evaluated at sample points. It may import `field`.
"""
