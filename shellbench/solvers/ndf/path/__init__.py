"""Finite strain: the output layer follows the path of equilibrium from rest.

Through buckling and against obstacles, too; and small vibrations about a state. It may import `linear` and the rooms
below it.
"""
