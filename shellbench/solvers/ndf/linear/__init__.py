"""The linear shell at rest: the solve for the output layer, and the solution.

The package contains levels of ever more features, challengers that estimate the uncertainty, and contact. It also
declines the cases that a field can't represent. It may import `field` and `strains`.
"""
