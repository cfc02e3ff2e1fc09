"""Thin shells by the theory of Kirchhoff and Love.

`case` reads a case file from the parts in `question`. `quantities` are what a case asks for, `field` is what answers.
`posed` refuses questions that have no answer, `variants` asks the same one otherwise, `records` keeps solutions.
"""
