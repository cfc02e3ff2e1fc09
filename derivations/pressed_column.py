r"""Euler's column from the non-linear path: a clamped strip under a dead force that is nearly along it, toward the wall.

It is the cantilever of `elastica`, whose wall is turned away from the force until the strip points nearly against it.
The load is sought at which the tip has moved across the strip by a given length: for a shell by the equations of
equilibrium, once more by virtual work in polynomials (`plane_strip`), and for the inextensible elastica by

    L sqrt(P / B) = K(k) - F(psi, k),  k^2 = (1 + sin phi_L) / 2,  sin^2 psi = (1 + sin phi_0) / (2 k^2),

phi_0 the wall's angle and phi_L the tip's, from the direction across the force.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.polynomial import Polynomial
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from .elastica import COARSE, FINE, STEEPEST, Cantilever, extensible
from .estimate import ROUNDING, Estimate
from .plane_strip import SPREAD, PlaneStrip

STRIP = Cantilever(length=1.0, width=0.05, thickness=2e-3, young=1.2e7)
OBLIQUE = 1e-3
"""Of the force: its part across the strip over its part along it."""
WALL = -np.arctan2(1.0, OBLIQUE)
EULER = np.pi**2 / 4 * STRIP.bending_stiffness / STRIP.length**2
"""Euler's load over the width, N/m."""
MARKS = 0.05, 0.2
RANGE = 0.9, 1.2
"""Load factors between which the tip passes all marks."""
NEAR = 1e-5 * np.arange(-2, 3)
"""Load factors about that of the elastica, of the second form."""
Tip = Callable[[float], tuple[float, float]]


def named(quantity: str, mark: float) -> str:
    """Name of a quantity of cases/pressed_column.toml."""
    return f"{quantity}_{1000 * mark:.0f}mm"


def across(shortening: float, deflection: float) -> tuple[float, float]:
    """Return deflection across the strip and shortening along it, from those by the force's direction."""
    x, z = STRIP.length - shortening, deflection
    return z * np.cos(WALL) - x * np.sin(WALL), STRIP.length - x * np.cos(WALL) - z * np.sin(WALL)


def by_equilibrium(factor: float, tolerance: float) -> tuple[float, float]:
    """Deflection and shortening of the shell at a load factor."""
    force = factor * EULER * np.hypot(1.0, OBLIQUE) * STRIP.width
    bent = extensible(STRIP, force, tolerance, WALL)
    return across(bent.shortening, bent.deflection)


def inextensible(factor: float) -> tuple[float, float]:
    """The same of the elastica, in elliptic integrals."""
    scale = np.sqrt(STRIP.bending_stiffness / (factor * EULER * np.hypot(1.0, OBLIQUE)))

    def parameters(tip: float) -> tuple[float, float]:
        m = (1 + np.sin(tip)) / 2
        return m, np.arcsin(np.sqrt((1 + np.sin(WALL)) / (2 * m)))

    def excess(tip: float) -> float:
        m, psi = parameters(tip)
        return float(scale * (ellipk(m) - ellipkinc(psi, m)) - STRIP.length)

    tip = brentq(excess, WALL + 1e-9, STEEPEST, xtol=1e-15, rtol=1e-14)
    m, psi = parameters(tip)
    lift = STRIP.length - 2 * scale * (ellipe(m) - ellipeinc(psi, m))
    reach = scale * np.sqrt(2 * (np.sin(tip) - np.sin(WALL)))
    return across(STRIP.length - reach, lift)


def _values(tip: Tip) -> Iterator[tuple[str, float, str]]:
    for mark in MARKS:
        factor = _factor(tip, mark)
        yield named("load", mark), factor, ""
    yield named("shortening", mark), tip(factor)[1], "m"


def _factor(tip: Tip, mark: float) -> float:
    return float(brentq(lambda f: tip(f)[0] - mark, *RANGE, xtol=1e-14, rtol=1e-14))


def pressed_column() -> dict[str, Estimate]:
    """Known values of cases/pressed_column.toml; the uncertainty is the change from a coarser integration."""
    fine, coarse = (list(_values(lambda f, t=t: by_equilibrium(f, t))) for t in (FINE, COARSE))  # type: ignore[misc]
    return {
        name: Estimate.between(value, other, unit, 1e4 * ROUNDING)
        for (name, value, unit), (_, other, _) in zip(fine, coarse, strict=True)
    }


def pressed_column_by_polynomials() -> dict[str, Estimate]:
    """The same by virtual work: a path through loads near each mark, and the polynomials through them there."""
    plane = PlaneStrip(STRIP.length, STRIP.thickness, STRIP.young, 20)
    near = np.array([_factor(inextensible, mark) for mark in MARKS])
    factors = np.unique(np.concatenate([np.linspace(0.1, near[-1], 20), np.add.outer(near, NEAR).ravel()]))
    path = {bent.factor: bent for bent in plane.path(factors, force=EULER * OBLIQUE, pull=-EULER)}
    values = {}
    for mark, factor in zip(MARKS, near, strict=True):
        beside = [path[f] for f in factor + NEAR]
        across_it = [bent.deflection - mark for bent in beside]
        values[named("load", mark)] = Polynomial.fit(across_it, [bent.factor for bent in beside], len(NEAR) - 1)(0.0)
    shortening = Polynomial.fit(across_it, [bent.shortening for bent in beside], len(NEAR) - 1)(0.0)
    found = {name: Estimate(float(value), 1e3 * SPREAD, "") for name, value in values.items()}
    return found | {named("shortening", mark): Estimate(float(shortening), 1e3 * SPREAD, "m")}


def elastica_of_column() -> dict[str, Estimate]:
    """The inextensible elastica: strains change the load by (h / L)^2 or so."""
    spread = 4 * (STRIP.thickness / STRIP.length) ** 2
    return {name: Estimate(value, spread, unit) for name, value, unit in _values(inextensible)}
