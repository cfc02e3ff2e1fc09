"""Chains as many pendulums: angles, and equations of motion that no link can stretch."""
