"""Training of all weights by certified energy: `ndf`.

It may import `motion` and the packages below it.
"""
