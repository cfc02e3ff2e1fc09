r"""A long oval tube under a pressure from outside that follows it: cases/pressed_oval.toml, a quarter of its section.

Between its ends, which are held apart, each section is a curve x(s), s its length at rest. With the stretch lambda and the
angle theta of its tangent t, which is Theta at rest,

    W = C eps^2 / 2 + D kap^2 / 2,   eps = (lambda^2 - 1) / 2,   kap = lambda theta' - Theta',   C = E h / (1 - nu^2),

D = C h^2 / 12, h of the place, as x'' . n = lambda theta'. Stationary is W less the work of the pressure p, F the forces that
join the parts of the curve and M their moment:

    M = lambda D kap,   M' = -lambda F . n,   F' = -p lambda n,   C eps lambda + D kap theta' = F . t,

n inward. On both planes of symmetry theta keeps its value, and one part of x and of F is zero each. The judge solves this by
collocation.

The second form knows positions alone: W is varied, and works as much as p does on the area that the curve sweeps, among sums
of harmonics that keep both symmetries.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.optimize import root

from .estimate import Estimate
from .surface_strains import Array

AXES = 1.06, 0.94  # half of the section's width and height, m
LENGTH = 0.4 * np.sinh(1.0)
YOUNG, POISSON, THICKNESS, THICKER = 1e6, 0.3, 0.1, 0.1
PRESSURE = 290.0  # at full load, Pa
QUARTER = np.pi / 2
ONE, TWO = (QUARTER * s * (1 + 0.3 * s) / 1.3 for s in (0.2, 0.6))  # angles of the points that are looked at
OBLIQUE = np.array([1.0, 2.0, -2.0]) / 3
HARMONICS = 11, 14
"""Of the second form, coarser and finer."""
GAUSS = 60
NODES = 32, 44
"""Of the collocation, coarser and finer."""
ROUNDING = 1e-11
STEPS = 0.5, 0.7, 0.8, 0.9, 0.95, 1.0  # of the pressure, on the way


def stiffness(phi: Array) -> tuple[Array, Array]:
    """Return C, N/m, and D, N m, at angles (n,)."""
    thickness = THICKNESS * (1 + THICKER * np.cos(4 * np.asarray(phi)))
    stretching = YOUNG * thickness / (1 - POISSON**2)
    return stretching, stretching * thickness**2 / 12


def at_rest(phi: Array) -> tuple[Array, Array, Array]:
    """Return the position (2, n), m, its derivative and its second one by the angle (n,)."""
    (a, b), c, s = AXES, np.cos(phi), np.sin(phi)
    return np.array([a * c, b * s]), np.array([-a * s, b * c]), np.array([-a * c, -b * s])


def _turned(vectors: Array) -> Array:
    """Return vectors (2, n) turned by a quarter, from the tangent to the inward normal."""
    return np.array([-vectors[1], vectors[0]])


def _named(parts: dict[str, float], moved: Array, largest: float) -> dict[str, float]:
    one, two = (np.array([u[0], 0.0, u[1]]) for u in moved.T)
    return {"mean_oblique": float((one + two) @ OBLIQUE) / 2, "largest_displacement": largest} | parts


def unit(name: str) -> str:
    """Return the unit of a quantity."""
    return "J" if name.endswith("energy") else "m"


# --- balance ------------------------------------------------------------------------------------------


def _stretch(phi: Array, force: Array, moment: Array, turn: Array) -> tuple[Array, Array, Array]:
    """Return lambda, kap and theta' from the force along the tangent and the moment; `turn` is Theta'."""
    stretching, bending = stiffness(phi)
    found = np.ones_like(force)
    for _ in range(30):  # Newton's method; d by a difference would do, too
        kap = moment / (bending * found)
        rate = (kap + turn) / found
        value = stretching * found * (found**2 - 1) / 2 + bending * kap * rate - force
        slope = stretching * (3 * found**2 - 1) / 2 - bending * kap * (3 * kap + 2 * turn) / found**2
        found = found - value / slope
    kap = moment / (bending * found)
    return found, kap, (kap + turn) / found


def _rates(phi: Array, y: Array, pressure: float) -> Array:
    _, first, second = at_rest(phi)
    speed = np.linalg.norm(first, axis=0)
    turn = np.sum(second * _turned(first), axis=0) / speed**3
    tangent = np.array([np.cos(y[2]), np.sin(y[2])])
    normal = _turned(tangent)
    stretch, _, rate = _stretch(phi, np.sum(y[3:5] * tangent, axis=0), y[5], turn)
    bent = -stretch * np.sum(y[3:5] * normal, axis=0)
    return np.asarray(speed * np.array([*(stretch * tangent), rate, *(-pressure * stretch * normal), bent]))


def _energies(phi: Array, y: Array) -> Array:
    """Return membrane and bending energy (2, n) of a unit of angle and length."""
    _, first, second = at_rest(phi)
    speed = np.linalg.norm(first, axis=0)
    tangent = np.array([np.cos(y[2]), np.sin(y[2])])
    turn = np.sum(second * _turned(first), axis=0) / speed**3
    stretch, kap, _ = _stretch(phi, np.sum(y[3:5] * tangent, axis=0), y[5], turn)
    stretching, bending = stiffness(phi)
    return np.asarray(speed * np.array([stretching * (stretch**2 - 1) ** 2 / 8, bending * kap**2 / 2]))


def _by_balance(count: int) -> dict[str, float]:
    # 1. Unknown are x, z, theta, F and M at Chebyshev's nodes, through which polynomials pass.
    phi = QUARTER / 2 * (1 - np.cos(np.pi * np.arange(count) / (count - 1)))
    basis = [Chebyshev.basis(k, domain=[0.0, QUARTER]) for k in range(count)]
    values = np.array([b(phi) for b in basis]).T
    slopes = np.linalg.solve(values.T, np.array([b.deriv()(phi) for b in basis])).T
    position, first, _ = at_rest(phi)
    start = np.concatenate([position, [np.arctan2(first[1], first[0])], np.zeros((3, count))])
    scale = np.array([1.0, 1.0, 1.0, PRESSURE, PRESSURE, PRESSURE])[:, None]
    start[2, -1] = np.pi

    def missing(unknown: Array, pressure: float) -> Array:
        y = unknown.reshape(6, count) * scale
        left = y @ slopes.T - _rates(phi, y, pressure)
        # 2. At an end each, a condition stands for the rate. Floor: z = 0, F_x = 0; wall: x = 0, F_z = 0; none turns.
        left[0, -1], left[1, 0], left[2, 0] = y[0, -1], y[1, 0], y[2, 0] - QUARTER
        left[3, 0], left[4, -1], left[5, -1] = y[3, 0], y[4, -1], PRESSURE * (y[2, -1] - np.pi)
        return np.asarray(left / scale).ravel()

    unknown = (start / scale).ravel()
    for share in STEPS:
        found = root(missing, unknown, args=(share * PRESSURE,), tol=1e-13)
        unknown = found.x
    assert np.abs(found.fun).max() < 1e-9, found.message
    # 3. What is asked.
    curves = [
        Chebyshev(c, domain=[0.0, QUARTER]) for c in np.linalg.solve(values, (unknown.reshape(6, -1) * scale).T).T
    ]

    def at(angles: Array) -> Array:
        return np.array([curve(angles) for curve in curves])

    def moved(angles: Array) -> Array:
        return at(angles)[:2] - at_rest(angles)[0]

    points, weights = _rule()
    membrane, bending = _energies(points, at(points)) @ weights
    wall = at(np.array([QUARTER]))[:, 0]
    parts = {
        "flattening": AXES[1] - float(wall[1]),
        "membrane_energy": LENGTH * float(membrane),
        "bending_energy": LENGTH * float(bending),
        "strain_energy": LENGTH * float(membrane + bending),
    }
    largest = float(np.linalg.norm(moved(np.linspace(0.0, QUARTER, 2001)), axis=0).max())
    return _named(parts, moved(np.array([ONE, TWO])), largest)


def pressed_oval() -> dict[str, Estimate]:
    """Known values by balance; uncertain by what fewer nodes change."""
    coarse, fine = (_by_balance(count) for count in NODES)
    return {n: Estimate.between(v, coarse[n], unit(n), ROUNDING * abs(v)) for n, v in fine.items()}


# --- the second form ----------------------------------------------------------------------------------


@cache
def _rule() -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    return QUARTER * (nodes + 1) / 2, weights * QUARTER / 2


def _tables(phi: Array, count: int) -> Array:
    """Return cosines and sines (2, 3, n, count) of odd harmonics of the angle, with their first two derivatives."""
    k = 2 * np.arange(count) + 1
    c, s = np.cos(np.outer(phi, k)), np.sin(np.outer(phi, k))
    return np.array([[c, -k * s, -(k**2) * c], [s, k * c, -(k**2) * s]])


def _varied(q: Array, tables: Array, pressure: float) -> tuple[Array, tuple[float, float]]:
    """Return the derivative (2 count,) of the potential energy of a unit of length, and its membrane and bending part."""
    phi, weights = _rule()
    stretching, bending = stiffness(phi)
    rest = at_rest(phi)
    coefficients = q.reshape(2, -1)
    first, second = (rest[d] + np.einsum("cnk,ck->cn", tables[:, d], coefficients) for d in (1, 2))
    speed, still = np.linalg.norm(first, axis=0), np.linalg.norm(rest[1], axis=0)
    eps = (speed**2 / still**2 - 1) / 2
    normal = _turned(first) / speed
    curved = np.sum(second * normal, axis=0)
    kap = (curved - np.sum(rest[2] * _turned(rest[1]), axis=0) / still) / still**2
    n, m = weights * still * stretching * eps, weights * still * bending * kap
    by_first = n * first / still**2 + m / still**2 * (-_turned(second) / speed - curved * first / speed**2)
    by_second = m / still**2 * normal
    by_place = -pressure * weights * _turned(first)  # inward, on the deformed curve: an area that shrinks
    varied = sum(np.einsum("cnk,cn->ck", tables[:, d], by) for d, by in enumerate((by_place, by_first, by_second)))
    return np.asarray(varied).ravel(), (float(n @ eps) / 2, float(m @ kap) / 2)


def _by_harmonics(count: int) -> dict[str, float]:
    phi, _ = _rule()
    tables, q = _tables(phi, count), np.zeros(2 * count)
    for share in STEPS:
        found = root(lambda x, p=share * PRESSURE: _varied(x, tables, p)[0], q, tol=1e-13)
        q = found.x
    assert np.abs(found.fun).max() < 1e-9, found.message
    coefficients = q.reshape(2, -1)

    def place(at: Array) -> Array:
        return np.einsum("cnk,ck->cn", _tables(at, count)[:, 0], coefficients)

    flat = float(place(np.array([QUARTER]))[1, 0])
    (membrane, bending), looked = _varied(q, tables, PRESSURE)[1], np.linspace(0.0, QUARTER, 2001)
    parts = {
        "flattening": -flat,
        "membrane_energy": LENGTH * membrane,
        "bending_energy": LENGTH * bending,
        "strain_energy": LENGTH * (membrane + bending),
    }
    return _named(parts, place(np.array([ONE, TWO])), float(np.linalg.norm(place(looked), axis=0).max()))


def pressed_oval_by_harmonics() -> dict[str, Estimate]:
    """Values by harmonics; uncertain by what fewer of them change."""
    coarse, fine = (_by_harmonics(count) for count in HARMONICS)
    return {n: Estimate.between(v, coarse[n], unit(n), 1e-9 * abs(v)) for n, v in fine.items()}
