"""Records: what a run leaves, how it is measured and kept, and whether it still counts.

It may import the catalogue and what is below it. It starts no run and judges none.
"""
