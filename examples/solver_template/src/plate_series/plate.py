"""The mechanics: a simply supported rectangular plate under uniform normal load, in a basis of sines.

With the plane x = (xi1, xi2, 0), u = w a3 and the load q along a3, the potential energy of a linear Kirchhoff plate is

    P(w) = B/2 int [(w,11 + w,22)^2 - 2 (1 - nu) (w,11 w,22 - w,12^2)] dA - int q w dA,
    B = E h^3 / (12 (1 - nu^2)).

The term with 1 - nu integrates to zero for w = 0 on straight edges. The sines

    w(x, y) = sum c_mn sin(m pi x / a) sin(n pi y / b),   m, n = 1, 3, 5, ...

fulfil the supports and make the energy diagonal, so that Ritz's minimum is Navier's series (Timoshenko &
Woinowsky-Krieger, Theory of Plates and Shells, 2nd ed. 1959, art. 28-30):

    c_mn = 16 q / (pi^6 B m n (m^2/a^2 + n^2/b^2)^2);   for even m or n zero.

For a solver of your own, keep the role of `Plate` (the numbers that your discretisation needs from a case) and replace
the code below it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plate:
    """The data of a case that the series needs.

    Attributes
    ----------
    lower, size
        (2,) corner and sides of the rectangle, m.
    bending_stiffness
        B, N m.
    poissons_ratio
        nu.
    load
        q, N/m^2, along a3.
    """

    lower: tuple[float, float]
    size: tuple[float, float]
    bending_stiffness: float
    poissons_ratio: float
    load: float

    def wave_numbers(self, terms: int) -> tuple[Array, Array]:
        """Return m pi / a and n pi / b for the first odd m and n, each (terms,), 1/m."""
        odd = np.pi * np.arange(1, 2 * terms, 2, dtype=np.float64)
        return np.asarray(odd / self.size[0]), np.asarray(odd / self.size[1])


def solve(plate: Plate, terms: int) -> Array:
    """Return the coefficients c_mn (terms, terms) that minimise the potential energy, m."""
    alpha, beta = plate.wave_numbers(terms)
    area = plate.size[0] * plate.size[1]
    work = 4 / np.outer(alpha, beta)  # int sin sin dA over the plate, m^2
    stiffness = plate.bending_stiffness * area / 4 * (alpha[:, None] ** 2 + beta**2) ** 2  # N/m
    return np.asarray(plate.load * work / stiffness)


def bending_energy(plate: Plate, coefficients: Array) -> float:
    """Return the strain energy of the series, J: exact, because sines are orthogonal."""
    alpha, beta = plate.wave_numbers(len(coefficients))
    area = plate.size[0] * plate.size[1]
    stiffness = plate.bending_stiffness * area / 4 * (alpha[:, None] ** 2 + beta**2) ** 2
    return float(np.sum(stiffness * coefficients**2) / 2)


def derivative(plate: Plate, coefficients: Array, points: Array, orders: tuple[int, int]) -> Array:
    """Return a partial derivative of the deflection w at points (..., 2).

    Parameters
    ----------
    orders
        Orders in xi1 and in xi2; (0, 0) is w itself, m.
    """
    numbers = plate.wave_numbers(len(coefficients))
    first, second = (
        k**order * np.sin((points[..., axis, None] - plate.lower[axis]) * k + order * np.pi / 2)
        for axis, (k, order) in enumerate(zip(numbers, orders, strict=True))
    )
    return np.asarray(np.sum((first @ coefficients) * second, axis=-1))


def bending_strain(plate: Plate, coefficients: Array, points: Array) -> Array:
    """Return kappa = bbar - b at points (..., 2): components 11, 22, 12 as (..., 3), 1/m.

    With x,ab . a3 = w,ab of the deformed plane and bbar = 0, kappa_ab = -w,ab.
    """
    return -np.stack([derivative(plate, coefficients, points, o) for o in ((2, 0), (0, 2), (1, 1))], axis=-1)


def bending_energy_density(plate: Plate, coefficients: Array, points: Array) -> Array:
    """Return B/2 [nu (tr kappa)^2 + (1 - nu) kappa : kappa] at points (..., 2), J/m^2."""
    k11, k22, k12 = np.moveaxis(bending_strain(plate, coefficients, points), -1, 0)
    nu = plate.poissons_ratio
    return np.asarray(plate.bending_stiffness / 2 * (nu * (k11 + k22) ** 2 + (1 - nu) * (k11**2 + k22**2 + 2 * k12**2)))
