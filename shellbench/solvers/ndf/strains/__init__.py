"""Strains of a field, and the energy and the forces that they make.

Linear ones are tables of quadrature, those of any size are sampled. It may import `field`.
"""
