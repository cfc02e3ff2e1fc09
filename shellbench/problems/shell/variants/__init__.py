"""Variants of a case: at another place, in other units, in other coordinates, or edited.

It may import the case and everything below it, but no solution.
"""
