"""A number with its uncertainty, and the sum of a series whose terms decay algebraically."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import zeta

ROUNDING = 1e-14
"""Relative uncertainty of a closed form in double precision."""


@dataclass(frozen=True)
class Estimate:
    """A computed value and the half-width of the interval that is believed to hold the true one."""

    value: float
    uncertainty: float
    unit: str

    @classmethod
    def between(cls, fine: float, coarse: float, unit: str, rounding: float) -> Estimate:
        """Take the fine value; its distance from a clearly coarser one, plus rounding, is the error.

        For a convergent method the distance overstates the error of the fine value, on purpose.
        The rounding error is absolute, in the same unit: two levels may agree by chance.
        """
        return cls(float(fine), float(abs(fine - coarse) + rounding), unit)

    @classmethod
    def exact(cls, value: float, unit: str) -> Estimate:
        """Wrap a closed form, uncertain by rounding only."""
        return cls(float(value), float(ROUNDING * abs(value)), unit)


def algebraic_series_sum(index: np.ndarray, terms: np.ndarray, power: int, corrections: int = 3) -> float:
    """Sum a_n over the given indices and, with a fitted tail, over all that follow.

    The tail is a_n = n^-power (c0 + c1 n^-2 + c2 n^-4 + ...), fitted by least squares to the last
    half of the terms and summed by the Hurwitz zeta function.

    Parameters
    ----------
    index : (N,) equally spaced, ascending, positive; the tail goes on with the same spacing
    terms : (N,) a_n, of one sign and already in their asymptotic regime at N / 2
    power : leading power of the decay, greater than 1
    corrections : how many coefficients c are fitted
    """
    spacing = float(index[1] - index[0])
    last = float(index[-1])
    half = slice(len(index) // 2, None)
    exponents = power + 2 * np.arange(corrections)
    # Columns scaled by the last index: all of them are of order one there.
    columns = (index[half, None] / last) ** (-exponents.astype(float))
    weight = (index[half] / last) ** float(power)
    coefficients = np.linalg.lstsq(columns * weight[:, None], terms[half] * weight, rcond=None)[0]
    tails = (last / spacing) ** exponents * zeta(exponents, last / spacing + 1.0)
    return float(terms.sum() + coefficients @ tails)
