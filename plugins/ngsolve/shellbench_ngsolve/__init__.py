"""Curved high-order shell elements of NGSolve answer the cases."""
