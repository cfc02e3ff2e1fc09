"""Derivatives of the finite element answer with respect to parameters of the case, by the adjoint.

It may import `linear`, `path`, and everything below them.
"""
