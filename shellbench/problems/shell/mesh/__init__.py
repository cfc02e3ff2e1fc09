"""Surfaces from meshes: read a file, check that it is one rectangle, fit a spline, and state the spline's error.

It may import the parts of the question: a mesh becomes a midsurface.
"""
