"""A grid of B-splines instead of the network, for comparison: `bspline-ritz`.

It may import `linear` and the packages below it.
"""
