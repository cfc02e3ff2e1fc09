"""A shell assembled of its parts, and checks that its question is well posed: supports, and values without a limit.

It may import the parts of the question, meshes and quantities; `shellbench.problems.shell.case` builds on it.
"""
