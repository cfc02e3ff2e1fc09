"""Judging records by known values: rows, classes, gates, the lock, the baseline, comparisons, boards and exams.

It may import all other rooms of the bench; nothing of the bench imports it.
"""
