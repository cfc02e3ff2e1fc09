"""Surfaces from meshes: read a file, check that it is one rectangle, fit a spline, say how far that may be off.

It may import the parts of the question: a mesh becomes a midsurface.
"""
