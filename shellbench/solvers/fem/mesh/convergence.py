"""The limit of values on ever finer meshes, and the distance of the last value from it.

Extrapolation with the observed rate, and a conservative uncertainty. It rests on the assumption that errors stay below
C n^-p, and on three observations:

- C is the largest by the last changes, not that of the very last one: errors pass through zero.
- p is at most the rate of the energy, whose error has one sign and is the most regular of all: the error of a linear
  functional is the energy product of two errors. It is also at most the rate that the singular corners allow.
- No uncertainty is below rounding, which the last refinement of the linear solve measures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from shellbench.solvers.fem.mesh.basis import CUBIC

# Accepted rates in the mesh size; under-resolved meshes show others. The slowest bounds the extrapolation: slower ones
# are reported as None. No accepted rate reaches the fastest.
SLOWEST, FASTEST = 0.1, 6.0
ASYMPTOTIC = 2.0 * (CUBIC - 1)  # order of energies and displacements of C1 cubics: faster coarse meshes slow down
UNSEEN = 2.0  # rate that is assumed if none is observed: half the element's
# Factor of the error estimated by extrapolation. With a smaller one, errors exceed uncertainties while the rate still
# changes; a larger one costs meshes. The cases it was set on are not recorded.
SAFETY = 1.5
RECENT = 2  # changes that bound the error; one more where they differ in sign


@dataclass(frozen=True)
class Estimate:
    """Estimate of the limit of a sequence of values on ever finer meshes.

    Attributes
    ----------
    extrapolated
        Richardson's extrapolation of the last values.
    uncertainty
        Estimated error of the last value, with a margin; infinite for a single value.
    rate
        Observed order of convergence in the mesh size; None if it can't be observed or is not accepted.
    """

    extrapolated: float
    uncertainty: float
    rate: float | None


def estimate(values: Sequence[float], resolutions: Sequence[float], fastest: float | None = None) -> Estimate:
    """Extrapolate values v_k = v + C n_k^-p to their limit v.

    Parameters
    ----------
    values
        Values on one mesh after the other.
    resolutions
        Cells a side n_k of the meshes, increasing.
    fastest
        Upper bound of the rate in the uncertainty, also used if the values show no rate; None if unknown.

    Returns
    -------
    Estimate
        Extrapolated from the last three values if they converge at a rate between `SLOWEST` and `FASTEST`; a faster
        rate is taken for `FASTEST`. The uncertainty is the sum of all further changes, by the largest of the last
        changes and the least of three rates: the observed one, `fastest` and `ASYMPTOTIC`.
    """
    # 1. One value gives no bound. Two give their difference, or more if convergence is known to be slow.
    # 2. Take the rate p: the observed one, or else the given one, or else a slow one; never above the accepted ones.
    # 3. Sum the further changes: |d| / (n^-p at its start less that at its end) n_last^-p. This is the geometric tail
    #    |d| r / (1 - r) if meshes grow by a constant factor. Take the largest by any recent change d.
    # 4. If changes grow, no limit is in sight, and the whole spread is added.
    # The textbook (Richardson) takes the element's order for p, and the last change alone. Under point loads, at
    # corners, and on meshes that do not resolve the solution yet, p is different. An error that changes its sign makes
    # one change small by chance: C is bounded by the change before, and by one more if the changes differ in sign.
    last = values[-1]
    if len(values) < 2:
        return Estimate(last, math.inf, None)
    limit = min(fastest or ASYMPTOTIC, ASYMPTOTIC)
    change, growth = last - values[-2], resolutions[-1] / resolutions[-2]
    if len(values) < 3:
        return Estimate(last, abs(change) * max(1.0, 1 / (growth**limit - 1)), None)
    rate = observed_rate(values[-3:], resolutions[-3:])
    believed = min(limit, rate) if rate is not None else min(limit, fastest or UNSEEN)
    uncertainty = 0.0
    changes = np.diff(values[-RECENT - 2 :])
    turned = bool((changes > 0).any() and (changes < 0).any())
    for k in range(-1, -1 - min(RECENT + turned, len(values) - 1), -1):
        start, end = ((n / resolutions[-1]) ** -believed for n in (resolutions[k - 1], resolutions[k]))
        uncertainty = max(uncertainty, SAFETY * abs(values[k] - values[k - 1]) / (start - end))
    if rate is None:
        before = values[-2] - values[-3]
        if abs(change) > abs(before):
            uncertainty = max(uncertainty, abs(change), abs(last - values[-3]))
        return Estimate(last, uncertainty, None)
    extrapolated = last + change / (growth**rate - 1)
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
    # Without a sign change the rate is beyond one of the ends. The ratio of the changes shows at which one.
    ratio = before / after
    return FASTEST if ratio > (resolutions[2] / resolutions[1]) ** FASTEST else None
