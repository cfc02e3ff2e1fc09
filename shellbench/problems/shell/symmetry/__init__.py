"""The part of a shell that its mirrors leave to be solved.

It may import the case, its variants and what is below them, and no solution.
"""
