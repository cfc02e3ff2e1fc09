"""A field in motion: the output layer obeys Newton's law, integrated in time.

It may import `path` and the rooms below it.
"""
