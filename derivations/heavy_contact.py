r"""A heavy strip that is clamped level above a rigid floor, and whose end lies flat on it: cases/contact_heavy_strip.toml.

Without friction nothing pulls along x. With s from the wall, theta the angle below the horizon, a the length that hangs
free and R the line force a width where contact begins, the strip beyond s pulls down by V = q (a - s) - R, and

    m' = -lambda V cos theta,  theta' = m / (B lambda^2),  depth' = lambda sin theta,  reach' = lambda cos theta

with the moment and the stretch lambda of `elastica`, the pull along the strip being V sin theta. At a depth and angle are the floor's, and m = 0: nothing bends what lies flat, and only V jumps. That is
what gives a. Beyond, the floor carries the weight.

The second form has neither forces nor moments: the inextensible strip's angle is a polynomial over an unknown length
that makes its energy least, at the depth of the floor.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import root

from .elastica import Cantilever, stretch
from .estimate import Estimate

Array = np.ndarray

STRIP = Cantilever(length=1.0, width=0.05, thickness=1e-3, young=1.2e7)
WEIGHT, DEPTH = 0.1, 0.4
"""Of the strip, N/m^2, and of the floor below the wall, m."""
COLLOCATED, STRETCHED = 1e-9, 1e-6
"""Relative errors: of the collocation, and of taking no stretch, which is q L / A = 8e-6 where most is hung."""
POLYNOMIALS, GAUSS = 14, 60


def heavy_strip_on_floor() -> dict[str, Estimate]:
    """Known values by the equations of equilibrium with a free boundary."""
    b = STRIP.bending_stiffness

    def rates(x: Array, y: Array, p: Array) -> Array:
        theta, m = y[2], y[3]
        shear = WEIGHT * p[0] * (1 - x) - p[1]
        longer = stretch(STRIP, m, shear * np.sin(theta))
        bending = m**2 / (2 * b * longer**2)
        down, along, turning = longer * np.sin(theta), longer * np.cos(theta), m / (b * longer**2)
        return p[0] * np.stack([down, along, turning, -longer * shear * np.cos(theta), bending])

    def ends(start: Array, end: Array, p: Array) -> Array:
        return np.array([start[0], start[1], start[2], start[4], end[0] - DEPTH, end[2], end[3]])

    x = np.linspace(0, 1, 41)
    guess = np.stack([DEPTH * x**2 * (3 - 2 * x), 0.8 * x, np.sin(np.pi * x), 4 * b * np.cos(np.pi * x), 0 * x])
    found = solve_bvp(rates, ends, x, guess, p=[0.8, 0.02], tol=COLLOCATED, max_nodes=50_000)
    if not found.success:
        raise ArithmeticError(found.message)
    a, line = (float(v) for v in found.p)
    reach, bending = (float(v) for v in found.y[[1, 4], -1])
    return _asked(a, line, reach, bending, 10 * COLLOCATED)


def heavy_strip_by_energy() -> dict[str, Estimate]:
    """The same of an inextensible strip, by the least energy of its angle."""
    b, length = STRIP.bending_stiffness, STRIP.length
    x, w = np.polynomial.legendre.leggauss(GAUSS)
    s, w = (1 + x) / 2, w / 2
    basis = [np.polynomial.Chebyshev.basis(k, domain=[0.0, 1.0]) for k in range(POLYNOMIALS)]
    ramp = np.polynomial.Chebyshev.fit([0.0, 0.5, 1.0], [0.0, 0.25, 0.0], 2, domain=[0.0, 1.0])  # s (1 - s)
    shapes = [ramp * one for one in basis]
    values, slopes = (np.stack([f(s) for f in part], axis=-1) for part in (shapes, [f.deriv() for f in shapes]))

    def energy(p: Array) -> tuple[float, Array]:
        """Energy a width over B / L, and its gradient by the coefficients and the free length."""
        # the weight's potential: each place s hangs DEPTH below the wall less what sinks beyond it, all in the sum
        # of q (a - s) depth' = q a^2 (1 - s) sin theta over the free length, and q (L - a) DEPTH of what lies flat
        c, a = p[:-1], p[-1]
        theta, turning = values @ c, slopes @ c
        bent, hung = float(w @ turning**2) / 2, float(w @ ((1 - s) * np.sin(theta)))
        found = b * bent / a - WEIGHT * (a**2 * hung + (length - a) * DEPTH)
        by_c = b / a * (w * turning) @ slopes - WEIGHT * a**2 * (w * (1 - s) * np.cos(theta)) @ values
        by_a = -b * bent / a**2 - WEIGHT * (2 * a * hung - DEPTH)
        return found / b, np.append(by_c, by_a) / b

    def depth(p: Array) -> float:
        return float(p[-1] * (w @ np.sin(values @ p[:-1])) - DEPTH)

    def depth_rate(p: Array) -> Array:
        theta = values @ p[:-1]
        return np.append(p[-1] * (w * np.cos(theta)) @ values, w @ np.sin(theta))

    start = np.zeros(POLYNOMIALS + 1)
    start[0], start[-1] = 3.0, 0.8

    # Where energy is least at a given depth its gradient is that of the depth times a multiplier.
    def least(p: Array) -> Array:
        return np.append(energy(p[:-1])[1] - p[-1] * depth_rate(p[:-1]), depth(p[:-1]))

    found = root(least, np.append(start, 0.0), tol=1e-14)
    if not np.abs(least(found.x)).max() < STRETCHED:
        raise ArithmeticError("no least energy was found")
    c, a = found.x[:-2], float(found.x[-2])
    gradient, rate = energy(found.x[:-1])[1] * b, depth_rate(found.x[:-1])
    line = float(-gradient @ rate / (rate @ rate))  # what holds the end of the free length at its depth
    reach, bending = a * float(w @ np.cos(values @ c)), b * float(w @ (slopes @ c) ** 2) / (2 * a)
    return _asked(a, line, reach, bending, 20 * STRETCHED)


def _asked(a: float, line: float, reach: float, bending: float, error: float) -> dict[str, Estimate]:
    """Return the values of a strip: free length, line force a width, reach of the free part, bending energy a width."""
    floor = STRIP.width * (line + WEIGHT * (STRIP.length - a))
    values = {
        "contact_point": (a, "m"),
        "contact_force": (floor, "N"),
        "wall_force": (STRIP.width * WEIGHT * STRIP.length - floor, "N"),
        "tip_shortening": (a - reach, "m"),
        "bending_energy": (STRIP.width * bending, "J"),
    }
    found = {name: Estimate(value, error * abs(value), unit) for name, (value, unit) in values.items()}
    return {**found, "penetration": Estimate(0.0, 1e-12, "m")}


JUDGES = {"contact_heavy_strip": heavy_strip_on_floor}
SECOND_FORMS = {"contact_heavy_strip": heavy_strip_by_energy}
