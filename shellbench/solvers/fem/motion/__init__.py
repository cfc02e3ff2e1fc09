"""A shell in motion: steps of the generalised-alpha method, obstacles and friction during one, and the field in time.

It may import `path` and the packages below it.
"""
