"""Thin shells by the theory of Kirchhoff and Love."""
