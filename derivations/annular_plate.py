"""Annular plate, clamped at its inner rim, free at its outer one, under uniform load q: closed form and Ritz.

Rotational symmetry leaves w(r), downward, with B (1/r d/dr r d/dr)^2 w = q, whose general solution is
w = q r^4 / (64 B) + c1 + c2 log r + c3 r^2 + c4 r^2 log r (Timoshenko & Woinowsky-Krieger, section 16). The rims give
w = w' = 0 at r = a and, at r = b, no bending moment, w'' + nu w' / r = 0, and no shear force, (w'' + w'/r)' = 0.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss

from derivations.estimate import Estimate

INNER, OUTER = 1.0, 2.0  # a, b, metres
YOUNGS_MODULUS, POISSONS_RATIO, THICKNESS = 2e11, 0.3, 0.02
LOAD = 1000.0  # q, N/m^2
BENDING_STIFFNESS = YOUNGS_MODULUS * THICKNESS**3 / 12 / (1 - POISSONS_RATIO**2)
ROUNDING = 1e-13  # relative


def coefficients() -> np.ndarray:
    """Return c1, c2, c3, c4 of the closed form."""
    nu, p = POISSONS_RATIO, LOAD / (64 * BENDING_STIFFNESS)

    def value(r: float) -> list[float]:
        return [1, math.log(r), r**2, r**2 * math.log(r)]

    def slope(r: float) -> list[float]:
        return [0, 1 / r, 2 * r, r * (2 * math.log(r) + 1)]

    def bend(r: float) -> list[float]:
        return [0, -1 / r**2, 2, 2 * math.log(r) + 3]

    b = OUTER
    rows = [
        value(INNER),
        slope(INNER),
        [second + nu * first / b for second, first in zip(bend(b), slope(b), strict=True)],
        [0, 0, 0, 4 / b],
    ]
    right = [-p * INNER**4, -4 * p * INNER**3, -p * (12 + 4 * nu) * b**2, -32 * p * b]
    return np.linalg.solve(np.array(rows, dtype=float), np.array(right))


def deflection(r: np.ndarray) -> np.ndarray:
    """Return the downward displacement (n,), metres, at radii (n,)."""
    c1, c2, c3, c4 = coefficients()
    return LOAD * r**4 / (64 * BENDING_STIFFNESS) + c1 + c2 * np.log(r) + c3 * r**2 + c4 * r**2 * np.log(r)


def annular_plate() -> dict[str, Estimate]:
    """Return the gated and the other quantities of cases/annular_plate.toml."""
    x, weights = leggauss(40)
    r = INNER + (OUTER - INNER) * (x + 1) / 2
    work = float(2 * math.pi * LOAD * (weights * deflection(r) * r).sum() * (OUTER - INNER) / 2)
    rim = float(deflection(np.array([OUTER]))[0])
    force = LOAD * math.pi * (OUTER**2 - INNER**2)
    return {
        "rim_deflection": Estimate(rim, ROUNDING * rim, "m"),
        "largest_displacement": Estimate(rim, ROUNDING * rim, "m"),
        "hub_force": Estimate(force, ROUNDING * force, "N"),
        "strain_energy": Estimate(work / 2, ROUNDING * work, "J"),
        "membrane_energy": Estimate(0.0, 0.0, "J"),
        "bending_energy": Estimate(work / 2, ROUNDING * work, "J"),
    }


def rim_deflection_by_ritz(degree: int = 14) -> float:
    """Return the rim's deflection by minimising the energy over (r - a)^2 times polynomials: no rim condition but the clamp.

    E = pi B int [(w'' + w'/r)^2 - 2 (1 - nu) w'' w'/r] r dr - 2 pi q int w r dr.
    """
    x, weights = leggauss(4 * degree)
    half = (OUTER - INNER) / 2
    r, dr = INNER + half * (x + 1), weights * half
    clamp = Legendre([half, half], domain=[-1, 1]) ** 2
    shapes = [clamp * Legendre.basis(k) for k in range(degree)]
    w, first, second = (np.array([s.deriv(n)(x) / half**n if n else s(x) for s in shapes]) for n in range(3))
    tangential = first / r
    trace = second + tangential
    stiffness = (trace * dr * r) @ trace.T
    stiffness -= (1 - POISSONS_RATIO) * ((second * dr * r) @ tangential.T + (tangential * dr * r) @ second.T)
    weights_of_shapes = np.linalg.solve(BENDING_STIFFNESS * stiffness, LOAD * (w * dr * r).sum(axis=1))
    return float(sum(c * s(1.0) for c, s in zip(weights_of_shapes, shapes, strict=True)))
