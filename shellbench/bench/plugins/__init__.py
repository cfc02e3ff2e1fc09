"""Solvers and kinds of problem from entry points; those of other packages run in a child process.

This package may import the protocol, and nothing else of the bench.
"""
