r"""A strip bent by two moments about inclined axes, mirror images of each other: cases/inclined_moments.toml.

A moment M about the unit axis e works on the angle theta by which the normal n turns, seen along e. Where the strip bends
about y by phi, n = (sin phi, 0, cos phi), n x dn/dphi = y, and

    d theta / d phi = e . (n x dn/dphi) / (1 - (n . e)^2) = e_y / (1 - (n . e)^2).

Both axes have the same e_y and (n . e)^2. Twisting moments cancel, so that the strip is the arc of `roll_up` under the
moment 2 M e_y / (1 - (n . e)^2) at its end: one equation for the angle there.

The second form knows neither this rate nor the balance along the strip: among all arcs, of any stretch and turning, it
seeks the one of least potential, with theta from arctan2 of n and its place at rest, both seen along the axis.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq, minimize

from .estimate import Estimate
from .roll_up import Arc, Strip, energies, rolled_strip
from .surface_strains import Array

STRIP = Strip(length=2.0, width=0.5, thickness=0.1, young=1.2e6, moment=1.0)
MOMENT = 33.5  # N, of each of both
AXES = np.array([[4.0, 4.0, -2.0], [-4.0, 4.0, 2.0]]) / 6.0
POINTS = (1.0, 0.45)  # of the length: tip, middle
OBLIQUE = np.array([1.0, 2.0, -2.0]) / 3.0
LIMIT = 1.25  # rad, of the angle at the end: more than where the moment is largest
AGREED = 1e-7
"""Relative: a least potential places the arc to half of its digits."""


def normal(phi: float) -> Array:
    """Return the normal where the strip is turned by phi."""
    return np.array([np.sin(phi), 0.0, np.cos(phi)])


def rate(phi: float) -> float:
    """Return the moment of both at the end, of one each, about y."""
    return float(sum(e[1] / (1 - (normal(phi) @ e) ** 2) for e in AXES))


def angle(phi: float) -> float:
    """Return the sum of both angles on which the moments work, seen along the axes."""
    found = 0.0
    for e in AXES:
        before, after = (n - (n @ e) * e for n in (normal(0.0), normal(phi)))
        found += float(np.arctan2(np.cross(before, after) @ e, before @ after))
    return found


def arc_by_balance(factor: float) -> Arc:
    """Return the arc whose end moment is that of both moments on it."""

    def missing(phi: float) -> float:
        arc = rolled_strip(STRIP, factor * MOMENT * rate(phi))
        return arc.turning * arc.length - phi

    end = float(brentq(missing, 0.0, _end(factor), xtol=1e-15))
    return rolled_strip(STRIP, factor * MOMENT * rate(end))


def _end(factor: float) -> float:
    """Return an angle beyond the first root of the balance."""
    phi = np.linspace(0.0, LIMIT, 1001)
    arcs = [rolled_strip(STRIP, factor * MOMENT * rate(p)) for p in phi]
    beyond = [arc.turning * arc.length < p for arc, p in zip(arcs, phi, strict=True)]
    return float(phi[beyond.index(True)])


def arc_by_potential(factor: float) -> Arc:
    """Return the arc of least potential, from rest on."""

    def potential(x: Array) -> float:
        return _potential(Arc(1 + x[0] * 1e-2, x[1], STRIP.length), factor)

    start = np.array([0.0, 0.3])
    found = minimize(potential, start, method="Nelder-Mead", options={"xatol": 1e-11, "fatol": 1e-15, "maxiter": 4000})
    return Arc(1 + found.x[0] * 1e-2, found.x[1], STRIP.length)


def _potential(arc: Arc, factor: float) -> float:
    work = factor * MOMENT * STRIP.width * angle(arc.turning * arc.length)
    return sum(energies(STRIP, arc)) - work


def _values(arc_of: Callable[[float], Arc], share: float) -> dict[str, Estimate]:
    half, whole = arc_of(0.5), arc_of(1.0)

    def moved(arc: Arc, place: float) -> Array:
        part = Arc(arc.stretch, arc.turning, place * arc.length)
        return np.array([-part.shortening, 0.0, -part.deflection])

    end = whole.turning * whole.length
    values = {
        "tip_z_50": (half.deflection, "m"),
        "tip_z": (whole.deflection, "m"),
        "mean_oblique": (float(np.mean([moved(whole, p) @ OBLIQUE for p in POINTS])), "m"),
        "strain_energy": (sum(energies(STRIP, whole)), "J"),
        "potential_energy_50": (_potential(half, 0.5), "J"),
        "potential_energy": (_potential(whole, 1.0), "J"),
        "wall_moment": (MOMENT * STRIP.width * rate(end), "N m"),
    }
    return {name: Estimate(float(v), share * abs(float(v)), unit) for name, (v, unit) in values.items()}


def inclined_moments() -> dict[str, Estimate]:
    """Known values by the balance of moments; what rounding changes is a tenth of the digits that are left."""
    return _values(arc_by_balance, 1e-11)


def inclined_moments_by_potential() -> dict[str, Estimate]:
    """Values by the least potential."""
    return _values(arc_by_potential, AGREED)
