"""Stated results: values that somebody typed or another program wrote, compared with known values.

They become records that say so (`shellbench.bench.store.record.Stated`). No gate takes them. This package may import
all other packages of the bench; no other package of the bench imports it.
"""
