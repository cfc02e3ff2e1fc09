"""Solvers of ours, a folder each or a family."""
