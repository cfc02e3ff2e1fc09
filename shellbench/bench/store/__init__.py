"""Records: their content, their measurement and storage, and their validity.

This package may import the catalogue and the packages below it. It starts no run and judges none.
"""
