"""Samples: a solution on a grid of points of a surface, for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SEAM = 1e-6  # largest gap at a seam that is closed, in largest displacements: far above rounding, too small to see


@dataclass(frozen=True)
class Sample:
    """A solution on a regular grid of n x n points of a surface.

    Attributes
    ----------
    xi
        (n, n, 2) curvilinear coordinates, angles in radians.
    position, displacement
        (n, n, 3) of the reference midsurface, metres.
    fields
        Other fields by name, (n, n) or (n, n, k).
    title
        Its origin in one line.
    periodic
        For each coordinate, True if the reference surface is closed.
    at
        Mark of the state, such as a time in s; None for the last.
    components
        Names of an array's components, by its name.
    scalar
        Name of the field for the initial colours of viewers; none if empty.
    """

    xi: Array
    position: Array
    displacement: Array
    fields: dict[str, Array]
    title: str
    periodic: tuple[bool, bool] = (False, False)
    at: float | None = None
    components: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    scalar: str = ""

    @cached_property
    def closed(self) -> tuple[bool, bool]:
        """For each coordinate, True if surface and displacement are both closed."""
        u = self.displacement
        bound = SEAM * float(np.abs(u).max())
        gaps = (u[-1] - u[0], u[:, -1] - u[:, 0])
        first, second = (p and float(np.abs(gap).max()) <= bound for p, gap in zip(self.periodic, gaps, strict=True))
        return first, second

    @property
    def point_data(self) -> dict[str, Array]:
        """All arrays (n, n, ...) except the position, by name."""
        return {"displacement": self.displacement, "xi": self.xi, **self.fields}

    def vertices(self, values: Array) -> Array:
        """Return values (n, n, ...) at the vertices of the mesh (m, ...): a closed seam has one side only."""
        kept = values[: -1 if self.closed[0] else None, : -1 if self.closed[1] else None]
        return kept.reshape(-1, *values.shape[2:])

    def deformed(self, scale: float) -> Array:
        """Return the positions (n, n, 3) after a displacement times `scale`."""
        return np.asarray(self.position + scale * self.displacement)
