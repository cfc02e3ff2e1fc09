r"""Modes of thin plates: frequencies and buckling loads of rectangles and parallelograms, by polynomials.

A plate of bending stiffness B and mass m a unit area, under membrane forces N_ab that keep their direction, has the
Rayleigh quotients

    omega^2 = 2 U / int m w^2,    lambda = -2 U / int N_ab w,a w,b,    U = B/2 int H^abcd w,ab w,cd

with H^abcd = nu a^ab a^cd + (1 - nu) / 2 (a^ac a^bd + a^ad a^bc). Coordinates run along the sides, from -1 to 1; the
metric is constant. A side that is simply supported holds w, a clamped one w and its slope: w is sought as a product of
polynomials that have one or two zeros at each such end. Four cases are closed forms: Navier's products of sines for a
rectangle that is simply supported, with w,nn = 0 at its rim,

    omega = pi^2 (i^2 / a^2 + j^2 / b^2) sqrt(B / m),    N = B pi^2 (i^2 / a^2 + j^2 / b^2)^2 / (i / a)^2;

under tension m omega^2 has pi^2 (N11 i^2 / a^2 + N22 j^2 / b^2) besides.

Modes are numbered from 1; rigid motions are no modes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import eigh

from .estimate import Estimate

Array = np.ndarray
Values = dict[str, Estimate]

ROUNDING = 1e-11
"""Relative, of eigenvalues by polynomials: reciprocals of the largest ones of a definite pair."""


@dataclass(frozen=True)
class Plate:
    """A parallelogram with its material, and what holds its rim.

    Attributes
    ----------
    sides
        (2, 2): the vectors along its sides, m.
    young, poisson, thickness, density
        Pa, 1, m, and kg a square metre.
    zeros
        Of w at each end: 0 where it is free, 1 where it is simply supported, 2 where it is clamped.
    force
        (2, 2): membrane forces N_ab in Cartesian components at load factor 1, N/m; tension is positive.
    """

    sides: tuple[tuple[float, float], tuple[float, float]]
    young: float
    poisson: float
    thickness: float
    density: float = 0.0
    zeros: int = 1
    force: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))

    @property
    def bending(self) -> float:
        """B, N m."""
        return self.young * self.thickness**3 / 12 / (1 - self.poisson**2)


SIMPLE = Plate(((3.0, 0.0), (0.0, 2.0)), 2e11, 0.3, 0.01, density=80.0)
FREE = Plate(((1.0, 0.0), (0.0, 1.0)), 7e10, 0.3, 0.004, density=10.8, zeros=0)
RHOMBUS = Plate(((10.0, 0.0), (10 * 0.5**0.5, 10 * 0.5**0.5)), 2e11, 0.3, 0.05, density=400.0, zeros=2)
STRETCHED = replace(SIMPLE, force=((3e4, 0.0), (0.0, 1.5e4)))
PRESSED = replace(SIMPLE, density=0.0, force=((-1e5, 0.0), (0.0, 0.0)))
SHEARED = Plate(((1.0, 0.0), (0.0, 1.0)), 2e11, 0.3, 0.005, force=((0.0, 1e5), (1e5, 0.0)))
RIGID = {0: 3, 1: 0, 2: 0}
"""Rigid motions across the plate, by the zeros at its ends."""


def sines(plate: Plate, count: int) -> Array:
    """Return the first frequencies, Hz, or load factors in compression, of a simply supported rectangle: closed form."""
    (a, _), (_, b) = plate.sides
    i, j = np.meshgrid(np.arange(1, 4 * count + 1), np.arange(1, 4 * count + 1))
    wave = np.pi**2 * ((i / a) ** 2 + (j / b) ** 2)
    if plate.density:
        tension = np.pi**2 * (plate.force[0][0] * (i / a) ** 2 + plate.force[1][1] * (j / b) ** 2)
        return np.sort(np.sqrt((plate.bending * wave**2 + tension) / plate.density).ravel() / (2 * np.pi))[:count]
    return np.sort((plate.bending * wave**2 / (np.pi * i / a) ** 2).ravel())[:count] / -plate.force[0][0]


def polynomials(plate: Plate, count: int, functions: int) -> Array:
    """Return the first frequencies, Hz, or load factors, with so many polynomials along each side."""
    # 1. Along each side polynomials with the zeros of its ends, orthonormal on Gauss's points.
    # 2. Integrals of products of their derivatives; those over the plate are sums of products of two of them.
    # 3. The reciprocals of the largest eigenvalues of the mass, or of -N, over the stiffness.
    x, w = np.polynomial.legendre.leggauss(functions + 2 * plate.zeros + 2)
    line = _line(functions, plate.zeros, x, w)
    product = np.einsum("pqi,q,rqj->prij", line, w, line)
    along = np.array(plate.sides).T / 2  # of the place by the coordinates
    area, inverse = abs(np.linalg.det(along)), np.linalg.inv(along)
    metric = inverse @ inverse.T  # contravariant
    orders = {(0, 0): (2, 0), (0, 1): (1, 1), (1, 0): (1, 1), (1, 1): (0, 2)}

    def integral(first: tuple[int, int], second: tuple[int, int]) -> Array:
        return area * np.kron(product[first[0], second[0]], product[first[1], second[1]])

    stiffness = np.zeros((functions**2, functions**2))
    for ab, one in orders.items():
        for cd, other in orders.items():
            (a, b), (c, d), nu = ab, cd, plate.poisson
            crossed = metric[a, c] * metric[b, d] + metric[a, d] * metric[b, c]
            factor = nu * metric[a, b] * metric[c, d] + (1 - nu) / 2 * crossed
            if factor:
                stiffness += plate.bending * factor * integral(one, other)
    if plate.density:
        ahead = plate.density * integral((0, 0), (0, 0))
        shift = plate.bending / plate.density / area**2 if RIGID[plate.zeros] else 0.0
        values = _reciprocals(ahead, stiffness + shift * ahead, RIGID[plate.zeros] + count) - shift
        return np.sqrt(values[RIGID[plate.zeros] :]) / (2 * np.pi)
    force = inverse @ np.array(plate.force) @ inverse.T
    slopes = {0: (1, 0), 1: (0, 1)}
    ahead = -sum(force[a, b] * integral(slopes[a], slopes[b]) for a in (0, 1) for b in (0, 1))
    return _reciprocals(np.asarray(ahead), stiffness, count)


def _line(functions: int, zeros: int, x: Array, w: Array) -> Array:
    """(3, points, functions): polynomials with zeros at both ends, orthonormal by the rule, and two derivatives."""
    values = np.empty((3, len(x), functions))
    weight = np.polynomial.Polynomial([1.0, 0.0, -1.0]) ** zeros
    for k in range(functions):
        one = np.polynomial.legendre.Legendre.basis(k)
        parts = [one, one.deriv(1), one.deriv(2)]
        held = [weight, weight.deriv(1), weight.deriv(2)]
        values[0, :, k] = held[0](x) * parts[0](x)
        values[1, :, k] = held[1](x) * parts[0](x) + held[0](x) * parts[1](x)
        values[2, :, k] = held[2](x) * parts[0](x) + 2 * held[1](x) * parts[1](x) + held[0](x) * parts[2](x)
    _, upper = np.linalg.qr(np.sqrt(w)[:, None] * values[0])
    return values @ np.linalg.inv(upper)


def _reciprocals(ahead: Array, stiffness: Array, count: int) -> Array:
    """Return the reciprocals (count,) of the largest eigenvalues, increasing."""
    size = len(ahead)
    halves = (ahead + ahead.T) / 2, (stiffness + stiffness.T) / 2
    found = eigh(*halves, eigvals_only=True, subset_by_index=(size - count, size - 1))
    return 1 / found[::-1]


def numbered(values: Array, coarser: Array | None, name: str, unit: str, rounding: float = ROUNDING) -> Values:
    """Return values by the names of a case's quantities; without coarser ones they are closed forms."""
    found = {}
    for number, value in enumerate(values, start=1):
        other = value if coarser is None else coarser[number - 1]
        found[f"{name}_{number}"] = Estimate.between(value, other, unit, rounding * abs(value))
    return found


def closed(plate: Plate, count: int, name: str, unit: str) -> Values:
    """Known values of a simply supported rectangle by the closed form."""
    return numbered(sines(plate, count), None, name, unit, 1e-14)


def ritz(plate: Plate, count: int, name: str, unit: str, degrees: tuple[int, int] = (16, 20)) -> Values:
    """Known values by polynomials."""
    coarse, fine = (polynomials(plate, count, functions) for functions in degrees)
    return numbered(fine, coarse, name, unit)


JUDGES: dict[str, Callable[[], Values]] = {
    "plate_modes": partial(closed, SIMPLE, 10, "frequency", "Hz"),
    "stretched_plate_modes": partial(closed, STRETCHED, 6, "frequency", "Hz"),
    "free_plate_modes": partial(ritz, FREE, 8, "frequency", "Hz"),
    "rhombic_plate_modes": partial(ritz, RHOMBUS, 6, "frequency", "Hz", (24, 32)),
    "plate_compression": partial(closed, PRESSED, 4, "load_factor", ""),
    "plate_shear": partial(ritz, SHEARED, 3, "load_factor", ""),
}
