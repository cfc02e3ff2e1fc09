"""Choices that fields are made by, as settings and files name them; nothing here needs more than their names."""

from __future__ import annotations

from typing import Literal

PeriodicInput = Literal["both", "cosine", "none"]
"""How a periodic coordinate enters: as (cos, sin), as cos alone, or as it is (Kairanda et al., figure II)."""
Components = Literal["cartesian", "covariant"]
Supports = Literal["hard", "soft"]
"""Whether boundary factors hold the supports exactly, or springs about."""
Slopes = Literal["even", "rows"]
"""How a slope is held where components are free that tilt the normal: by inputs that are even at the edge, so that
nothing has a slope there, or by rows of the output layer: u,n . a3 = 0, and nothing else."""
Pins = Literal["points", "cells", "none"]
"""How a shell that nothing holds is kept from drifting by the published boundary functions: by pins at points, as
printed; by pins as wide as a cell of the published grid, which samples see; or not, as its energy does not ask for
it."""
StrainName = Literal["exact", "published", "linear"]

LAYER = 1.2  # l in sqrt(h R) around a force; .12 R for R / h = 100, the best by certified energy on pinched cylinders
# Of {1, t1, t2, r^2, t1 t2, t1^2}. A tangential displacement follows the normal one as its integral, hence t1 and t2:
# without them the certified energy of a pinched cylinder is 5e-4 short, with them 4e-5; the others gain nothing.
MULTIPLIERS = 3
LARGEST_GAP = 5e-4  # of the energy on the two rules: converged fields show 3e-5 and less, exploited rules 1e-2 and more
