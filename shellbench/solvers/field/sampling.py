"""Samplers: points of the unit square, by chance or by a density, and Lloyd's relaxation.

Shu et al., section 3.2: eq. (7) to (13)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shellbench.problems.field.structure import lattice

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
LEAST = float(np.nextafter(0.0, 1.0))  # a random number that is zero would pick a row without probability
ASKED = 200  # points along a side whose nearest sample says its region


@dataclass(frozen=True)
class Cells:
    """A probability (m, n) by equal cells of the unit square, of any positive sum: rows along u, columns along v."""

    shares: Array

    def marginal(self) -> Array:
        """Return the cumulated probability (m,) of rows: eq. (8) and (9)."""
        cumulated = np.cumsum(self.shares.sum(axis=1))
        return np.asarray(cumulated / cumulated[-1])

    def conditional(self, row: int) -> Array:
        """Return the cumulated probability (n,) of columns within a row: eq. (11)."""
        cumulated = np.cumsum(self.shares[row])
        return np.asarray(cumulated / cumulated[-1])

    def pick(self, u: Array, v: Array) -> tuple[Whole, Whole]:
        """Return rows and columns (k,) that random numbers from 0 to 1 pick: eq. (10), with P_k, and (12)."""
        rows = np.searchsorted(self.marginal(), np.maximum(u, LEAST))
        columns = np.zeros_like(rows)
        for row in np.unique(rows):
            here = rows == row
            columns[here] = np.searchsorted(self.conditional(row), np.maximum(v[here], LEAST))
        return rows, columns

    def draw(self, count: int, random: np.random.Generator) -> Array:
        """Return points (count, 2)."""
        rows, columns = self.pick(random.random(count), random.random(count))
        return np.asarray((np.stack([rows, columns], axis=1) + random.random((count, 2))) / np.array(self.shares.shape))

    def density(self, points: Array) -> Array:
        """Return the probability per area (k,) at points (k, 2)."""
        size = np.array(self.shares.shape)
        rows, columns = np.minimum((points * size).astype(int), size - 1).T
        return np.asarray(self.shares[rows, columns] * size.prod() / self.shares.sum())

    def mixed(self, fresh: Array, kept: float) -> Cells:
        """Return the next probability, of which a part is kept: eq. (7)."""
        return Cells(kept * self.shares / self.shares.sum() + (1 - kept) * fresh / fresh.sum())


def jittered(count: int, random: np.random.Generator) -> Array:
    """Return a point (count^2, 2) in each of equal cells, so many along a side."""
    return np.asarray(lattice(count) + (random.random((count**2, 2)) - 0.5) / count)


def relaxed(points: Array, steps: int) -> Array:
    """Return points (n, 2) after steps of Lloyd's relaxation, regions being those of a lattice's points: eq. (13)."""
    asked = lattice(ASKED)
    for _ in range(steps):
        nearest = cKDTree(points).query(asked)[1]
        count = np.bincount(nearest, minlength=len(points))
        sums = [np.bincount(nearest, asked[:, axis], len(points)) for axis in (0, 1)]
        centres = np.stack(sums, axis=1) / np.maximum(count, 1)[:, None]
        points = np.where(count[:, None] > 0, centres, points)
    return points


def relaxed_on_a_line(places: Array, steps: int) -> Array:
    """Return places (n,) in order from 0 to 1 after steps of Lloyd's relaxation, with exact regions."""
    for _ in range(steps):
        borders = np.concatenate([[0.0], (places[1:] + places[:-1]) / 2, [1.0]])
        places = (borders[1:] + borders[:-1]) / 2
    return places


def positive(losses: Array) -> Array:
    """Return losses shifted so that none is negative, as a probability requires. The paper does not state this step."""
    shifted: Any = losses - min(float(losses.min()), 0.0)
    return np.asarray(shifted if shifted.any() else np.ones_like(shifted))
