"""B-splines on the unit square: linear ones, which interpolate bilinearly, and cubic ones, on equal cells.

Knots are open: the first and last spline are 1 at their ends, so that an edge of the square has its own coefficients.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csr_matrix, diags

Array = NDArray[np.float64]
Sparse = Any  # scipy's matrices have no types


def knots(cells: int, degree: int) -> Array:
    """Return the knots of equal cells, the ends repeated."""
    return np.concatenate([np.zeros(degree), np.linspace(0, 1, cells + 1), np.ones(degree)])


def along(x: Array, cells: int, degree: int, order: int = 0) -> Sparse:
    """Return all splines at x (n,), or their derivatives of an order: sparse, (n, cells + degree).

    Beyond the square, the polynomials of its last cells continue.

    Raises
    ------
    ValueError
        If splines of this degree have no derivative of this order.
    """
    if order > degree:
        raise ValueError(f"a field of degree {degree} has no derivatives of order {order}")
    at = knots(cells, degree)
    matrix = BSpline.design_matrix(x, at[order : len(at) - order], degree - order, extrapolate=True)
    # A derivative is a spline of one degree less, whose coefficients are differences over the length of supports.
    for lost in range(order - 1, -1, -1):
        k, t = degree - lost, at[lost : len(at) - lost]
        scale = k / (t[k + 1 : -1] - t[1 : -k - 1])
        matrix = matrix @ diags([-scale, scale], [0, 1], shape=(len(scale), len(scale) + 1))
    return csr_matrix(matrix)


def local(points: Array, cells: int, degree: int, orders: tuple[int, int] = (0, 0)) -> tuple[NDArray[np.int64], Array]:
    """Return the splines that are not zero at points (n, 2): their numbers and values, each (n, (degree + 1)^2)."""
    (rows, ones), (columns, others) = (
        not_zero(points[:, axis], cells, degree, order) for axis, order in enumerate(orders)
    )
    numbers = rows[:, :, None] * (cells + degree) + columns[:, None, :]
    values = ones[:, :, None] * others[:, None, :]
    return numbers.reshape(len(points), -1), values.reshape(len(points), -1)


def not_zero(x: Array, cells: int, degree: int, order: int) -> tuple[NDArray[np.int64], Array]:
    """Return the splines that are not zero at x (n,): their numbers and values, each (n, degree + 1)."""
    cell = np.clip((x * cells).astype(np.int64), 0, cells - 1)
    if degree == 1 and order == 0:  # eq. (4), much faster
        share = x * cells - cell
        return np.stack([cell, cell + 1], axis=1), np.stack([1 - share, share], axis=1)
    numbers = cell[:, None] + np.arange(degree + 1)
    return numbers, np.take_along_axis(along(x, cells, degree, order).toarray(), numbers, axis=1)


def matrix(points: Array, cells: int, degree: int, orders: tuple[int, int] = (0, 0)) -> Sparse:
    """Return all products of splines at points (n, 2): sparse, (n, (cells + degree)^2)."""
    numbers, values = local(points, cells, degree, orders)
    starts = np.arange(len(points) + 1) * numbers.shape[1]
    return csr_matrix((values.ravel(), numbers.ravel(), starts), shape=(len(points), (cells + degree) ** 2))
