"""Rates of convergence: the slope of an error on logarithmic axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FEWEST = 3  # points that make a slope believable
COARSEST = 0.3  # relative errors above this are no asymptotic range
ABOVE_FLOOR = 2.0  # errors closer than this factor to what is known of the answer say nothing about the rate
LONGEST = 4  # points of a fit, from the finest backwards: the asymptotic range


@dataclass(frozen=True)
class Rate:
    """A fitted power law error = factor * x ** slope over [first, last]."""

    slope: float
    factor: float
    first: float
    last: float

    def __call__(self, x: float) -> float:
        """Return the error that the law gives at x."""
        return float(self.factor * x**self.slope)


def fitted_rate(x: Sequence[float], error: Sequence[float], floor: float = 0.0) -> Rate | None:
    """Fit a power law by least squares in the logarithms.

    Parameters
    ----------
    x
        Degrees of freedom, seconds, or what else grows.
    error
        Relative errors, positive.
    floor
        Relative uncertainty of what the error is measured against.

    Returns
    -------
    Rate or None
        None if fewer than `FEWEST` points lie above the floor and below `COARSEST`.
    """
    points = [
        (a, e) for a, e in sorted(zip(x, error, strict=True)) if a > 0 and max(0.0, ABOVE_FLOOR * floor) < e < COARSEST
    ][-LONGEST:]
    if len({a for a, _ in points}) < FEWEST:
        return None
    logs = np.log(np.array(points))
    slope, intercept = np.polyfit(logs[:, 0], logs[:, 1], 1)
    return Rate(float(slope), float(np.exp(intercept)), points[0][0], points[-1][0])
