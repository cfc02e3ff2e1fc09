"""The curve of load against displacement, from the history of a solution's path."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.protocol.solution import Step

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]

FEWEST = 4  # points through which a cubic spline without further conditions is drawn
SAME_DISPLACEMENT = 1e-9  # relative
TOGETHER = 1e-6  # relative distance of two states below which only one counts: a spline would follow their errors


@dataclass(frozen=True)
class Curve:
    """Load factor against displacement along a path from rest.

    Between its points it is a cubic spline over the length of the polygon through them, both coordinates divided by
    their largest magnitudes.

    Attributes
    ----------
    factors, displacements
        (n,) of consecutive states; the first one is at rest.
    """

    factors: Array
    displacements: Array

    @classmethod
    def of(cls, history: Iterable[Step], quantity: str) -> Curve:
        """Return the curve of a quantity from a solution's history.

        Raises
        ------
        ValueError
            If the history has too few states of a path.
        """
        steps = [step for step in history if step.phase == "path" and quantity in step.quantities]
        points = np.array([(0.0, 0.0), *((step.at, step.quantities[quantity]) for step in steps)])
        largest = np.abs(points).max(axis=0)
        scaled = points / np.where(largest > 0, largest, 1.0)
        kept = [0]
        for number in range(1, len(points)):
            if np.linalg.norm(scaled[number] - scaled[kept[-1]]) > TOGETHER:
                kept.append(number)
            elif len(kept) > 1 and number == len(points) - 1:
                kept[-1] = number  # the path's end stays
        if len(kept) < FEWEST:
            raise ValueError(f"the history has too few states of the path for a curve ({len(kept) - 1})")
        return cls(points[kept, 0], points[kept, 1])

    @cached_property
    def _spline(self) -> CubicSpline:
        points = np.stack([self.factors, self.displacements], axis=1)
        largest = np.abs(points).max(axis=0)
        steps = np.diff(points / np.where(largest > 0, largest, 1.0), axis=0)
        lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
        return _cubic_spline(lengths, points)

    def factor_at(self, displacement: float) -> float:
        """Return the load factor at which the displacement first has the given value.

        Raises
        ------
        ValueError
            If the path does not reach it.
        """
        spline = self._spline
        end = int(np.argmax(self.displacements >= displacement * (1 - SAME_DISPLACEMENT)))
        if end == 0:
            raise ValueError(f"the path does not reach the displacement {displacement:g}")
        if abs(self.displacements[end] - displacement) <= SAME_DISPLACEMENT * abs(displacement):
            return float(self.factors[end])
        shifted = _cubic_spline(spline.x, self.displacements - displacement)
        root = next(r for r in shifted.roots(extrapolate=False) if spline.x[end - 1] <= r <= spline.x[end])
        return float(spline(root)[0])

    def turning_point(self, of: Literal["load", "displacement"], number: int) -> tuple[float, float]:
        """Return load factor and displacement at the extremum of one of them, counted from 1.

        Raises
        ------
        ValueError
            If the path has fewer.
        """
        values = self.factors if of == "load" else self.displacements
        lengths, trend = self._spline.x, np.sign(np.diff(values))
        own = _cubic_spline(lengths, values)
        roots = []
        for root in own.derivative().roots(extrapolate=False):
            span = min(int(np.searchsorted(lengths, root, side="right")) - 1, len(trend) - 1)
            turns = trend[max(span - 1, 0)] != trend[min(span + 1, len(trend) - 1)]
            if turns and own(root, 2) != 0 and root > lengths[0]:  # the states turn, and not only the spline
                roots.append(root)
        if len(roots) < number:
            raise ValueError(f"the path has {len(roots)} turning points of the {of}, not {number}")
        factor, displacement = self._spline(sorted(roots)[number - 1])
        return float(factor), float(displacement)


def _cubic_spline(x: Array, y: Array) -> CubicSpline:
    from scipy.interpolate import CubicSpline  # imported here, so that code without curves does not wait for the import

    return CubicSpline(x, y)
