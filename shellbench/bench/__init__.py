"""Runs, records, comparisons and gates. This package knows no solver by name.

`run` makes records, `store` keeps them, and `judge` compares them with known values: a `judge.row.Row` is made of a
record in `judge.compare`. `catalogue` holds suites and known values by name; `plugins` finds solvers and kinds.
"""
