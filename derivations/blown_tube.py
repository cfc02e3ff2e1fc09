r"""A long tube under a pressure from within that follows it: a circle that grows, in closed form at finite strain.

Between its ends, which are held apart, a circle of radius R becomes one of radius r. Along it the strain is
eps = (r^2 / R^2 - 1) / 2, the change of curvature kap = (r - R) / R^2, and the energy of a unit of angle and length is
R (D eps^2 + B kap^2) / 2. The pressure p exerts p r on the radius, so that

    D eps r / R + B kap / R = p r,    D = E h / (1 - nu^2),    B = D h^2 / 12.

The second form knows the positions of points only. Interpolating polynomials give metric and curvature of the arc, and the
energy is varied along a breath and two motions that make an oval of it, by complex steps; the pressure's work on them is
that of p (x,1 cross x,2).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import brentq, fsolve

from .estimate import Estimate
from .surface_strains import Array

RADIUS, LENGTH = 1.0, 0.7  # R, m, and between the ends
YOUNG, POISSON, THICKNESS = 1e6, 0.3, 0.1
PRESSURE = 3e4  # at full load, Pa
STRETCHING = YOUNG * THICKNESS / (1 - POISSON**2)
BENDING = STRETCHING * THICKNESS**2 / 12
QUARTER = np.pi / 2
ONE, TWO = (QUARTER * s * (1 + 0.3 * s) / 1.3 for s in (0.4, 0.8))  # angles of the points that are looked at
OBLIQUE = np.array([1.0, 2.0, -2.0]) / 3
NODES = 20
COMPLEX_STEP = 1e-20
SAMPLED = 1e-11
"""Relative uncertainty of the second form: derivatives of polynomials through sampled positions."""


def radius(pressure: float) -> float:
    """Radius (m) under a pressure (Pa)."""

    def unbalanced(r: float) -> float:
        strain, bent = (r**2 / RADIUS**2 - 1) / 2, (r - RADIUS) / RADIUS**2
        return STRETCHING * strain * r / RADIUS + BENDING * bent / RADIUS - pressure * r

    return float(brentq(unbalanced, RADIUS, 2 * RADIUS, xtol=1e-15, rtol=1e-15))


def _moved(displacement: Callable[[float], Array], largest: float) -> dict[str, float]:
    return {
        "growth": float(displacement(QUARTER)[2]),
        "mean_oblique": float((displacement(ONE) + displacement(TWO)) @ OBLIQUE) / 2,
        "largest_displacement": largest,
    }


def blown_tube() -> dict[str, Estimate]:
    """Known values of cases/blown_tube.toml."""
    r = radius(PRESSURE)
    strain, bent = (r**2 / RADIUS**2 - 1) / 2, (r - RADIUS) / RADIUS**2
    area = RADIUS * QUARTER * LENGTH
    membrane, bending = area * STRETCHING * strain**2 / 2, area * BENDING * bent**2 / 2
    moved = _moved(lambda at: (r - RADIUS) * np.array([np.cos(at), 0.0, np.sin(at)]), r - RADIUS)
    energies = {"strain_energy": membrane + bending, "membrane_energy": membrane, "bending_energy": bending}
    return {
        name: Estimate(value, 1e-13 * abs(value), unit)
        for values, unit in ((moved, "m"), (energies, "J"))
        for name, value in values.items()
    }


# --- the second form ---------------------------------------------------------------------------------


@cache
def _rule() -> tuple[Array, Array, Array]:
    """Angles of the points, weights, and the matrix of derivatives of the polynomial through values there."""
    t, weights = np.polynomial.legendre.leggauss(NODES)
    basis = [np.polynomial.Legendre.basis(k) for k in range(NODES)]
    values, slopes = np.array([b(t) for b in basis]).T, np.array([b.deriv()(t) for b in basis]).T
    return QUARTER / 2 * (1 + t), QUARTER / 2 * weights, slopes @ np.linalg.inv(values) / (QUARTER / 2)


def _positions(angle: Array, motion: Array) -> Array:
    """Positions (n, 2) of a breath and two ovals, along and across."""
    out = RADIUS + motion[0] + motion[1] * np.cos(2 * angle)
    aside = motion[2] * np.sin(2 * angle)
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([out * cos - aside * sin, out * sin + aside * cos], axis=-1)


def _energies(motion: Array) -> tuple[complex, complex]:
    """Membrane and bending energy, J, of a complex motion too."""
    angle, weights, slope = _rule()
    found = []
    for x in (_positions(angle, np.zeros(3)), _positions(angle, motion)):
        first = slope @ x
        second = slope @ first
        metric = np.sum(first**2, axis=-1)
        found.append((metric, (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / np.sqrt(metric)))
    (metric, curved), (stretched, bent) = found
    area = weights * np.sqrt(metric) * LENGTH
    strain, change = (stretched - metric) / 2 / metric, (bent - curved) / metric
    return complex(area @ (STRETCHING * strain**2 / 2)), complex(area @ (BENDING * change**2 / 2))


def _state(pressure: float) -> Array:
    angle, weights, slope = _rule()
    directions = np.eye(3)

    def unbalanced(motion: Array) -> Array:
        first = slope @ _positions(angle, motion)
        push = pressure * LENGTH * weights[:, None] * np.stack([first[:, 1], -first[:, 0]], axis=-1)
        inner = [sum(_energies(motion + 1j * COMPLEX_STEP * d)).imag / COMPLEX_STEP for d in directions]
        moved = [_positions(angle, d) - _positions(angle, np.zeros(3)) for d in directions]
        return np.array([i - np.sum(push * m) for i, m in zip(inner, moved, strict=True)]) / pressure

    found, _, good, words = fsolve(unbalanced, np.array([0.1 * RADIUS, 0.0, 0.0]), xtol=1e-14, full_output=True)
    if good != 1 and np.abs(unbalanced(found)).max() > SAMPLED:
        raise RuntimeError(f"no equilibrium of the sampled tube: {words}")
    return np.asarray(found)


def blown_tube_by_samples() -> dict[str, Estimate]:
    """Values of the tube from positions of points."""
    whole = _state(PRESSURE)
    membrane, bending = (part.real for part in _energies(whole))

    def displacement(at: float) -> Array:
        x, z = (_positions(np.array([at]), whole) - _positions(np.array([at]), np.zeros(3)))[0]
        return np.array([x, 0.0, z])

    lengths = _moved(displacement, float(np.linalg.norm(displacement(0.0))))
    energies = {"strain_energy": membrane + bending, "membrane_energy": membrane, "bending_energy": bending}
    return {
        name: Estimate(float(value), 1e1 * SAMPLED * abs(value), unit)
        for values, unit in ((lengths, "m"), (energies, "J"))
        for name, value in values.items()
    }
