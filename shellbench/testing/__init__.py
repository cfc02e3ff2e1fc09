"""Checks of a solver against the protocol, for `shellbench check-solver`."""
