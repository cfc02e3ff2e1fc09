"""One shell, solved many times: for a range of materials (kind `conditioned`), or before and after an edit (`editing`).

Both kinds hold a shell as a table of their file, make cases of kind `shell` of it, and keep one value an answer. They
may import `problems.shell` and the modules shared by all kinds, but no solver.
"""
