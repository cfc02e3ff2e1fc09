"""One shell, asked many times: for a range of materials (kind `conditioned`), and before and after an edit (`editing`).

Both kinds hold a shell as a table of their file, make cases of kind `shell` of it, and keep one value an answer. They
may import `problems.shell` and what all kinds stand on, and no solver.
"""
