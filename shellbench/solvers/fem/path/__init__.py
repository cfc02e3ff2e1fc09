"""Finite strain on one mesh: Newton's method, the path of equilibrium from rest, and its continuation through buckling.

It may import `linear` and the packages below it.
"""
