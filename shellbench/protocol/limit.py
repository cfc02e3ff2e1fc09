"""The limit of values on ever finer meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

RATES = np.linspace(0.2, 12, 2361)  # of convergence that are looked for
ASSUMED = 2.0  # the rate where two values can't tell it
SURE = 0.5  # share of the last extrapolation that stays uncertain if three values alone bound it
STEEP = 2.2  # above this rate three values may have cancelled: that of linear elements is 2
LEAST = 0.1  # of the last change, and of the last extrapolation: so much is uncertain however steep the rate is
SEEN = 3.0  # units of the last digit by which values must change before the change shows a rate
ROUNDING = 1e-12  # relative change that is rounding


@dataclass(frozen=True)
class Limit:
    """A limit, with its uncertainty.

    Attributes
    ----------
    value
        The limit; the last value where none is seen.
    uncertainty
        By which it may be wrong; infinite for a single value.
    rate
        p in value = limit + C h^p; None if the values show none.
    """

    value: float
    uncertainty: float
    rate: float | None


def _three(sizes: np.ndarray, values: np.ndarray) -> tuple[float, float] | None:
    """Return limit and rate through three values; None if they do not approach one from one side."""
    first, second = np.diff(values)
    if second == 0 or first / second <= 0:
        return None
    ratios = (sizes[0] ** RATES - sizes[1] ** RATES) / (sizes[1] ** RATES - sizes[2] ** RATES)
    best = int(np.argmin(np.abs(np.log(ratios / (first / second)))))
    if best in (0, len(RATES) - 1):
        return None
    return float(values[2] + second / ((sizes[1] / sizes[2]) ** RATES[best] - 1)), float(RATES[best])


def limit_of(sizes: ArrayLike, values: ArrayLike, rounding: float = 0.0) -> Limit:
    """Return the limit of values as the size of cells goes to zero, by Richardson's extrapolation with a fitted rate.

    Two values are extrapolated with a rate of 2. Where three or more do not approach a limit from one side, the last
    one is given, and their spread is its uncertainty. Three values may show a steep rate before they reach the final
    one: such a limit is no surer than the last change. Any other is no surer than a tenth of it.

    Parameters
    ----------
    sizes
        Of the cells, from coarse to fine; in any unit.
    values
        One a size.
    rounding
        Half a unit of the last digit of the values: no limit is surer, and smaller changes show no rate.
    """
    h, v = np.asarray(sizes, float), np.asarray(values, float)
    last = float(v[-1])
    if len(v) == 1:
        return Limit(last, float("inf"), None)
    change = abs(float(v[-1] - v[-2]))
    if change <= ROUNDING * np.abs(v).max():
        return Limit(last, max(rounding, ROUNDING * float(np.abs(v).max())), None)
    if len(v) == 2:
        step = float(v[1] - v[0]) / ((h[0] / h[1]) ** ASSUMED - 1)
        return Limit(last + step, max(rounding, change), None)
    if change < 2 * SEEN * rounding:
        return Limit(last, change + rounding, None)
    found = _three(h[-3:], v[-3:])
    if found is None:
        return Limit(last, max(rounding, float(np.ptp(v[-3:]))), None)
    value, rate = found
    moved = abs(value - last)
    before = _three(h[-4:-1], v[-4:-1]) if len(v) > 3 else None
    unsure = abs(value - before[0]) if before else SURE * moved if rate <= STEEP else change
    return Limit(value, max(rounding, unsure, LEAST * moved, LEAST * change), rate)
