"""Suites, known values, tolerances and templates by name, and the description of one case, suite or solver.

This package may import the package of plug-ins. It does not use records.
"""
