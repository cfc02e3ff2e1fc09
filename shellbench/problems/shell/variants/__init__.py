"""The same question asked otherwise: elsewhere, in other units, in other coordinates, or edited.

It may import the case and what is below it, and no solution.
"""
