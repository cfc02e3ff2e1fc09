"""How far a sequence of meshes has come: extrapolation with the observed rate, and an honest uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.optimize import brentq

SLOWEST, FASTEST = 1.0, 6.0  # rates in the mesh size that are believed; under-resolved meshes show others
ASYMPTOTIC = 4.0  # order of the element's energies and displacements: coarse meshes may seem faster, and slow down
SAFETY = 1.5  # of the error that extrapolation estimates


@dataclass(frozen=True)
class Estimate:
    """What a sequence of values on ever finer meshes says of its limit.

    Attributes
    ----------
    extrapolated
        Richardson's extrapolation of the last values.
    uncertainty
        Estimated error of the last value, with a margin; infinite for a single value.
    rate
        Observed order of convergence in the mesh size; None where it can't be observed or is not believed.
    """

    extrapolated: float
    uncertainty: float
    rate: float | None


def estimate(values: Sequence[float], resolutions: Sequence[float]) -> Estimate:
    """Extrapolate values v_k = v + C n_k^-p to their limit v.

    Parameters
    ----------
    values
        On one mesh after the other.
    resolutions
        Cells a side n_k of the meshes, increasing.

    Returns
    -------
    Estimate
        From the last three values if they converge at a rate between `SLOWEST` and `FASTEST`; a faster rate is
        taken for `FASTEST`, and the uncertainty trusts in none beyond `ASYMPTOTIC`. Otherwise nothing is
        extrapolated: the uncertainty is what the last change leaves at the slowest rate if it is a small step back,
        and else the largest change among them.
    """
    # 1. One value says nothing. Two say their difference, as does a sequence that stands still.
    # 2. Three that swing, the last between the others: what the slowest rate leaves of the last change.
    # 3. Three that converge at a credible rate: extrapolate, and take a margin on the error that this shows.
    # 4. Three that do neither: no limit is in sight, and the whole spread is the uncertainty.
    # Richardson's textbook takes the element's order for p. Here p is observed. Under point loads, and on meshes that
    # do not resolve the solution yet, it is another one.
    last = values[-1]
    if len(values) < 2:
        return Estimate(last, math.inf, None)
    change = last - values[-2]
    if len(values) < 3 or change == 0.0:
        return Estimate(last, abs(change), None)
    growth = resolutions[-1] / resolutions[-2]
    before = values[-2] - values[-3]
    if before * change < 0 and abs(change) < abs(before) / 2:
        return Estimate(last, SAFETY * abs(change) / (growth**SLOWEST - 1), None)
    rate = observed_rate(values[-3:], resolutions[-3:])
    if rate is None:
        return Estimate(last, max(abs(change), abs(last - values[-3])), None)
    extrapolated = last + change / (growth**rate - 1)
    # A rate above the element's own is an accident of coarse meshes. The extrapolation uses it, the uncertainty does
    # not.
    uncertainty = SAFETY * abs(change) / (growth ** min(rate, ASYMPTOTIC) - 1)
    return Estimate(extrapolated, uncertainty, rate if rate < FASTEST else None)


def observed_rate(values: Sequence[float], resolutions: Sequence[float]) -> float | None:
    """Return the p of v_k = v + C n_k^-p through three values; `FASTEST` if it is beyond; None if there is none."""
    before, after = values[1] - values[0], values[2] - values[1]
    if after == 0.0 or before / after <= 0.0:
        return None

    # v = v_k - C n_k^-p for three k, C eliminated by cross-multiplying. Meshes need not grow by a constant factor, for
    # which alone p = log(before / after) / log(growth). Resolutions relative to the finest keep n^-p of order one.
    def misfit(p: float) -> float:
        coarse, middle, fine = (n / resolutions[2] for n in resolutions)
        return float((middle**-p - coarse**-p) * after - (fine**-p - middle**-p) * before) / abs(before)

    if misfit(SLOWEST) * misfit(FASTEST) < 0:
        return float(brentq(misfit, SLOWEST, FASTEST))
    # No sign change means a rate beyond one of the ends. Fast changes are told from slow ones by their ratio.
    ratio = before / after
    return FASTEST if ratio > (resolutions[2] / resolutions[1]) ** FASTEST else None
