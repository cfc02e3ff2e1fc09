"""Chains as multiple pendulums: angles as unknowns, so that no link can stretch."""
