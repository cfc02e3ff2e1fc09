r"""A long round tube under a pressure from outside that follows it, up to where it buckles: cases/pressed_ring.toml.

Between its ends, which are held apart, each section is a curve x(s), s its length at rest, with the stretch lambda and the angle
theta of its tangent t. As x'' . n = lambda theta', with n inward,

    W = C eps^2 / 2 + D kap^2 / 2,   eps = (lambda^2 - 1) / 2,   kap = lambda theta' - 1 / R,   C = E h / (1 - nu^2),

D = C h^2 / 12. Stationary is W less the work of the pressure p, with the forces N t + Q n that join the parts of the curve, and
their moment M:

    N = dW/dlambda = C eps lambda + D kap theta',   M = dW/dtheta' = D kap lambda,
    N' = Q theta',   Q' = -N theta' - p lambda,   M' = -lambda Q.

The circle shrinks by the lambda of N = -p lambda R. It buckles where the equations, linear in a change of it, have an answer with
theta ~ sin(2 s / R): the two planes of symmetry that the case has admit even numbers of waves, and two come first.

The second form knows positions alone, and no forces: the energy of a closed curve of a few harmonics, plus p times the area inside.
It is stationary at one of the circles, and there its second derivatives, by two amplitudes of two waves, cease to be positive
definite. First derivatives are taken by complex steps, second ones by differences of these.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.optimize import brentq

from .estimate import Estimate
from .surface_strains import Array

RADIUS, LENGTH = 1.0, 0.4  # m
YOUNG, POISSON, THICKNESS = 1e6, 0.3, 0.1
STRETCHING = YOUNG * THICKNESS / (1 - POISSON**2)
BENDING = STRETCHING * THICKNESS**2 / 12
PRESSURE = 300.0  # at full load, Pa: somewhat more than 3 D / R^3
HALF = 0.5  # of the pressure, at which the circle is looked at
WAVES = 2
ROUNDING = 1e-12
AGREED = 1e-8
"""Relative: what rounding leaves of the differences."""
SAMPLES = 64
"""Around the curve: sums over these are exact but for rounding."""
STEPS = 2e-5, 1e-5
"""Of the differences, in m, coarser and finer; their errors fall with the square."""


def _circle(pressure: float) -> float:
    """Return the stretch of the circle in equilibrium."""

    def missing(stretch: float) -> float:
        return _force(stretch) + pressure * stretch * RADIUS

    return float(brentq(missing, 0.9, 1.0, xtol=1e-16, rtol=1e-15))


def _force(stretch: float) -> float:
    """Return N of a circle, N/m."""
    return STRETCHING * (stretch**2 - 1) / 2 * stretch + BENDING * (stretch - 1) / RADIUS**2


def _unbalanced(pressure: float) -> float:
    """Return the residual of the balance of forces across a circle with waves: zero where it buckles."""
    # 1. theta changes by sin(k s), so theta' by k cos(k s), lambda by a cos(k s): by the laws, N and M by cosines.
    # 2. Q from M, then a from N' = Q theta'. 3. What is left of Q' = -N theta' - p lambda.
    stretch, k, turning = _circle(pressure), WAVES / RADIUS, 1 / RADIUS
    kap = (stretch - 1) / RADIUS
    by_stretch = STRETCHING * (3 * stretch**2 - 1) / 2 + BENDING * turning**2
    both, by_turning = BENDING * (kap + stretch * turning), BENDING * stretch**2
    # Q = q sin(k s): stretch q = k (both a + by_turning k), and -k (by_stretch a + both k) = q turning
    a = -k * (both * stretch + by_turning * turning) / (by_stretch * stretch + both * turning)
    normal, q = by_stretch * a + both * k, k * (both * a + by_turning * k) / stretch
    return k * q + normal * turning + _force(stretch) * k + pressure * a


def _values(critical: float, half: float, energies: tuple[float, float]) -> dict[str, float]:
    membrane, bending = energies
    return {
        "critical_pressure": critical,
        "shrinkage_50": RADIUS * (1 - half),
        "strain_energy_50": membrane + bending,
        "bending_energy_50": bending,
    }


def _unit(name: str) -> str:
    return {"critical_pressure": "Pa", "strain_energy_50": "J", "bending_energy_50": "J"}.get(name, "m")


def pressed_ring() -> dict[str, Estimate]:
    """Known values by balance; uncertain by rounding."""
    critical = float(brentq(_unbalanced, 0.5 * PRESSURE, PRESSURE, xtol=1e-12, rtol=1e-14))
    half = _circle(HALF * PRESSURE)
    area = np.pi / 2 * RADIUS * LENGTH  # of a quarter
    energies = (
        area * STRETCHING * ((half**2 - 1) / 2) ** 2 / 2,
        area * BENDING * ((half - 1) / RADIUS) ** 2 / 2,
    )
    values = _values(critical, half, energies)
    # a small difference from 1 keeps fewer digits
    return {
        n: Estimate(v, ROUNDING * max(abs(v), 1.0) if _unit(n) == "m" else 100 * ROUNDING * abs(v), _unit(n))
        for n, v in values.items()
    }


# --- the second form ----------------------------------------------------------------------------------


def _potential(stretch: complex, waves: tuple[complex, complex], pressure: float) -> tuple[complex, complex, complex]:
    """Return the potential of a unit of length, with its parts of membrane and bending, J/m.

    `waves` are amplitudes of cos(2 angle) outward and of sin(2 angle) along the circle, m.
    """
    angle = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    c, s = np.cos(WAVES * angle), np.sin(WAVES * angle)
    # position along e_r and e_t, and its first two derivatives by the angle: e_r' = e_t, e_t' = -e_r
    x = np.array([stretch * RADIUS + waves[0] * c, waves[1] * s])
    x1 = np.array([-WAVES * waves[0] * s - x[1], WAVES * waves[1] * c + x[0]])
    x2 = np.array(
        [
            -(WAVES**2) * waves[0] * c - WAVES * waves[1] * c - x1[1],
            -(WAVES**2) * waves[1] * s - WAVES * waves[0] * s + x1[0],
        ]
    )
    squared = (x1[0] ** 2 + x1[1] ** 2) / RADIUS**2
    eps = (squared - 1) / 2
    kap = (x1[0] * x2[1] - x1[1] * x2[0]) / np.sqrt(squared) / RADIUS**3 - 1 / RADIUS
    share = 2 * np.pi / SAMPLES
    membrane = STRETCHING / 2 * np.sum(eps**2) * share * RADIUS
    bending = BENDING / 2 * np.sum(kap**2) * share * RADIUS
    inside = np.sum(x[0] * x1[1] - x[1] * x1[0]) / 2 * share
    return membrane + bending + pressure * inside, membrane, bending


def _circle_by_potential(pressure: float) -> float:
    step = 1e-30

    def slope(stretch: float) -> float:
        return float(_potential(stretch + 1j * step, (0.0, 0.0), pressure)[0].imag / step)

    return float(brentq(slope, 0.9, 1.0, xtol=1e-16, rtol=1e-15))


def _least_curvature(pressure: float, step: float) -> float:
    """Return the least eigenvalue of the second derivatives at the circle."""
    stretch, tiny = _circle_by_potential(pressure), 1e-30

    def slope(by: int, waves: Array) -> float:
        moved = waves + 1j * tiny * np.eye(2)[by]
        return float(_potential(stretch, (moved[0], moved[1]), pressure)[0].imag / tiny)

    second = [[(slope(i, step * e) - slope(i, -step * e)) / (2 * step) for e in np.eye(2)] for i in range(2)]
    return float(np.linalg.eigvalsh(np.array(second))[0])


def pressed_ring_by_potential() -> dict[str, Estimate]:
    """Values by the potential; uncertain by what the finer differences still change."""
    coarse, fine = (
        float(brentq(partial(_least_curvature, step=step), 0.5 * PRESSURE, PRESSURE, xtol=1e-10, rtol=1e-13))
        for step in STEPS
    )
    critical = fine + (fine - coarse) / 3
    half = _circle_by_potential(HALF * PRESSURE)
    _, membrane, bending = _potential(half, (0.0, 0.0), 0.0)
    energies = LENGTH / 4 * membrane.real, LENGTH / 4 * bending.real
    values = _values(critical, half, energies)
    share = {name: AGREED + (abs(critical / fine - 1) if "critical" in name else 0.0) for name in values}
    return {n: Estimate(float(v), share[n] * abs(float(v)), _unit(n)) for n, v in values.items()}
