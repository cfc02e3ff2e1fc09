r"""A plate on an even bed, held along its edges, under three of its own waves: each is a spring of its own.

With w = sum_k c_k sin(m pi s / a) sin(n pi t / b) along the normal, the bed's stiffness k and l = pi^2 (m^2/a^2 + n^2/b^2)

    (B l^2 + k) c = q,    bending energy B a b / 8 sum l^2 c^2                    (Navier; Hetenyi 1946).

All forces of the rim balance: those of the loads, less those of the bed. A load on the rim goes into it.

The second form minimises the potential energy: Legendre polynomials that vanish at the edges, all that is asked by
Gauss's rule, and the forces of the rim from the deflection at it: Kirchhoff's shear -B (w,nnn + (2 - nu) w,ntt), and
2 B (1 - nu) w,st at the corners.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss
from scipy.optimize import minimize

from .estimate import Estimate
from .surface_strains import Array

SIDES = np.array([1.7, 1.2])  # a, b, m
YOUNG, POISSON, THICKNESS, BED = 1.0, 0.3, 1e-4, 1e-10
BENDING = YOUNG * THICKNESS**3 / (12 * (1 - POISSON**2))
WAVES = {(1, 1): 6e-5, (3, 1): 3e-4, (1, 2): 1e-4}  # q along the normal, N/m^2
CORNER = np.array([0.4, -0.3, 1.1])
FRAME = np.array([[2.0, 1.0, 2.0], [-2.0, 2.0, 1.0], [-1.0, -2.0, 2.0]]) / 3  # along s, along t, normal
DOMAIN = np.array([[-13162.8, 0.3], [-6581.4, 1.5]])
POINTS = np.array([[-11200.0, 0.45], [-7900.0, 0.8]])  # the third one is on the rim
QUAY, WEIGHT = -9000.0, np.array([0.0, 0.0, -2e-5])  # where it begins, and the load there, N/m; it grows with xi1/2000
FORCE, AXIS, CENTRE = np.array([2.0, 1.0, -2.0]) / 3, np.array([2.0, -1.0, 2.0]) / 3, np.array([0.2, -0.5, 0.3])
CLOSED = 1e-12
"""Relative uncertainty of the closed form: rounding."""
FEW, MANY, GAUSS = 18, 22, 60
"""Polynomials a side of the second form, and points of its rule."""

Field = Callable[[Array, Array], Array]
"""A deflection (n,), m, at s (n,), t (n,)."""


def lengths(xi: Array) -> Array:
    """Return s and t (n, 2), m, at coordinates (n, 2)."""
    low, high = DOMAIN
    t = (np.tanh(xi[:, 1]) - np.tanh(low[1])) / (np.tanh(high[1]) - np.tanh(low[1]))
    return np.stack([(xi[:, 0] - low[0]) / (high[0] - low[0]), t], -1) * SIDES


def _largest(deflection: Field) -> float:
    """Return the largest size, from the best place of a grid on."""
    s, t = (g.ravel() for g in np.meshgrid(*(np.linspace(0, side, 101) for side in SIDES)))
    best = int(np.argmax(np.abs(deflection(s, t))))
    sign = np.sign(deflection(s[best : best + 1], t[best : best + 1])[0])
    scale = abs(float(deflection(s[best : best + 1], t[best : best + 1])[0]))

    def drop(place: Array) -> float:
        return float(-sign * deflection(place[:1], place[1:])[0] / scale)

    options = {"xatol": 1e-9, "fatol": 1e-15}
    return -scale * float(minimize(drop, [s[best], t[best]], method="Nelder-Mead", options=options).fun)


def _values(deflection: Field, mean: float, bending: float, force: Array, moment: Array, error: float) -> dict[str, Estimate]:  # fmt: skip
    """Return the values; the rim itself holds the plate by `force`, and by `moment` about the corner."""
    at = deflection(*lengths(POINTS).T)
    # What acts on the rim: a load that grows evenly from where the quay begins; r along the quay from 0 to 1.
    start, growth = lengths(np.array([[QUAY, DOMAIN[1, 1]]]))[0], (DOMAIN[1, 0] - QUAY) / 2000
    side = SIDES[0] - start[0]
    weight = side * (1 + growth / 2) * WEIGHT
    first = side * ((start[0] * (1 + growth / 2) + side * (1 / 2 + growth / 3)) * FRAME[0] + SIDES[1] * (1 + growth / 2) * FRAME[1])  # fmt: skip
    force, moment = force - weight, moment - np.cross(first, WEIGHT)
    moment = moment + np.cross(CORNER - CENTRE, force)
    largest = _largest(deflection)
    centre = CORNER + SIDES / 2 @ FRAME[:2] + mean * FRAME[2]
    return {
        "deflection": Estimate(-float(at[0]), error * largest, "m"),
        "mean_oblique": Estimate(-float(at.sum()) / 3, error * largest, "m"),
        "largest_displacement": Estimate(largest, error * largest, "m"),
        "centre_height": Estimate(float(centre[2]), error * largest, "m"),
        "bending_energy": Estimate(bending, 10 * error * bending, "J"),
        "rim_force": Estimate(float(force @ FORCE), 10 * error * float(np.linalg.norm(force)), "N"),
        "rim_moment": Estimate(float(moment @ AXIS), 10 * error * float(np.linalg.norm(moment)), "N m"),
    }


def rippled_plate() -> dict[str, Estimate]:
    """Known values of cases/rippled_plate.toml."""
    a, b = SIDES
    factors = {(m, n): np.pi**2 * ((m / a) ** 2 + (n / b) ** 2) for m, n in WAVES}
    amplitudes = {wave: q / (BENDING * factors[wave] ** 2 + BED) for wave, q in WAVES.items()}

    def deflection(s: Array, t: Array) -> Array:
        return np.asarray(
            sum(c * np.sin(m * np.pi * s / a) * np.sin(n * np.pi * t / b) for (m, n), c in amplitudes.items())
        )

    def integral(m: int, side: float) -> float:
        return side / (m * np.pi) * (1 - (-1) ** m)

    def first(m: int, side: float) -> float:
        return -((-1) ** m) * side**2 / (m * np.pi)

    # Loads less the bed's forces are B l^2 c in each wave; the rim balances them.
    normal, about_s, about_t, mean = 0.0, 0.0, 0.0, 0.0
    for (m, n), c in amplitudes.items():
        left = BENDING * factors[m, n] ** 2 * c
        normal -= left * integral(m, a) * integral(n, b)
        about_s -= left * integral(m, a) * first(n, b)
        about_t += left * first(m, a) * integral(n, b)
        mean += c * integral(m, a) * integral(n, b) / (a * b)
    bending = BENDING * a * b / 8 * sum((factors[wave] * c) ** 2 for wave, c in amplitudes.items())
    moment = about_s * FRAME[0] + about_t * FRAME[1]
    return _values(deflection, mean, bending, normal * FRAME[2], moment, CLOSED)


# --- the second form ---------------------------------------------------------------------------------


def rippled_plate_by_ritz() -> dict[str, Estimate]:
    """Values by Ritz's method, uncertain by the change from fewer functions."""
    coarse, fine = (_by_ritz(count) for count in (FEW, MANY))
    return {name: Estimate.between(e.value, coarse[name].value, e.unit, e.uncertainty) for name, e in fine.items()}


def _by_ritz(count: int) -> dict[str, Estimate]:
    bubble = Legendre.basis(0) - Legendre.basis(2)  # zero at both ends
    basis = [bubble * Legendre.basis(k) for k in range(count)]

    def table(axis: int, places: Array, order: int) -> Array:
        at = 2 * places / SIDES[axis] - 1
        return np.array([(f.deriv(order) if order else f)(at) for f in basis]) * (2 / SIDES[axis]) ** order

    x, weights = leggauss(GAUSS)
    places = [side / 2 * (x + 1) for side in SIDES]
    shares = [side / 2 * weights for side in SIDES]

    def product(axis: int, one: int, two: int) -> Array:
        return np.asarray(table(axis, places[axis], one) * shares[axis] @ table(axis, places[axis], two).T)

    def kron(s: tuple[int, int], t: tuple[int, int]) -> Array:
        return np.kron(product(0, *s), product(1, *t))

    bent = kron((2, 2), (0, 0)) + kron((0, 0), (2, 2)) + 2 * (1 - POISSON) * kron((1, 1), (1, 1))
    bent = BENDING * (bent + POISSON * (kron((2, 0), (0, 2)) + kron((0, 2), (2, 0))))
    load = np.zeros(count**2)
    for (m, n), q in WAVES.items():
        waves = [np.sin(k * np.pi * place / side) for k, place, side in zip((m, n), places, SIDES, strict=True)]
        load += q * np.kron(*(table(axis, places[axis], 0) * shares[axis] @ waves[axis] for axis in (0, 1)))
    matrix = bent + BED * kron((0, 0), (0, 0))
    scale = np.sqrt(np.diag(matrix))
    c = np.linalg.solve(matrix / np.outer(scale, scale), load / scale) / scale
    factors = c.reshape(count, count)

    def derivative(s: Array, t: Array, one: int = 0, two: int = 0) -> Array:
        return np.einsum("ip,ij,jp->p", table(0, s, one), factors, table(1, t, two))

    whole = [table(axis, places[axis], 0) @ shares[axis] / SIDES[axis] for axis in (0, 1)]
    mean = float(whole[0] @ factors @ whole[1])
    # The rim: shear along each edge, of the outward normal, and forces at the corners.
    force, moment = np.zeros(3), np.zeros(3)

    def add(s: Array, t: Array, along_normal: Array) -> None:
        nonlocal force, moment
        each = along_normal[:, None] * FRAME[2]
        force = force + each.sum(axis=0)
        moment = moment + np.cross(np.stack([s, t], -1) @ FRAME[:2], each).sum(axis=0)

    for axis in (0, 1):
        for at, sense in ((0.0, -1.0), (SIDES[axis], 1.0)):
            edge = [places[0], places[1]]
            edge[axis] = np.full(GAUSS, at)
            three, mixed = ((3, 0), (1, 2)) if axis == 0 else ((0, 3), (2, 1))
            shear = -BENDING * (derivative(*edge, *three) + (2 - POISSON) * derivative(*edge, *mixed))
            add(*edge, sense * shear * shares[1 - axis])
    for s, t in ((0.0, 0.0), (SIDES[0], SIDES[1]), (SIDES[0], 0.0), (0.0, SIDES[1])):
        place, sense = (np.array([s]), np.array([t])), 1.0 if (s > 0) == (t > 0) else -1.0
        add(*place, 2 * BENDING * (1 - POISSON) * sense * derivative(*place, 1, 1))
    return _values(derivative, mean, float(c @ bent @ c) / 2, force, moment, 1e3 * CLOSED)
