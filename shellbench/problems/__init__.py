"""Kinds of problem that solvers can be given."""
