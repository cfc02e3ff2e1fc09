"""Vector fields over the unit square."""
