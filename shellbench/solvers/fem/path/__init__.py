"""Finite strain on one mesh: Newton's method, the path of equilibrium from rest, and the way through buckling.

It may import `linear` and the rooms below it.
"""
