"""The limit of values on ever finer meshes, and how far it is away.

Extrapolation with the observed rate, and an honest uncertainty. It rests on one assumption, that errors stay below
C n^-p, and on three observations:

- C is the largest that the last changes show, not what the very last one shows: errors pass through zero.
- p is no faster than the rate of the energy, whose error has one sign and is the most regular of all: the error of a
  linear functional is the energy product of two errors. It is no faster than the singular corners let it be, either.
- Nothing is surer than rounding leaves it: the last refinement of the linear solve measures that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from shellbench.solvers.fem.mesh.mesh import CUBIC

# Rates in the mesh size that are believed; under-resolved meshes show others. The slowest bounds the extrapolation:
# slower ones are told as none. No rate that is believed reaches the fastest.
SLOWEST, FASTEST = 0.1, 6.0
ASYMPTOTIC = 2.0 * (CUBIC - 1)  # order of energies and displacements of C1 cubics: faster coarse meshes slow down
UNSEEN = 2.0  # rate that is believed where none is observed: half the element's
# Of the error that extrapolation estimates. Less states uncertainties that errors exceed where the rate still changes;
# more costs meshes. Not recorded which cases it was set with.
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
        Observed order of convergence in the mesh size; None where it can't be observed or is not believed.
    """

    extrapolated: float
    uncertainty: float
    rate: float | None


def estimate(values: Sequence[float], resolutions: Sequence[float], fastest: float | None = None) -> Estimate:
    """Extrapolate values v_k = v + C n_k^-p to their limit v.

    Parameters
    ----------
    values
        On one mesh after the other.
    resolutions
        Cells a side n_k of the meshes, increasing.
    fastest
        Rate that the uncertainty believes at most, and where the values show none; None if it is not known.

    Returns
    -------
    Estimate
        Extrapolated from the last three values if they converge at a rate between `SLOWEST` and `FASTEST`; a faster
        rate is taken for `FASTEST`. The uncertainty is the sum of all changes to come, by the largest of the last
        changes and a rate that is no more than observed, `fastest` and `ASYMPTOTIC`.
    """
    # 1. One value says nothing. Two say their difference, or more if convergence is known to be slow.
    # 2. The rate p: observed, or else the given one, or else a slow one; never faster than is believed.
    # 3. The changes that are still to come, |d| / (n^-p at its start less that at its end) n_last^-p, which is the
    #    geometric tail |d| r / (1 - r) where meshes grow by a constant factor: the largest by any recent change d.
    # 4. Where changes grow no limit is in sight, and the whole spread is uncertain besides.
    # Richardson's textbook takes the element's order for p, and the last change alone. Under point loads, at corners,
    # and on meshes that do not resolve the solution yet, p is another one. An error that changes its sign leaves one
    # change small by accident: C is bounded by the one before, and by one more where the changes show such a sign.
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
    # No sign change means a rate beyond one of the ends. Fast changes are told from slow ones by their ratio.
    ratio = before / after
    return FASTEST if ratio > (resolutions[2] / resolutions[1]) ** FASTEST else None
