r"""A flat ring, tilted at its clamped hub and guided at its rim: cases/guided_ring.toml.

On a < r < b let w = sum_n w_n(r) cos n theta, and the like with sines. With D = w_n'' + w_n' / r - n^2 w_n / r^2 (Timoshenko
and Woinowsky-Krieger, sections 62 and 63), moment and Kirchhoff's shear force on a circle are

    M = -B (w_n'' + nu (w_n' / r - n^2 w_n / r^2)),    V = -B (D' - (1 - nu) n^2 / r^2 (w_n' - w_n / r)).

The hub gives w_n and w_n' at a: those of phi e x (x - c), which for a tilt have n = 0 and 1. At the rim w_n' = 0, and V is
the pressing force. Between two circles acts a pressure p_n, of n = 0 and 2. `guided_ring`, the judge, joins the solutions of
D D w = p_n / B in closed form at both circles. The energy is half of what loads and hub work on the ring. In its plane the
ring moves with the hub, and nothing strains it.

The second form is Ritz's method: Hermite's polynomials between the circles, of which the hub holds the first two, and the
slope at the rim; the moment of the hub is the derivative of the energy by the tilt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Chebyshev, legendre

from .estimate import Estimate

A, C, D, B = 1.0, 1.37, 1.73, 2.0  # hub, both circles, rim, m
YOUNG, POISSON, THICKNESS = 2e11, 0.3, 0.02
STIFFNESS = YOUNG * THICKNESS**3 / 12 / (1 - POISSON**2)  # B, N m
PRESSURE = {0: -3000.0, 2: -1500.0}  # p_n along z, of the cosines: the normal is -z
FORCE, FIRST, LAST = -4000.0, np.radians(190.0), np.radians(280.0)  # N/m, of the squared sine
AXIS, CENTRE, TILT = np.array([0.6, 0.8, 0.0]), np.array([0.2, -0.5, -2.0]), np.radians(0.01)
POINTS = ((231.0, 2.0), (77.0, 1.6), (301.0, 1.85), (-20.0, 1.3))  # degrees and radius: pressed, one, two, three
HARMONICS = 32, 64
ROUNDING = 1e-10
"""Relative: squares of the last harmonics' factors r^n cancel."""

Array = np.ndarray
Radial = Callable[[Array, int], Array]
"""Derivatives of a radial function at radii."""


def pressed(n: int) -> tuple[float, float]:
    """Return the coefficients of cos n theta and sin n theta of the force on the rim, N/m, by Gauss's rule."""
    nodes, weights = legendre.leggauss(200)
    angles = FIRST + (LAST - FIRST) * (nodes + 1) / 2
    share = FORCE * np.sin(2 * (angles - FIRST)) ** 2 * weights * (LAST - FIRST) / 2 / (np.pi * (2 if n == 0 else 1))
    return float(share @ np.cos(n * angles)), float(share @ np.sin(n * angles))


def tilted(n: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return displacement and slope of the hub in cos n theta and sin n theta, for a tilt of one."""
    if n == 0:  # e_x (y - c_y) - e_y (x - c_x)
        return (float(AXIS[1] * CENTRE[0] - AXIS[0] * CENTRE[1]), 0.0), (0.0, 0.0)
    if n == 1:
        return (-AXIS[1] * A, -AXIS[1]), (AXIS[0] * A, AXIS[0])
    return (0.0, 0.0), (0.0, 0.0)


# --- closed form -------------------------------------------------------------------------------------


def _power(r: Array, exponent: int, order: int, log: bool, scale: float) -> Array:
    """Derivative of (r / scale)^m, or of it times log r."""
    r = np.asarray(r, dtype=float)
    factor, of_log = 1.0, 0.0  # of r^(m - k) log r and r^(m - k)
    for k in range(order):
        factor, of_log = factor * (exponent - k), of_log * (exponent - k) + factor
    value = (r / scale) ** exponent * r ** (-order)
    return np.asarray(value * (factor * np.log(r) + of_log if log else factor))


def _solutions(n: int) -> list[Radial]:
    """Return the four solutions of D D w = 0."""
    kinds = {0: [(0, False), (0, True), (2, False), (2, True)], 1: [(1, False), (-1, False), (3, False), (1, True)]}
    given = kinds.get(n, [(n, False), (n + 2, False), (-n, False), (2 - n, False)])
    return [lambda r, k, m=m, log=log: _power(r, m, k, log, B if m > 0 else A) for m, log in given]


def _particular(n: int) -> Radial:
    """Return a solution of D D w = 1, for n = 0 and 2."""
    if n == 0:
        return lambda r, k: _power(r, 4, k, False, 1.0) / 64
    return lambda r, k: _power(r, 4, k, True, 1.0) / 48


def moment(w: Radial, n: int, r: float) -> float:
    """M on a circle."""
    at = np.array(r)
    return float(-STIFFNESS * (w(at, 2) + POISSON * (w(at, 1) / r - n**2 * w(at, 0) / r**2)))


def shear(w: Radial, n: int, r: float) -> float:
    """V on a circle."""
    at = np.array(r)
    bend = w(at, 3) + w(at, 2) / r - w(at, 1) / r**2 - n**2 * (w(at, 1) / r**2 - 2 * w(at, 0) / r**3)
    return float(-STIFFNESS * (bend - (1 - POISSON) * n**2 / r**2 * (w(at, 1) - w(at, 0) / r)))


@dataclass(frozen=True)
class Harmonic:
    """One harmonic: n, whether of sines, and the radial function of each of three rings, by derivatives."""

    n: int
    sine: bool
    rings: tuple[Radial, Radial, Radial]

    def __call__(self, r: Array, order: int) -> Array:
        """Derivative at radii."""
        r = np.asarray(r, dtype=float)
        first, second, third = (ring(r, order) for ring in self.rings)
        return np.where(r < C, first, np.where(r < D, second, third))

    def around(self, theta: Array) -> Array:
        """The harmonic at angles."""
        return np.sin(self.n * theta) if self.sine else np.cos(self.n * theta)


def _harmonic(n: int, sine: bool, force: float, pressure: float, hub: tuple[float, float]) -> Harmonic:
    """Join the three rings' solutions, of hub values and slopes, force at the rim and pressure between the circles."""
    basis = _solutions(n)
    special: Radial = _particular(n) if pressure else lambda r, _: np.zeros_like(r)
    rows, right = [], []

    def row(ring: int, values: list[float]) -> Array:
        return np.concatenate([values if k == ring else np.zeros(4) for k in range(3)])

    for order in (0, 1):
        rows.append(row(0, [float(f(np.array(A), order)) for f in basis]))
        right.append(hub[order])
    for place, inner, sign in ((C, 0, 1.0), (D, 1, -1.0)):
        for order in range(4):
            here = [float(f(np.array(place), order)) for f in basis]
            rows.append(row(inner, here) - row(inner + 1, here))
            right.append(sign * pressure / STIFFNESS * float(special(np.array(place), order)))
    rows.append(row(2, [float(f(np.array(B), 1)) for f in basis]))
    rows.append(row(2, [shear(f, n, B) for f in basis]))
    right += [0.0, force]
    matrix = np.array(rows)
    scale = np.abs(matrix).max(axis=1)
    found = np.linalg.solve(matrix / scale[:, None], np.array(right) / scale).reshape(3, 4)

    def ring(number: int) -> Radial:
        def value(r: Array, order: int) -> Array:
            w = sum(c * f(r, order) for c, f in zip(found[number], basis, strict=True))
            return np.asarray(w + (pressure / STIFFNESS * special(r, order) if number == 1 else 0.0))

        return value

    return Harmonic(n, sine, (ring(0), ring(1), ring(2)))


@cache
def harmonics(count: int) -> tuple[Harmonic, ...]:
    """Return all harmonics up to a number."""
    found = []
    for n in range(count + 1):
        for sine, force, hub in zip((False, True), pressed(n), tilted(n), strict=True):
            if n or not sine:
                moved = TILT * hub[0], TILT * hub[1]
                found.append(_harmonic(n, sine, force, 0.0 if sine else PRESSURE.get(n, 0.0), moved))
    return tuple(found)


def _named(
    deflection: Callable[[Array, Array], Array], energy: float, work: float, hub: tuple[float, float]
) -> dict[str, float]:
    """Values from the deflection at radii and angles, energy, work of the loads, force and moment of the hub."""
    angles, radii = np.radians([p[0] for p in POINTS]), np.array([p[1] for p in POINTS])
    w = deflection(radii, angles)
    arm = -CENTRE[2]
    slide = TILT * arm * np.array([AXIS[1], -AXIS[0]])
    # The rim does not turn, and goes down farthest where it is pressed: the least of an interpolant over its angles.
    rim = Chebyshev.interpolate(lambda a: deflection(np.full(len(a), B), a), 40, domain=[FIRST, LAST])
    still = rim.deriv().roots()
    lowest = float(rim(still[np.isreal(still) & (still.real > FIRST) & (still.real < LAST)].real).min())
    return {
        "rim_deflection": -float(w[0]),
        "mean_oblique": float(np.mean(np.array([1.0, 2.0]) @ slide / 3 - 2 * w[1:] / 3)),
        "largest_displacement": float(np.hypot(np.linalg.norm(slide), lowest)),
        "strain_energy": energy,
        "bending_energy": energy,
        "potential_energy": energy - work,
        "hub_force": hub[0],
        "hub_moment": hub[1],
    }


UNITS = {"hub_force": "N", "hub_moment": "N m", "strain_energy": "J", "bending_energy": "J", "potential_energy": "J"}


def _by_joining(count: int) -> dict[str, float]:
    parts = [part for part in harmonics(HARMONICS[-1]) if part.n <= count]
    nodes, weights = legendre.leggauss(20)
    r, dr = (C + D + (D - C) * nodes) / 2, weights * (D - C) / 2
    work, torque, force = 0.0, 0.0, 0.0
    for part in parts:
        turn = 2 * np.pi if part.n == 0 else np.pi
        work += turn * B * pressed(part.n)[part.sine] * float(part(np.array(B), 0))
        if not part.sine and part.n in PRESSURE:
            work += turn * PRESSURE[part.n] * float(dr @ (r * part(r, 0)))
        if part.n < 2:
            value, slope = tilted(part.n)[part.sine]
            up, bend = shear(part, part.n, A), moment(part, part.n, A)
            torque -= turn * A * (up * value - bend * slope)
            force -= turn * A * up if part.n == 0 else 0.0

    def deflection(radii: Array, angles: Array) -> Array:
        return np.asarray(sum(part(radii, 0) * part.around(angles) for part in parts))

    return _named(deflection, (work + TILT * torque) / 2, work, (force, torque))


def guided_ring() -> dict[str, Estimate]:
    """Known values by the closed form; uncertain by what fewer harmonics change."""
    coarse, fine = (_by_joining(count) for count in HARMONICS)
    return {n: Estimate.between(v, coarse[n], UNITS.get(n, "m"), ROUNDING * abs(v)) for n, v in fine.items()}


# --- the second form ---------------------------------------------------------------------------------

ELEMENTS = 6, 9  # in each of the three rings
DEGREE = 7


@dataclass(frozen=True)
class Rings:
    """Elements with polynomials of their own, joined by values and slopes at their ends."""

    ends: Array

    def table(self, r: Array, order: int) -> Array:
        """Derivatives (n, functions): value and slope at each end of an element, and polynomials that have neither."""
        count, bubbles = len(self.ends) - 1, DEGREE - 3
        result = np.zeros((len(r), 2 * (count + 1) + bubbles * count))
        element = np.clip(np.searchsorted(self.ends, r, side="right") - 1, 0, count - 1)
        size = np.diff(self.ends)[element]
        s = 2 * (r - self.ends[element]) / size - 1
        unit = np.eye(DEGREE + 1)
        hermite = [[2, -3, 0, 1], [1, -1, -1, 1], [2, 3, 0, -1], [-1, -1, 1, 1]]  # times 4, ascending powers of s
        for k, powers in enumerate(hermite):
            value = np.polynomial.polynomial.polyval(s, np.polynomial.polynomial.polyder(powers, order)) / 4
            result[np.arange(len(r)), 2 * (element + k // 2) + k % 2] = (
                value * (2 / size) ** order * (size / 2 if k % 2 else 1.0)
            )
        for k in range(bubbles):
            series = legendre.legint(legendre.legint(unit[k + 2], lbnd=-1), lbnd=-1)
            value = legendre.legval(s, legendre.legder(series, order)) * (2 / size) ** order
            result[np.arange(len(r)), 2 * (count + 1) + element * bubbles + k] = value
        return result


def _by_ritz(elements: int, count: int) -> dict[str, float]:
    rings = Rings(np.unique(np.concatenate([np.linspace(a, b, elements + 1) for a, b in ((A, C), (C, D), (D, B))])))
    nodes, weights = legendre.leggauss(DEGREE + 5)
    r = (rings.ends[:-1, None] + np.diff(rings.ends)[:, None] * (nodes + 1) / 2).ravel()
    dr = (np.diff(rings.ends)[:, None] * weights / 2).ravel()
    w, first, second = (rings.table(r, k) for k in range(3))
    at_rim = rings.table(np.array([B]), 0)[0]
    inside = np.where((r > C) & (r < D), dr * r, 0.0)
    last = 2 * len(rings.ends) - 1
    held, free = [0, 1, last], np.setdiff1d(np.arange(w.shape[1]), [0, 1, last])
    energy, work, torque, force, parts = 0.0, 0.0, 0.0, 0.0, []
    for n in range(count + 1):
        turn = 2 * np.pi if n == 0 else np.pi
        round_, twist = first / r[:, None] - n**2 * w / r[:, None] ** 2, n * (first - w / r[:, None]) / r[:, None]
        trace, rr = second + round_, dr * r

        def product(one: Array, two: Array, rr: Array = rr) -> Array:
            return (one * rr[:, None]).T @ two

        mixed = product(second, round_)
        matrix = product(trace, trace) - (1 - POISSON) * (mixed + mixed.T - 2 * product(twist, twist))
        matrix *= STIFFNESS * turn
        for sine, load, hub in zip((False, True), pressed(n), tilted(n), strict=True):
            if sine and n == 0:
                continue
            right = turn * load * B * at_rim
            if not sine and n in PRESSURE:
                right = right + turn * PRESSURE[n] * inside @ w
            q = np.zeros(len(right))
            q[held] = TILT * hub[0], TILT * hub[1], 0.0
            q[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free] - matrix[np.ix_(free, held)] @ q[held])
            out = matrix @ q - right  # what holds the ring, on its first degrees of freedom
            torque += float(out[0] * hub[0] + out[1] * hub[1])
            force += float(out[0]) if n == 0 else 0.0
            energy += float(q @ matrix @ q) / 2
            work += float(q @ right)
            parts.append((n, sine, q))

    def deflection(radii: Array, angles: Array) -> Array:
        at = rings.table(radii, 0)
        return np.asarray(sum(at @ q * (np.sin(n * angles) if sine else np.cos(n * angles)) for n, sine, q in parts))

    return _named(deflection, energy, work, (force, torque))


def guided_ring_by_ritz() -> dict[str, Estimate]:
    """Known values by Ritz's method; uncertain by what fewer elements and harmonics change."""
    coarse, fine = (
        _by_ritz(elements, count) for elements, count in zip(ELEMENTS, (HARMONICS[0], HARMONICS[0] * 2), strict=True)
    )
    return {n: Estimate.between(v, coarse[n], UNITS.get(n, "m"), 10 * ROUNDING * abs(v)) for n, v in fine.items()}
