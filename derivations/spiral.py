r"""A cantilever strip under a pressure that follows its normal: the plane problem of the shell theory, and a spiral.

With x' = lambda t along the reference length, t = (cos phi, sin phi) and n = (-sin phi, cos phi), the strip's energy
per width is that of `elastica`. The pressure p exerts p lambda n per reference length. Let R be the force that the part
toward the tip exerts on a section, T = R . t, Q = R . n, and m = B lambda^2 phi' the moment. Virtual work gives
R' = -p lambda n, m' = -lambda Q and T = A eps lambda + m^2 / (B lambda^3), so that

    phi' = m / (B lambda^2),  m' = -lambda Q,  T' = Q phi',  Q' = -p lambda - T phi',

with m = T = Q = 0 at the tip. The angle is in none of the right-hand sides: `extensible` integrates from the tip to the
wall once, and turns the outcome until the wall is level. No search is needed, and there is one equilibrium.

By R' = -p lambda n the force on a section is p times its distance d from the tip, and the moment is p d^2 / 2.
`spiral` is the second form. Without stretch the curvature at a distance d from the tip is p d^2 / (2 B), so that the
radius from the tip and the tangent make an angle psi with sin psi = (d / a)^3, a^3 = 8 B / p. The strip is an arc of the
sinusoidal spiral d^3 = a^3 sin 3 theta, Kiepert's curve. With d the distance of the wall from the tip,

    L = int_0^d dr / sqrt(1 - (r / a)^6),  deflection = d (d / a)^3,  shortening = L - d sqrt(1 - (d / a)^6).

The integral is d times the hypergeometric function F(1/6, 1/2; 7/6; (d / a)^6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import hyp2f1

from .elastica import COARSE, FINE, Cantilever, stretch
from .estimate import ROUNDING, Estimate

PRESSURES = 0.25, 0.5, 1.0
"""Pressures (N/m^2) that quantities are asked at: the deflections are .3, .56 and .83 of the length."""


@dataclass(frozen=True)
class Bent:
    """Displacement of the tip toward the wall and along the pressure (m), energies (J) and the wall's moment (N m)."""

    shortening: float
    deflection: float
    membrane: float
    bending: float
    moment: float


def extensible(strip: Cantilever, pressure: float, tolerance: float = FINE) -> Bent:
    """Equilibrium of the plane problem under a pressure (N/m^2) on the deformed strip."""
    b = strip.bending_stiffness

    def along(_: float, state: np.ndarray) -> list[float]:
        """Derivatives of T, Q, m, phi, x, z and of both energies from the tip to the wall."""
        pull, shear, moment, phi = state[:4]
        longer = stretch(strip, moment, pull)
        turning = moment / (b * longer**2)
        membrane = strip.stretching_stiffness * (longer**2 - 1) ** 2 / 8
        force = [-shear * turning, pressure * longer + pull * turning, longer * shear]
        place = [-turning, -longer * np.cos(phi), -longer * np.sin(phi)]
        return [*force, *place, membrane, b * (longer * turning) ** 2 / 2]

    solution = solve_ivp(along, (0.0, strip.length), np.zeros(8), method="DOP853", rtol=tolerance, atol=tolerance)
    _, _, moment, phi, x, z, membrane, bending = solution.y[:, -1]
    # The tip is at the origin and level so far. Seen from the wall it is at -(x, z), turned by -phi.
    along_wall = -(x * np.cos(phi) + z * np.sin(phi))
    across = x * np.sin(phi) - z * np.cos(phi)
    energies = membrane * strip.width, bending * strip.width
    return Bent(strip.length - along_wall, across, *energies, moment * strip.width)


def spiral(strip: Cantilever, pressure: float) -> tuple[float, float]:
    """Shortening and deflection (m) of the inextensible strip: an arc of Kiepert's curve.

    Raises
    ------
    ValueError
        If the strip is longer than the curve's arc from the tip to where it is farthest.
    """
    a = np.cbrt(8 * strip.bending_stiffness / pressure)

    def excess(share: float) -> float:
        return float(a * share * hyp2f1(1 / 6, 1 / 2, 7 / 6, share**6) - strip.length)

    if excess(1.0) < 0:
        raise ValueError(f"at a pressure of {pressure:g} the strip is longer than the arc")
    share = brentq(excess, 0.0, 1.0, xtol=1e-15, rtol=1e-14)
    return float(strip.length - a * share * np.sqrt(1 - share**6)), float(a * share**4)


def kiepert() -> dict[str, Estimate]:
    """Values of the inextensible strip; the uncertainty bounds what the stretch changes, as in `elastica`."""
    strip = Cantilever()
    values = {}
    for pressure in PRESSURES:
        shortening, deflection = spiral(strip, pressure)
        bend = pressure * ((strip.length - shortening) ** 2 + deflection**2) / (2 * strip.bending_stiffness)
        spread = (strip.thickness * bend) ** 2 / 4 * strip.length
        values[named("shortening", pressure)] = Estimate(shortening, spread, "m")
        values[named("deflection", pressure)] = Estimate(deflection, spread, "m")
    return values


def named(kind: str, pressure: float) -> str:
    """Name of a quantity at a pressure, which it gives in percent of the largest."""
    return f"{kind}_{100 * pressure / PRESSURES[-1]:.0f}"


def cantilever_pressure() -> dict[str, Estimate]:
    """Known values of the strip under a pressure; the uncertainty is the change from a coarser integration."""
    strip = Cantilever()
    values = {}
    for pressure in PRESSURES:
        fine, coarse = (extensible(strip, pressure, tolerance) for tolerance in (FINE, COARSE))
        for kind in ("shortening", "deflection"):
            near, far = getattr(fine, kind), getattr(coarse, kind)
            values[named(kind, pressure)] = Estimate.between(near, far, "m", 100 * ROUNDING * strip.length)
    rounding = 100 * ROUNDING * fine.bending
    total = fine.membrane + fine.bending
    return values | {
        "strain_energy": Estimate.between(total, coarse.membrane + coarse.bending, "J", rounding),
        "wall_moment": Estimate.between(fine.moment, coarse.moment, "N m", 100 * ROUNDING * fine.moment),
    }
