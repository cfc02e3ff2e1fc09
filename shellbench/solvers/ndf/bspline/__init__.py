"""A grid of B-splines in the place of the network, for comparison: `bspline-ritz`.

It may import `linear` and the rooms below it.
"""
