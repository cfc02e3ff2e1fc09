"""One field for all materials of a range: `ndf-conditioned`.

It may import `motion` and the packages below it.
"""
