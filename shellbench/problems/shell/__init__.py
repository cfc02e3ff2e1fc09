"""Thin shells by the theory of Kirchhoff and Love.

`case` reads a case file from the parts in `question`. `quantities` are the values that a case asks for, and `field` is
the protocol of answers. `posed` refuses ill-posed cases, `variants` restates a case in other coordinates or units, and
`records` keeps solutions.
"""
