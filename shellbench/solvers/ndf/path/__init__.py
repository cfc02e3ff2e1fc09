"""Finite strain: the path of equilibrium of the output layer from rest.

The package also covers buckling, obstacles, and small vibrations about a state. It may import `linear` and the packages
below it.
"""
