"""Fields on grids and networks, trained or solved for; samplers; distances by vertices."""
