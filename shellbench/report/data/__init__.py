"""What a report is made of: runs as tables, numbers as they are printed, evidence, sections and figures as data.

It may import the bench, and no other room of the report.
"""
