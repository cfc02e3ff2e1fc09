"""Sections on what solvers answer and what it costs, whatever the problem.

They may import data and figures of the report, and no page.
"""
