"""The parts of a question: midsurface, places, directions, supports, loads, path and obstacles.

It may import formulas and obstacles of `shellbench.problems`, and no other package of shells.
"""
