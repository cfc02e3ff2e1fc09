"""A solver for shellbench: rectangular, simply supported plates by a double sine series."""
