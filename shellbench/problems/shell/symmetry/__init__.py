"""The part of a shell that has to be solved, given its mirrors.

It may import the case, its variants and everything below them, but no solution.
"""
