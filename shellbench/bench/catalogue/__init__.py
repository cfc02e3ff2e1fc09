"""What there is: suites, known values, tolerances and templates, and all about one case, suite or solver.

It may import the room of plug-ins, and knows no record.
"""
