"""Figures of the report: panels of curves, shells, films and traces.

It may import the report's data.
"""
