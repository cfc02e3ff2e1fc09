"""A garment's mesh from few bones: clips of a simulated cape, some of them held out."""
