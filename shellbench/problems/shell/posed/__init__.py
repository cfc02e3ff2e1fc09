"""A shell put together of its parts, and whether its question is well posed: what holds it, and has no limit.

It may import the parts of the question, meshes and quantities; `shellbench.problems.shell.case` stands on it.
"""
