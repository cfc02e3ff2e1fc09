"""Solvers and kinds of problem as entry points name them; those of other packages are asked in a child process.

It may import the protocol, and nothing else of the bench.
"""
