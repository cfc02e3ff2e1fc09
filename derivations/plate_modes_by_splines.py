r"""Modes of thin plates once more, by B-splines in Cartesian derivatives.

    2 U = B int (w,xx + w,yy)^2 - 2 (1 - nu) (w,xx w,yy - w,xy^2),

on Gauss's points of all spans. Ends hold the first spline, or the first two.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.linalg import eigh

from .plate_modes import FREE, PRESSED, RHOMBUS, RIGID, SHEARED, SIMPLE, STRETCHED, Array, Plate, Values, numbered
from .spline_shell import Splines

DEGREE = 7
ROUNDING = 1e-8
ENDS = {0: "free", 1: "held", 2: "clamped"}


def splines(plate: Plate, count: int, spans: int, degree: int = DEGREE) -> Array:
    """Return the first frequencies, Hz, or load factors, with so many spans along each side."""
    line = Splines(np.linspace(0.0, 1.0, spans + 1), degree)
    points, weights = (part.ravel() for part in line.gauss)
    end = ENDS[plate.zeros]
    kept = line.reduction((end, end)).toarray()  # type: ignore[arg-type]
    value, slope, second = (line.matrix(points, order) @ kept for order in range(3))
    jacobian = np.linalg.inv(np.array(plate.sides).T)  # of the coordinates by x and y
    area = np.outer(weights, weights).ravel() / abs(np.linalg.det(jacobian))
    gradient = np.stack([np.kron(slope, value), np.kron(value, slope)])
    hessian = {(0, 0): np.kron(second, value), (0, 1): np.kron(slope, slope), (1, 1): np.kron(value, second)}
    hessian[1, 0] = hessian[0, 1]

    def cartesian(i: int, j: int) -> Array:
        terms = (jacobian[a, i] * jacobian[b, j] * hessian[a, b] for a in (0, 1) for b in (0, 1))
        return np.asarray(sum(terms))

    xx, yy, xy = cartesian(0, 0), cartesian(1, 1), cartesian(0, 1)

    def product(one: Array, other: Array) -> Array:
        half = one.T @ (area[:, None] * other)
        return (half + half.T) / 2

    nu = plate.poisson
    stiffness = product(xx, xx) + product(yy, yy) + 2 * nu * product(xx, yy) + 2 * (1 - nu) * product(xy, xy)
    stiffness *= plate.bending
    first = RIGID[plate.zeros]
    slopes, force = np.tensordot(jacobian.T, gradient, 1), plate.force
    tension = np.asarray(sum(force[i][j] * product(slopes[i], slopes[j]) for i in (0, 1) for j in (0, 1)))
    if plate.density:
        ahead = plate.density * product(np.kron(value, value), np.kron(value, value))
        stiffness += tension
    else:
        ahead = -tension
    size = len(stiffness)
    # a squared frequency that is small beside all of them, so that rigid motions have one
    shift = plate.bending / plate.density / area.sum() ** 2 if first else 0.0
    wanted = (size - first - count, size - first - 1)
    values = 1 / eigh(ahead, stiffness + shift * ahead, eigvals_only=True, subset_by_index=wanted)[::-1] - shift
    return np.sqrt(values) / (2 * np.pi) if plate.density else values


def by_splines(plate: Plate, count: int, name: str, unit: str, spans: tuple[int, int] = (6, 8)) -> Values:
    """Known values by splines."""
    coarse, fine = (splines(plate, count, number) for number in spans)
    return numbered(fine, coarse, name, unit, ROUNDING)


SECOND_FORMS: dict[str, Callable[[], Values]] = {
    "plate_modes": partial(by_splines, SIMPLE, 10, "frequency", "Hz"),
    "stretched_plate_modes": partial(by_splines, STRETCHED, 6, "frequency", "Hz"),
    "free_plate_modes": partial(by_splines, FREE, 8, "frequency", "Hz"),
    "rhombic_plate_modes": partial(by_splines, RHOMBUS, 6, "frequency", "Hz", (10, 14)),
    "plate_compression": partial(by_splines, PRESSED, 4, "load_factor", ""),
    "plate_shear": partial(by_splines, SHEARED, 3, "load_factor", ""),
}
