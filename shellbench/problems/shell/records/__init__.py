"""What records keep of a solution: history, states of a path, series, samples; and how a shell is drawn.

It may import `shellbench.problems.shell.solution` and all that is below it.
"""
