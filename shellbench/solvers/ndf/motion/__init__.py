"""A field in motion: Newton's law for the output layer, integrated in time.

It may import `path` and the packages below it.
"""
