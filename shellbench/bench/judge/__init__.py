"""Judgement of records by known values: rows, classes, gates, lock, baseline, comparisons, boards and exams.

This package may import all other packages of the bench; no other package of the bench imports it.
"""
