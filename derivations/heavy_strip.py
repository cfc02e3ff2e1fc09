r"""A clamped strip that bends under its own weight, as a shell and as the elastica: the master curve of cloth.

Romero, Ly, Rasheed, Charrondiere, Lazarus, Neukirch & Bertails-Descoubes (2021) ask cloth simulators for the shape H / W of
a strip clamped level, H its tip's drop and W its reach, as a function of Gamma = q L^3 / B alone, q the weight an area.

The plane problem of `elastica` with a weight: at the distance r from the tip the part beyond pulls down by q r a width.
With psi the angle from the vertical and the moment m = -B lambda^2 dpsi/dr,

    m' = q r lambda sin psi,  psi' = m / (B lambda^2),  A eps lambda + m^2 / (B lambda^3) = q r cos psi

(primes by r, m the moment that bends downward), psi = pi / 2 at the wall, m = 0 at the tip. Far from the wall psi is as
small as exp(-2/3 sqrt Gamma), so that the angle at the tip is sought by its logarithm. The second form is
`plane_strip`, virtual work in polynomials; the inextensible elastica is the limit of thin strips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import airy

from .elastica import COARSE, Cantilever, stretch
from .estimate import ROUNDING, Estimate
from .plane_strip import SPREAD, PlaneStrip

FINE = 1e-12
GAMMAS = 1.0, 10.0, 100.0, 1000.0
SEARCH = 0.3
"""Of the logarithm of the tip's angle: a step of the search for its root."""
POLYNOMIALS = 40
STEPS = 12
"""Of the second form: increments of the load, by equal parts of its cube root."""


def heavy() -> Cantilever:
    """The strip of cases/heavy_cantilever.toml."""
    return Cantilever(length=1.0, width=0.025, thickness=1e-3, young=1.2e7)


@dataclass(frozen=True)
class Hung:
    """Drop and reach of the tip, m; membrane and bending energy, J."""

    drop: float
    reach: float
    membrane: float
    bending: float


def hung(strip: Cantilever, gamma: float, tolerance: float = FINE, extensible: bool = True) -> Hung:
    """Equilibrium under the weight Gamma B / L^3 an area."""
    b = strip.bending_stiffness
    weight = gamma * b / strip.length**3

    def along(r: float, state: np.ndarray) -> list[float]:
        psi, moment = state[:2]
        longer = stretch(strip, moment, weight * r * np.cos(psi)) if extensible else 1.0
        turning = moment / (b * longer**2)
        membrane = strip.stretching_stiffness * (longer**2 - 1) ** 2 / 8
        across, down = longer * np.sin(psi), longer * np.cos(psi)
        return [turning, weight * r * across, down, across, membrane, b * (longer * turning) ** 2 / 2]

    def to_the_wall(logarithm: float) -> np.ndarray:
        start = [np.exp(logarithm), 0.0, 0.0, 0.0, 0.0, 0.0]
        small = tolerance * np.array([start[0], weight * start[0], 1.0, 1.0, 1.0, 1.0])
        found = solve_ivp(along, (0.0, strip.length), start, method="DOP853", rtol=tolerance, atol=small)
        return np.asarray(found.y[:, -1])

    # Small angles grow by Airy's functions, larger ones less: the strip that hangs without a loop has the least root.
    z = gamma ** (1 / 3)
    growth = np.pi * (airy(0)[3] * airy(z)[0] - airy(0)[1] * airy(z)[2])
    low = float(np.log(np.pi / 2 / growth))
    high = low + SEARCH
    while to_the_wall(high)[0] < np.pi / 2:
        low, high = high, high + SEARCH
    tip = brentq(lambda x: to_the_wall(x)[0] - np.pi / 2, low, high, xtol=tolerance, rtol=1e-14)
    drop, reach, membrane, bending = to_the_wall(tip)[2:]
    return Hung(drop, reach, membrane * strip.width, bending * strip.width)


def named(quantity: str, gamma: float) -> str:
    """Name of a quantity of cases/heavy_cantilever.toml."""
    return f"{quantity}_{gamma:g}"


def heavy_cantilever() -> dict[str, Estimate]:
    """Known values of cases/heavy_cantilever.toml; the uncertainty is the change from a coarser integration."""
    strip, values = heavy(), {}
    for gamma in GAMMAS:
        fine, coarse = (hung(strip, gamma, tolerance) for tolerance in (FINE, COARSE))
        values[named("drop", gamma)] = Estimate.between(fine.drop, coarse.drop, "m", 100 * ROUNDING * strip.length)
        back, back_coarse = strip.length - fine.reach, strip.length - coarse.reach
        values[named("shortening", gamma)] = Estimate.between(back, back_coarse, "m", 100 * ROUNDING * strip.length)
    energies = ("membrane_energy", fine.membrane, coarse.membrane), ("bending_energy", fine.bending, coarse.bending)
    return values | {name: Estimate.between(a, c, "J", 100 * ROUNDING * fine.bending) for name, a, c in energies}


def heavy_cantilever_by_polynomials() -> dict[str, Estimate]:
    """The same values by virtual work."""
    strip, values = heavy(), {}
    plane = PlaneStrip(strip.length, strip.thickness, strip.young, POLYNOMIALS)
    marks = np.unique(np.append((np.arange(1, STEPS + 1) / STEPS) ** 3, np.array(GAMMAS) / GAMMAS[-1]))
    weight = GAMMAS[-1] * strip.bending_stiffness / strip.length**3
    found = {bent.factor: bent for bent in plane.path(marks, weight=weight)}
    spread = 10 * SPREAD * strip.length
    for gamma in GAMMAS:
        bent = found[gamma / GAMMAS[-1]]
        values[named("drop", gamma)] = Estimate(-bent.deflection, spread, "m")
        values[named("shortening", gamma)] = Estimate(bent.shortening, spread, "m")
    stored = bent.membrane * strip.width, bent.bending * strip.width
    return values | {
        name: Estimate(value, 1e3 * SPREAD * stored[1], "J")
        for name, value in zip(("membrane_energy", "bending_energy"), stored, strict=True)
    }


def elastica_of_weight() -> dict[str, Estimate]:
    """The inextensible elastica: H / W of numerics' table, and what the strip's stretch may change."""
    strip, values = heavy(), {}
    for gamma in GAMMAS:
        bent, shell = hung(strip, gamma, extensible=False), hung(strip, gamma)
        values[named("drop", gamma)] = Estimate(bent.drop, 2 * abs(bent.drop - shell.drop), "m")
        values[named("shortening", gamma)] = Estimate(strip.length - bent.reach, 2 * abs(bent.reach - shell.reach), "m")
    return values
