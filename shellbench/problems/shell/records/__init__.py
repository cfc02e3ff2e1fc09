"""Records of a solution: history, states of a path, series, samples; and the pictures of a shell.

It may import `shellbench.problems.shell.solution` and everything below it.
"""
