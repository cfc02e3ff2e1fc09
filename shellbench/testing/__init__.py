"""Whether a solver keeps the protocol: what `shellbench check-solver` asks of it."""
