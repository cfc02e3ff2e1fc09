"""The data of a report: tables of runs, formats of numbers, evidence, and sections and figures as data.

This package may import the bench, and no other package of the report.

It may import the bench, and no other room of the report.
"""
