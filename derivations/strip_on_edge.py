r"""A strip on edge that buckles sideways under its own weight: polynomials or splines, and the narrow limit.

In the plane of the strip the linear plane stress N of its weight q an area comes first, E h of modulus and without
Poisson's effect: the least of int E h / 2 (u,x^2 + v,y^2 + (u,y + v,x)^2 / 2) + q v. Sideways, w has

    lambda = - int B (w,xx^2 + w,yy^2 + 2 w,xy^2) / int N_ab w,a w,b.

Both forms seek products of functions along and across: Legendre polynomials times powers of x that clamp x = 0, or
B-splines. Narrow strips are beams of the bending stiffness EI = B b and the torsional one GJ = 2 B b, whose twist has
Airy's kind of equation: q b L^3 = 6 j sqrt(EI GJ), j the first zero of Bessel's function of order -1/6 (Prandtl 1899).
The wall stiffens a length b of the strip against twisting, so that the limit is approached as b / L.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import jv

from .estimate import Estimate
from .plate_modes import Array, Values
from .spline_shell import Splines

WEIGHT = 12.853763 * np.sqrt(2.0)  # over B / L^3, of cases/strip_on_edge_1_*.toml
THICKNESS = 1e-3  # over the length
WIDTHS = {"strip_on_edge_1_20": 20, "strip_on_edge_1_40": 40, "strip_on_edge_1_80": 80}
GRADING = 3  # of spans along the strip toward the wall, where layers are as long as the strip is wide
ROUNDING = 1e-9

Functions = Callable[[Array, int, int], Array]  # of points in [0, 1], order of the derivative, and what clamps 0


def load_factor(slenderness: float, along: Functions, across: Functions, x: Array, y: Array) -> float:
    """Return the load factor of a strip by functions along and across it; (2, points) rules `x` and `y` on [0, 1]."""
    # 1. Tables of derivatives at all points, for u and v (once zero at the wall) and for w (twice).
    # 2. Displacements in the plane, and forces N at the points, of the weight WEIGHT, with B = L = 1.
    # 3. The reciprocal of the largest eigenvalue of -N over the stiffness.
    width = 1 / slenderness

    def table(clamp: int, i: int, j: int) -> Array:
        return np.kron(along(x[0], i, clamp), across(y[0], j, 0) / width**j)

    area = width * np.outer(x[1], y[1]).ravel()
    value, dx, dy = table(1, 0, 0), table(1, 1, 0), table(1, 0, 1)

    def product(one: Array, other: Array) -> Array:
        return np.asarray(one.T @ (area[:, None] * other))

    stretching = 12 / THICKNESS**2
    mixed = product(dy, dx) / 2
    plane = np.block(
        [
            [product(dx, dx) + product(dy, dy) / 2, mixed],
            [mixed.T, product(dy, dy) + product(dx, dx) / 2],
        ]
    )
    load = np.append(np.zeros(value.shape[1]), -WEIGHT * (area @ value))
    u, v = np.linalg.solve(stretching * plane, load).reshape(2, -1)
    forces = stretching * np.array([dx @ u, dy @ v, (dy @ u + dx @ v) / 2])
    xx, yy, xy = table(2, 2, 0), table(2, 0, 2), table(2, 1, 1)
    stiffness = product(xx, xx) + product(yy, yy) + 2 * product(xy, xy)
    wx, wy = table(2, 1, 0), table(2, 0, 1)
    both = product(wx, forces[2][:, None] * wy)
    ahead = -(product(wx, forces[0][:, None] * wx) + product(wy, forces[1][:, None] * wy) + both + both.T)
    size = len(stiffness)
    halves = (ahead + ahead.T) / 2, (stiffness + stiffness.T) / 2
    return float(1 / eigh(*halves, eigvals_only=True, subset_by_index=(size - 1, size - 1))[0])


def _legendre(count: int, points: Array, order: int, clamp: int) -> Array:
    """(points, count) derivatives of Legendre polynomials on [0, 1] times x to the power `clamp`."""
    line = np.polynomial.Polynomial([0.0, 1.0], domain=[0.0, 1.0], window=[0.0, 1.0])
    table = np.empty((len(points), count))
    for k in range(count):
        one = np.polynomial.Legendre.basis(k, domain=[0.0, 1.0])
        parts = [one, *(one.deriv(m) for m in range(1, order + 1))]
        factor = [line**clamp, *((line**clamp).deriv(m) for m in range(1, order + 1))]
        binomial = [1, order, 1]
        table[:, k] = sum(binomial[m] * factor[m](points) * parts[order - m](points) for m in range(order + 1))
    return table


def by_polynomials(slenderness: float, along: int, across: int) -> float:
    """Load factor with so many polynomials."""
    x, y = (np.array(np.polynomial.legendre.leggauss(count + 4)) for count in (along, across))
    rules = [np.array([(1 + rule[0]) / 2, rule[1] / 2]) for rule in (x, y)]
    return load_factor(slenderness, partial(_legendre, along), partial(_legendre, across), *rules)


def by_splines(slenderness: float, along: int, across: int, degree: int = 6) -> float:
    """Load factor with so many spans, those along the strip graded toward the wall."""
    lines = (
        Splines(np.linspace(0.0, 1.0, along + 1) ** GRADING, degree),
        Splines(np.linspace(0.0, 1.0, across + 1), degree),
    )
    ends = ("free", "held", "clamped")

    def functions(line: Splines, points: Array, order: int, clamp: int) -> Array:
        return np.asarray(line.matrix(points, order) @ line.reduction((ends[clamp], "free")).toarray())  # type: ignore[arg-type]

    rules = [np.array([part.ravel() for part in line.gauss]) for line in lines]
    return load_factor(slenderness, partial(functions, lines[0]), partial(functions, lines[1]), *rules)


def narrow_limit() -> float:
    """q b L^3 / sqrt(EI GJ) of a narrow strip: 12.853763."""
    return 6 * float(brentq(partial(jv, -1 / 6), 2.0, 2.3, xtol=1e-15))


def extrapolated(factors: tuple[float, float, float]) -> float:
    """Limit of load factors of strips each half as wide as the one before, in b / L and its square."""
    first, second, third = factors
    return (8 * third - 6 * second + first) / 3


def _estimate(form: Callable[[float, int, int], float], sizes: tuple[tuple[int, int], ...], slenderness: int) -> Values:
    fine, coarse = (form(slenderness, *size) for size in sizes)
    return {"load_factor_1": Estimate.between(fine, coarse, "", ROUNDING)}


JUDGES: dict[str, Callable[[], Values]] = {
    name: partial(_estimate, by_splines, ((20, 4), (16, 3)), number) for name, number in WIDTHS.items()
}
SECOND_FORMS: dict[str, Callable[[], Values]] = {
    name: partial(_estimate, by_polynomials, ((50, 8), (40, 8)), number) for name, number in WIDTHS.items()
}
