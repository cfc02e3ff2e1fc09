r"""Clamped rectangular plates, uniform load or a point load anywhere: Ritz's method with polynomials.

B laplace^2 w = q on [0, a] x [0, b] with w = w_n = 0 on the rim: w minimises B/2 int (laplace w)^2 - int q w, for the other
part of the bending energy, the Gaussian curvature's, vanishes on a clamped rim. The steps:

1. One direction's functions are four Hermite cubics, the values and slopes at the ends, and twice integrated Legendre
   polynomials, which vanish there with their slopes. The plate's are products of two.
2. A point load is taken out: w = s + v with s = P r^2 log(r) / (8 pi B), the answer of the infinite plate, and v biharmonic
   with v = -s and v_n = -s_n on the rim. There s is smooth. The coefficients of the products that do not vanish on the
   rim are the expansions of -s and its slopes along the sides.
3. The others follow from int laplace v laplace phi = int q phi / B for every phi that vanishes with its slope on the rim.

At the corners w goes as r^3.74: the energy's error falls like the eleventh power of the degree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .estimate import Estimate
from .plate import OBLIQUE, LoadedPlate, Mean, Point, Rectangle, Uniform

HERMITE = 4
ROUNDING = 1e-10
"""Relative rounding of the solved coefficients, whose matrix has a condition of about the fourth power of the degree."""


@dataclass(frozen=True)
class Side:
    """Functions of one direction on [0, length], up to a degree."""

    length: float
    degree: int

    def basis(self, x: np.ndarray) -> np.ndarray:
        """(3, len(x), degree + 1): values and two derivatives; end slopes are per metre."""
        half = self.length / 2
        t = np.asarray(x, float) / half - 1.0
        out = np.zeros((3, len(t), self.degree + 1))
        for column, (side, is_slope) in enumerate([(-1, False), (-1, True), (1, False), (1, True)]):
            cubic = [-side, -1, side, 1] if is_slope else [2, 3 * side, 0, -side]
            p = np.polynomial.Polynomial(np.array(cubic) / 4 * (half if is_slope else 1.0))
            out[:, :, column] = [p(t), p.deriv()(t), p.deriv(2)(t)]
        for k in range(2, self.degree - 1):
            second = np.polynomial.Legendre.basis(k) * np.sqrt((2 * k + 1) / 2)
            first = second.integ(lbnd=-1)
            out[:, :, k + 2] = [first.integ(lbnd=-1)(t), first(t), second(t)]
        return out / (half ** np.arange(3))[:, None, None]

    def gauss(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and weights, exact for the product of two functions."""
        t, weights = np.polynomial.legendre.leggauss(self.degree + 2)
        return self.length / 2 * (1 + t), self.length / 2 * weights

    def expansion(self, values: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Coefficients of functions, (degree + 1, F), from values at the Gauss points (G, F) and the ends' (4, F)."""
        basis = self.basis(self.gauss()[0])[0]
        rest = values - basis[:, :HERMITE] @ ends
        inner = np.linalg.lstsq(basis[:, HERMITE:], rest, rcond=None)[0]
        return np.vstack([ends, inner])


def free_plate(load: Point, stiffness: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(4, ...): s, its slopes along x and y, and its mixed derivative; zero at the load itself."""
    x, y = np.broadcast_arrays(x - load.place[0], y - load.place[1])
    square = x**2 + y**2
    safe = np.where(square > 0, square, 1.0)
    log = np.log(safe)
    factor = load.force / (16 * np.pi * stiffness)
    mixed = np.where(square > 0, 4 * x * y / safe, 0.0)
    return factor * np.stack([square * log, 2 * x * (log + 1), 2 * y * (log + 1), mixed])


def rim_coefficients(case: LoadedPlate, sides: tuple[Side, Side]) -> np.ndarray:
    """Coefficients (m, n) of the products that do not vanish on the rim: the expansions of -s and its slopes."""
    along, across = sides
    out = np.zeros((along.degree + 1, across.degree + 1))
    if isinstance(case.load, Uniform):
        return out
    b = case.plate.bending_stiffness
    ends = [np.array([0.0, side.length]) for side in sides]
    corner = -free_plate(case.load, b, ends[0][:, None], ends[1])  # (4, 2, 2)
    # Rows: value and slope at x = 0, then at x = a; columns the same in y.
    square = corner.reshape(2, 2, 2, 2)  # (d/dy, d/dx, end x, end y)
    corners = np.transpose(square, (2, 1, 3, 0)).reshape(HERMITE, HERMITE)
    for direction, side in ((1, across), (0, along)):
        s = side.gauss()[0]
        if direction == 1:
            data = -free_plate(case.load, b, ends[0][:, None], s)[[0, 1]]  # value and slope along x, (2, end, G)
            out[:HERMITE] = side.expansion(np.swapaxes(data, 0, 1).reshape(HERMITE, -1).T, corners.T).T
        else:
            data = -free_plate(case.load, b, s, ends[1][:, None])[[0, 2]]
            out[:, :HERMITE] = side.expansion(np.swapaxes(data, 0, 1).reshape(HERMITE, -1).T, corners)
    return out


def solve_clamped(case: LoadedPlate, degree: int) -> tuple[tuple[Side, Side], np.ndarray, list[np.ndarray]]:
    """Functions of both directions, the coefficients (m, n) of their products, and the functions' integrals."""
    sides = Side(case.plate.a, degree), Side(case.plate.b, degree)
    products, integrals = [], []
    for side in sides:
        x, weights = side.gauss()
        basis = side.basis(x)
        products.append({(i, j): (basis[i] * weights[:, None]).T @ basis[j] for i in (0, 2) for j in (0, 2)})
        integrals.append(weights @ basis[0])
    one, two = products
    coefficients = rim_coefficients(case, sides)
    inner = slice(HERMITE, None)
    # int laplace v laplace phi, v = sum C_ij f_i g_j: four products of one-dimensional integrals.
    pairs = [((i, k), (2 - i, 2 - k)) for i in (0, 2) for k in (0, 2)]
    count = degree + 1 - HERMITE
    matrix = sum(np.kron(one[p][inner, inner], two[q][inner, inner]) for p, q in pairs)
    rim = sum(one[p].T @ coefficients @ two[q] for p, q in pairs)
    right = -rim[inner, inner]
    if isinstance(case.load, Uniform):
        right = case.load.pressure / case.plate.bending_stiffness * np.outer(integrals[0], integrals[1])[inner, inner]
    scale = 1 / np.sqrt(np.diag(matrix))
    solved = cho_solve(cho_factor(scale[:, None] * matrix * scale), scale * right.ravel())
    coefficients[inner, inner] = (scale * solved).reshape(count, count)
    return sides, coefficients, integrals


def ritz(case: LoadedPlate, degree: int) -> tuple[np.ndarray, float]:
    """Deflections at the plate's points, m, and strain energy, J, with polynomials of a degree each way."""
    sides, coefficients, integrals = solve_clamped(case, degree)

    def deflection(points: np.ndarray) -> np.ndarray:
        shapes = [side.basis(points[:, k])[0] for k, side in enumerate(sides)]
        smooth = np.einsum("pi,ij,pj->p", shapes[0], coefficients, shapes[1])
        if isinstance(case.load, Uniform):
            return smooth
        return smooth + free_plate(case.load, case.plate.bending_stiffness, points[:, 0], points[:, 1])[0]

    if isinstance(case.load, Uniform):
        work = case.load.pressure * integrals[0] @ coefficients @ integrals[1]
    else:
        work = case.load.force * deflection(np.array([case.load.place]))[0]
    return deflection(case.points), float(work / 2)


def clamped_plate_uniform() -> LoadedPlate:
    """The plate of cases/clamped_plate_uniform.toml."""
    asked = {
        "centre_deflection": Mean(((50.0, 50.0),)),
        "corner_deflection": Mean(((30.0, 15.0),)),
        "mean_oblique": Mean(((30.0, 15.0), (60.0, 85.0), (80.0, 45.0)), OBLIQUE),
        "largest_displacement": Mean(((50.0, 50.0),)),
    }
    return LoadedPlate(Rectangle(100.0, 100.0, 1.0, 1e7, 0.3), Uniform(), asked)


def clamped_plate_point() -> LoadedPlate:
    """The plate of cases/clamped_plate_point.toml."""
    asked = {
        "far_deflection": Mean(((65.0, 55.0),)),
        "load_deflection": Mean(((30.0, 40.0),)),
        "mean_oblique": Mean(((65.0, 55.0), (15.0, 60.0), (50.0, 20.0)), OBLIQUE),
    }
    return LoadedPlate(Rectangle(100.0, 100.0, 1.0, 1e7, 0.3), Point((30.0, 40.0)), asked)


DEGREE = 36


def by_ritz(case: LoadedPlate, degree: int = DEGREE) -> dict[str, Estimate]:
    """Values by Ritz's method; the uncertainty is the change from 2/3 of the degree."""
    return case.estimates(ritz(case, degree), ritz(case, 2 * degree // 3), ROUNDING)
