"""Annular plate, clamped at its inner rim, free at its outer one, under uniform load q: closed form and Ritz.

Rotational symmetry leaves w(r), downward, with B (1/r d/dr r d/dr)^2 w = q, whose general solution is
w = q r^4 / (64 B) + c1 + c2 log r + c3 r^2 + c4 r^2 log r (Timoshenko & Woinowsky-Krieger, section 16). The rims give
w = w' = 0 at r = a and, at r = b, no bending moment, w'' + nu w' / r = 0, and no shear force, (w'' + w'/r)' = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss

from derivations.estimate import Estimate

ROUNDING = 1e-13  # relative


@dataclass(frozen=True)
class Ring:
    """Radii a and b and thickness in m, Young's modulus and load in Pa; complex numbers give derivatives."""

    inner: complex = 1.0
    outer: complex = 2.0
    young: complex = 2e11
    poisson: complex = 0.3
    thickness: complex = 0.02
    load: complex = 1000.0

    @property
    def bending_stiffness(self) -> complex:
        """B, N m."""
        return self.young * self.thickness**3 / 12 / (1 - self.poisson**2)

    @property
    def force(self) -> complex:
        """Force of the hub, N."""
        return self.load * math.pi * (self.outer**2 - self.inner**2)

    def coefficients(self) -> np.ndarray:
        """Return c1, c2, c3, c4 of the closed form."""
        nu, p = self.poisson, self.load / (64 * self.bending_stiffness)

        def value(r: complex) -> list[complex]:
            return [1, np.log(r), r**2, r**2 * np.log(r)]

        def slope(r: complex) -> list[complex]:
            return [0, 1 / r, 2 * r, r * (2 * np.log(r) + 1)]

        def bend(r: complex) -> list[complex]:
            return [0, -1 / r**2, 2, 2 * np.log(r) + 3]

        a, b = self.inner, self.outer
        rows = [
            value(a),
            slope(a),
            [second + nu * first / b for second, first in zip(bend(b), slope(b), strict=True)],
            [0, 0, 0, 4 / b],
        ]
        right = [-p * a**4, -4 * p * a**3, -p * (12 + 4 * nu) * b**2, -32 * p * b]
        return np.linalg.solve(np.array(rows), np.array(right))

    def deflection(self, r: np.ndarray) -> np.ndarray:
        """Return the downward displacement (n,), metres, at radii (n,)."""
        c1, c2, c3, c4 = self.coefficients()
        return (
            self.load * r**4 / (64 * self.bending_stiffness) + c1 + c2 * np.log(r) + c3 * r**2 + c4 * r**2 * np.log(r)
        )


def deflection(r: np.ndarray) -> np.ndarray:
    """Return the downward displacement (n,) of cases/annular_plate.toml, metres, at radii (n,)."""
    return Ring().deflection(r)


def annular_plate() -> dict[str, Estimate]:
    """Return the gated and the other quantities of cases/annular_plate.toml."""
    ring = Ring()
    x, weights = leggauss(40)
    r = ring.inner + (ring.outer - ring.inner) * (x + 1) / 2
    work = float(2 * math.pi * ring.load * (weights * deflection(r) * r).sum() * (ring.outer - ring.inner) / 2)
    rim = float(deflection(np.array([ring.outer]))[0])
    return {
        "rim_deflection": Estimate(rim, ROUNDING * rim, "m"),
        "largest_displacement": Estimate(rim, ROUNDING * rim, "m"),
        "hub_force": Estimate(ring.force, ROUNDING * ring.force, "N"),
        "strain_energy": Estimate(work / 2, ROUNDING * work, "J"),
        "membrane_energy": Estimate(0.0, 0.0, "J"),
        "bending_energy": Estimate(work / 2, ROUNDING * work, "J"),
    }


def rim_deflection_by_ritz(degree: int = 14, ring: Ring = Ring(), at: float | None = None) -> float:
    """Return the rim's deflection by minimising the energy over (r - a)^2 times polynomials: no rim condition but the clamp.

    E = pi B int [(w'' + w'/r)^2 - 2 (1 - nu) w'' w'/r] r dr - 2 pi q int w r dr. With `at`, the deflection at a radius.
    """
    x, weights = leggauss(4 * degree)
    half = (ring.outer - ring.inner) / 2
    r, dr = ring.inner + half * (x + 1), weights * half
    clamp = Legendre([half, half], domain=[-1, 1]) ** 2
    shapes = [clamp * Legendre.basis(k) for k in range(degree)]
    w, first, second = (np.array([s.deriv(n)(x) / half**n if n else s(x) for s in shapes]) for n in range(3))
    tangential = first / r
    trace = second + tangential
    stiffness = (trace * dr * r) @ trace.T
    stiffness -= (1 - ring.poisson) * ((second * dr * r) @ tangential.T + (tangential * dr * r) @ second.T)
    weights_of_shapes = np.linalg.solve(ring.bending_stiffness * stiffness, ring.load * (w * dr * r).sum(axis=1))
    place = 1.0 if at is None else (at - ring.inner) / half - 1
    return float(sum(c * s(place) for c, s in zip(weights_of_shapes, shapes, strict=True)))
