"""B-splines on the parametric rectangle as features of a field: products of splines of each coordinate, exact jets.

The grid of Shu et al., "Spatially Adaptive Cloth Regression with Implicit Neural Representations", without layers
behind it: the field is linear in the values at the grid. Cells may have any size, and are periodic along a closed
coordinate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from torch import Tensor

from shellbench.solvers.ndf.field.jets import PLANES, Array, Integers, Placement


def raise_degree(values: Array, x: Array, knots: Array, span: Integers) -> Array:
    """Return the splines (n, k + 1) of degree k that are not zero at x (n,), from those (n, k) of one degree less.

    The recurrence of Cox and de Boor (de Boor, A Practical Guide to Splines, 1978, chapter X).
    """
    degree = values.shape[1]
    found = np.zeros((len(x), degree + 1))
    for r in range(degree):
        left, right = knots[span + 1 + r - degree], knots[span + 1 + r]
        share = values[:, r] / (right - left)
        found[:, r] += (right - x) * share
        found[:, r + 1] += (x - left) * share
    return found


def raise_slopes(values: Array, knots: Array, span: Integers) -> Array:
    """Return the derivatives (n, k + 1) of splines of degree k, from splines (n, k) of one degree less; or of these.

    A derivative of splines of one degree less gives the next higher one.
    """
    degree = values.shape[1]
    found = np.zeros((len(span), degree + 1))
    for r in range(degree):
        share = degree * values[:, r] / (knots[span + 1 + r] - knots[span + 1 + r - degree])
        found[:, r] -= share
        found[:, r + 1] += share
    return found


@dataclass(frozen=True)
class Line:
    """The splines of one coordinate.

    Attributes
    ----------
    ends
        (n + 1,): ends of the cells, ascending; two that are equal let second derivatives jump there.
    degree
        Of the splines.
    closed
        Whether the last cell meets the first.
    """

    ends: Array
    degree: int
    closed: bool

    @property
    def cells(self) -> int:
        """Number of cells."""
        return int(np.count_nonzero(np.diff(self.ends)))

    @property
    def count(self) -> int:
        """Number of splines."""
        return len(self.ends) - 1 + (0 if self.closed else self.degree)

    @property
    def knots(self) -> Array:
        """Knots: the ends of cells, with the bounds repeated, or continued around a closed coordinate."""
        ends, size = self.ends, self.ends[-1] - self.ends[0]
        before = ends[-1 - self.degree : -1] - size if self.closed else np.full(self.degree, ends[0])
        beyond = ends[1 : self.degree + 1] + size if self.closed else np.full(self.degree, ends[-1])
        return np.concatenate([before, ends, beyond])

    def nonzero_at(self, x: Array) -> tuple[Integers, Array]:
        """Return the splines that are not zero at x (n,): numbers (n, k), and values and two derivatives (3, n, k)."""
        # Up to two of the steps from constants to degree p are derivatives, the last ones.
        knots, degree = self.knots, self.degree
        span = np.clip(np.searchsorted(knots, x, side="right") - 1, degree, len(knots) - degree - 2)
        planes = []
        for order in range(3):
            values = np.ones((len(x), 1))
            for step in range(1, degree + 1):
                slopes = step > degree - order
                values = raise_slopes(values, knots, span) if slopes else raise_degree(values, x, knots, span)
            planes.append(values if order <= degree else np.zeros((len(x), degree + 1)))
        return (span[:, None] - degree + np.arange(degree + 1)) % self.count, np.stack(planes)


@dataclass(frozen=True)
class Splines:
    """Products of the splines of both coordinates; see `shellbench.solvers.ndf.strains.sampled.FeatureSet`."""

    lines: tuple[Line, Line]
    placement: Placement

    @property
    def count(self) -> int:
        """Number of features M."""
        return self.lines[0].count * self.lines[1].count

    def nonzero_at(self, points: Array) -> tuple[Integers, Array]:
        """Return the features that are not zero at points (N, 2): numbers (N, k) and jets (6, N, k)."""
        (rows, first), (columns, second) = (line.nonzero_at(points[:, axis]) for axis, line in enumerate(self.lines))
        numbers = rows[:, :, None] * self.lines[1].count + columns[:, None, :]
        jets = np.stack([first[i][:, :, None] * second[j][:, None, :] for i, j in PLANES])
        return numbers.reshape(len(points), -1), jets.reshape(len(PLANES), len(points), -1)

    def jets(self, points: Array) -> Tensor:
        """Return the jets (6, N, M) at points (N, 2)."""
        return self._dense_jets(points, len(PLANES))

    def values(self, points: Array) -> Tensor:
        """Return the values (N, M) at points (N, 2)."""
        return self._dense_jets(points, 1)[0]

    def _dense_jets(self, points: Array, planes: int) -> Tensor:
        """Return so many planes of the jets (planes, N, M) of all features, the zero ones included."""
        numbers, jets = self.nonzero_at(points)
        whole = np.zeros((planes, len(points), self.count))
        np.put_along_axis(whole, np.broadcast_to(numbers, (planes, *numbers.shape)), jets[:planes], axis=2)
        return self.placement.tensor(whole)
