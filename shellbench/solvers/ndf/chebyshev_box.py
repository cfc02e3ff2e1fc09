"""Chebyshev polynomials of time and material: how the weights of a motion are interpolated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from shellbench.problems.conditioned.case import ConditionedCase
from shellbench.solvers.ndf.jets import Array
from shellbench.solvers.ndf.plane_motion import coordinates


@dataclass(frozen=True)
class Box:
    """Chebyshev polynomials on the box of times, log(E h) and nu."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    @classmethod
    def of_case(cls, case: ConditionedCase) -> Box:
        """Return the box of a case: all its materials, from rest to the end."""
        ends = [coordinates(case.ranges.material((share, share, share))) for share in (0.0, 1.0)]
        until = case.shell_of(case.middle).states[-1]
        return cls((0.0, *ends[0]), (until, *ends[1]))

    def nodes(self, axis: int, count: int) -> Array:
        """Return the extrema (count,) of the last polynomial along an axis, increasing; twice as many take them in."""
        share = (1 - np.cos(np.linspace(0, np.pi, count))) / 2
        return np.asarray(self.lower[axis] + share * (self.upper[axis] - self.lower[axis]))

    def rows(self, axis: int, at: float, count: int, order: int = 0) -> Array:
        """Return the polynomials (count,) at a place of an axis, or their derivatives by it."""
        half = (self.upper[axis] - self.lower[axis]) / 2
        x = (at - self.lower[axis]) / half - 1
        return np.asarray(chebyshev.chebval(x, chebyshev.chebder(np.eye(count), order, 1 / half)))

    def coefficients(self, values: Array) -> Array:
        """Return the coefficients of values (times, log(E h), nu, ...) at nodes, of the same shape."""
        for axis in range(3):
            nodes = self.nodes(axis, values.shape[axis])
            matrix = np.array([self.rows(axis, at, len(nodes)) for at in nodes])
            solved = np.linalg.solve(matrix, np.moveaxis(values, axis, 0).reshape(len(nodes), -1))
            values = np.moveaxis(solved.reshape(len(nodes), *np.delete(values.shape, axis)), 0, axis)
        return values

    def evaluated(
        self, coefficients: Array, at: float, place: tuple[float, float], order: tuple[int, int, int] = (0, 0, 0)
    ) -> Array:
        """Return the polynomial (...) of coefficients (times, n, m, ...) at a time and material, or its derivative."""
        for axis, where in enumerate((at, *place)):
            coefficients = np.tensordot(self.rows(axis, where, len(coefficients), order[axis]), coefficients, 1)
        return coefficients
