"""A structured mesh of quadrilaterals on a rectangle of the surface's coordinates, its nodes on the midsurface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))  # of a cell, in Kratos' order: the normal is then along a1 x a2
FEWEST_AROUND = 3  # cells around a closed coordinate: with fewer, quadrilaterals would share two sides
ON_NODE = 1e-9  # of a cell's side, by which a point may lie beside a node


@dataclass(frozen=True)
class QuadMesh:
    """Nodes and quadrilaterals.

    Attributes
    ----------
    lower, upper
        Bounds of (xi1, xi2).
    closed
        Whether each coordinate closes on itself: its last nodes are then its first.
    cells
        Along xi1 and xi2.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    closed: tuple[bool, bool]
    cells: tuple[int, int]

    @property
    def counts(self) -> tuple[int, int]:
        """Nodes along xi1 and xi2."""
        first, second = (n if turns else n + 1 for n, turns in zip(self.cells, self.closed, strict=True))
        return first, second

    @property
    def node_count(self) -> int:
        """Number of nodes v."""
        return self.counts[0] * self.counts[1]

    @property
    def steps(self) -> Array:
        """(2,) sides of a cell."""
        return np.subtract(self.upper, self.lower) / self.cells

    @cached_property
    def nodes(self) -> Array:
        """(v, 2) coordinates of the nodes; xi2 runs fastest."""
        first, second = (
            low + step * np.arange(n) for low, step, n in zip(self.lower, self.steps, self.counts, strict=True)
        )
        return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def quads(self) -> Integers:
        """(e, 4) nodes of each quadrilateral; those of one xi1 follow each other."""
        i, j = (a.ravel() for a in np.indices(self.cells))
        return np.stack([self._number(i + di, j + dj) for di, dj in CORNERS], axis=-1)

    def _number(self, i: Integers, j: Integers) -> Integers:
        n1, n2 = self.counts
        return (i % n1) * n2 + j % n2

    def edge(self, axis: int, last: bool) -> Integers:
        """Return the nodes at the lower or upper bound of a coordinate, in order."""
        running = np.arange(self.counts[1 - axis])
        fixed = np.full_like(running, self.counts[axis] - 1 if last else 0)
        return self._number(fixed, running) if axis == 0 else self._number(running, fixed)

    def node_at(self, xi: ArrayLike) -> int | None:
        """Return the node at a point (2,), or None if it lies on none."""
        offset = np.subtract(xi, self.lower)
        place = np.where(self.closed, offset % np.subtract(self.upper, self.lower), offset) / self.steps
        near = np.rint(place).astype(np.int64)
        if np.abs(place - near).max() > ON_NODE or np.any(near < 0) or np.any(near > self.cells):
            return None
        return int(self._number(near[:1], near[1:])[0])

    def locate(self, points: Array) -> tuple[Integers, Array]:
        """Return the quadrilateral (n,) that each point (n, 2) of the rectangle lies in, and its place (n, 2) there.

        Places are from 0 to 1 along xi1 and xi2.
        """
        place = (points - self.lower) / self.steps
        cell = np.clip(np.floor(place).astype(np.int64), 0, np.asarray(self.cells) - 1)
        return cell[:, 0] * self.cells[1] + cell[:, 1], place - cell


def bilinear(places: Array) -> Array:
    """Return the bilinear shape functions (n, 4) of a cell's corners at places (n, 2) from 0 to 1."""
    s, t = places[:, 0], places[:, 1]
    return np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=-1)
