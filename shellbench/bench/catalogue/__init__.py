"""Suites, known values, tolerances and templates by name, and the description of one case, suite or solver.

It may import the room of plug-ins, and knows no record.
"""
