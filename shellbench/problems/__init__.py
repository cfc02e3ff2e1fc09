"""Kinds of problem: what is asked of solvers."""
