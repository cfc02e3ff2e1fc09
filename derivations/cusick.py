r"""The ring of the drape test while it is round: equilibrium of its meridian, cases/cusick_drape.toml.

The meridian at rest is the radius r in [a, b]. Deformed it is (R, Z), Z downward, with stretch lambda and slope phi:

    R' = lambda cos phi,  Z' = lambda sin phi,  e1 = (lambda^2 - 1) / 2,  e2 = ((R / r)^2 - 1) / 2,
    k1 = lambda phi',  k2 = R sin phi / r^2,

per area W = D (e1^2 + e2^2 + 2 nu e1 e2) / 2 + B (k1^2 + k2^2 + 2 nu k1 k2) / 2. Stationary is the integral of r W less that of
r w Z, w the weight. With H and V the forces that join the parts of the meridian, times r, and M = r dW/dphi' its moment:

    r dW/dlambda = H cos phi + V sin phi,  V = w (b^2 - r^2) / 2,
    H' = r dW/dR,  M' = r dW/dphi + lambda (H sin phi - V cos phi),

R = a, phi = 0 and Z = 0 at the clamp, H = M = 0 at the rim. The second form and all folds are `cusick_by_splines`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.integrate import solve_bvp

from .estimate import Estimate
from .surface_strains import Array

INNER, OUTER = 0.09, 0.15  # m
YOUNG, POISSON, THICKNESS = 9.6e5, 0.0, 5e-4
MEMBRANE = YOUNG * THICKNESS / (1 - POISSON**2)
BENDING = MEMBRANE * THICKNESS**2 / 12
FINE, COARSE = 1e-9, 1e-7
"""Tolerances of the collocation."""
CORRECTIONS = 12
"""Newton steps for the stretch, which is near 1."""


@dataclass(frozen=True)
class Round:
    """A round state: drop of the rim, m; drape coefficient; membrane and bending energy, J."""

    sag: float
    coefficient: float
    membrane: float
    bending: float


def weight(length: float) -> float:
    """Return the weight an area, N/m^2, at a bending length, m."""
    return BENDING / length**3


def _state(r: Array, y: Array, w: float) -> tuple[Array, ...]:
    """Return lambda, phi', the strains and V of states y (7, n) at r."""
    radius, phi, h, moment = y[0], y[1], y[3], y[4]
    v = w * (OUTER**2 - r**2) / 2
    pull = h * np.cos(phi) + v * np.sin(phi)
    e2, k2 = ((radius / r) ** 2 - 1) / 2, radius * np.sin(phi) / r**2
    stretch = np.ones_like(r)
    for _ in range(CORRECTIONS):  # r D (e1 + nu e2) lambda + M phi' / lambda = pull, phi' by M
        turning = (moment / (r * BENDING * stretch) - POISSON * k2) / stretch
        by_turning = -(2 * moment / (r * BENDING * stretch) - POISSON * k2) / stretch**2
        e1 = (stretch**2 - 1) / 2
        missing = r * MEMBRANE * (e1 + POISSON * e2) * stretch + moment * turning / stretch - pull
        slope = r * MEMBRANE * (e1 + POISSON * e2 + stretch**2)
        stretch = stretch - missing / (slope + moment * (by_turning - turning / stretch) / stretch)
    turning = (moment / (r * BENDING * stretch) - POISSON * k2) / stretch
    return stretch, turning, (stretch**2 - 1) / 2, e2, stretch * turning, k2, v


@cache
def round_state(length: float, tolerance: float = FINE) -> Round:
    """Return the round state at a bending length, m, reached from the flat ring by growing weights."""
    r = np.linspace(INNER, OUTER, 41)
    y = np.zeros((7, len(r)))
    y[0] = r

    def ends(low: Array, high: Array) -> Array:
        return np.array([low[0] - INNER, low[1], low[2], high[3], high[4], low[5], low[6]])

    for w in weight(length) * np.array([0.01, 0.1, 0.3, 0.6, 1.0]):

        def along(r: Array, y: Array, w: float = w) -> Array:
            stretch, turning, e1, e2, k1, k2, v = _state(r, y, w)
            radius, phi, h = y[0], y[1], y[3]
            hoop, ring = MEMBRANE * (e2 + POISSON * e1), BENDING * (k2 + POISSON * k1)
            return np.stack(
                [
                    stretch * np.cos(phi),
                    turning,
                    stretch * np.sin(phi),
                    hoop * radius / r + ring * np.sin(phi) / r,
                    ring * radius * np.cos(phi) / r + stretch * (h * np.sin(phi) - v * np.cos(phi)),
                    np.pi * r * MEMBRANE * (e1**2 + e2**2 + 2 * POISSON * e1 * e2),
                    np.pi * r * BENDING * (k1**2 + k2**2 + 2 * POISSON * k1 * k2),
                ]
            )

        found = solve_bvp(along, ends, r, y, tol=tolerance, max_nodes=200_000)
        if not found.success:
            raise ArithmeticError(f"no round state at a bending length of {length:g} m: {found.message}")
        r, y = found.x, found.y
    rim = y[:, -1]
    coefficient = (rim[0] ** 2 - INNER**2) / (OUTER**2 - INNER**2)
    return Round(float(rim[2]), float(coefficient), float(rim[5]), float(rim[6]))


def values(near: Round, far: Round) -> dict[str, float]:
    """Return the quantities of the case by name, from the states at 100 and at 120 mm."""
    return {
        "sag_120mm": far.sag,
        "sag_100mm": near.sag,
        "drape_coefficient_100mm": near.coefficient,
        "bending_energy_100mm": near.bending,
    }


UNITS = {"drape_coefficient_100mm": "", "bending_energy_100mm": "J", "buckling": ""}


def by_collocation() -> dict[str, Estimate]:
    """Return the values of the round states by collocation; the uncertainty is the change from a coarser one."""
    fine, coarse = (values(*(round_state(c, tolerance) for c in (0.1, 0.12))) for tolerance in (FINE, COARSE))
    return {
        name: Estimate.between(value, coarse[name], UNITS.get(name, "m"), 1e-11 * abs(value))
        for name, value in fine.items()
    }
