"""Quantities of shells, from displacements to modes, and their measurement.

It may import the parts of the question and the protocol of fields, but no solution.
"""
