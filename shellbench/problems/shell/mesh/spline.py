"""Tensor-product splines of degree 5 over a rectangle: evaluation with derivatives, and least squares.

Degree 5 has four continuous derivatives: solvers need the third, that of curvature. Knots are even. In an open
direction the knot of each end is sixfold; in a closed one the knots are periodic.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from math import factorial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from shellbench.protocol.schema import Finite, Model

Array = NDArray[np.float64]
DEGREE = 5
ORDER = DEGREE + 1
CHUNK = 20_000  # points evaluated at once: 36 coefficients of each are gathered
RIDGE = 1e-13  # of the mean diagonal, added so that a system with gaps in its data can be factorised
REFINEMENTS = 3  # of its solution, which take the ridge's effect away where there are data


@lru_cache(maxsize=64)
def _pieces(spans: int, periodic: bool) -> Array:
    """Return (spans, 6, 6): on each span of length 1 its six B-splines, as coefficients of powers of s in [0, 1]."""
    if periodic:
        knots = np.arange(-DEGREE, spans + DEGREE + 1, dtype=float)
    else:
        knots = np.clip(np.arange(-DEGREE, spans + DEGREE + 1, dtype=float), 0, spans)
    start = np.arange(spans, dtype=float)
    basis = np.zeros((spans, 1, ORDER))
    basis[:, 0, 0] = 1.0
    # Cox and de Boor, with x = start + s: each of the r functions of degree r - 1 rises into one of degree r, and
    # falls into the one before.
    for degree in range(1, ORDER):
        higher = np.zeros((spans, degree + 1, ORDER))
        for number in range(degree):
            low = knots[np.arange(spans) + DEGREE - degree + 1 + number]
            high = knots[np.arange(spans) + DEGREE + 1 + number]
            width = (high - low)[:, None]
            shifted = np.roll(basis[:, number], 1, axis=1)  # times s
            higher[:, number + 1] += (shifted + (start - low)[:, None] * basis[:, number]) / width
            higher[:, number] += ((high - start)[:, None] * basis[:, number] - shifted) / width
        basis = higher
    return basis


class Spline(Model):
    """A surface by spline.

    Attributes
    ----------
    lower, upper
        Bounds of the rectangle.
    spans
        Number of spans along each coordinate.
    periodic
        Directions in which it closes.
    coefficients
        Those of x, y and z, m: the second coordinate runs faster.
    """

    lower: tuple[Finite, Finite]
    upper: tuple[Finite, Finite]
    spans: tuple[int, int]
    periodic: tuple[bool, bool]
    coefficients: tuple[tuple[Finite, ...], tuple[Finite, ...], tuple[Finite, ...]] = Field(repr=False)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of coefficients along each coordinate."""
        return shape_of(self.spans, self.periodic)

    @cached_property
    def _table(self) -> Array:
        return np.array(self.coefficients).T.reshape(*self.shape, 3)

    def derivatives(self, points: ArrayLike, order: int = 2) -> dict[tuple[int, int], Array]:
        """Return (i, j) -> (..., 3): the derivative i times in xi1 and j times in xi2, for i + j <= order."""
        xi = np.asarray(points, dtype=float)
        flat = xi.reshape(-1, 2)
        keys = [(i, total - i) for total in range(order + 1) for i in range(total, -1, -1)]
        found = {key: np.empty((len(flat), 3)) for key in keys}
        for begin in range(0, len(flat), CHUNK):
            part = slice(begin, begin + CHUNK)
            first, second = (self._local(flat[part], axis, order) for axis in (0, 1))
            local = self._table[first[0][:, :, None], second[0][:, None, :]]  # (n, 6, 6, 3)
            for i in range(order + 1):
                rows = np.einsum("na,nabc->nbc", first[1][i], local)
                for j in range(order + 1 - i):
                    found[i, j][part] = np.einsum("nb,nbc->nc", second[1][j], rows)
        return {key: value.reshape(*xi.shape[:-1], 3) for key, value in found.items()}

    def _local(self, xi: Array, axis: int, order: int) -> tuple[NDArray[np.int64], list[Array]]:
        return local_basis(
            xi[:, axis], (self.lower[axis], self.upper[axis]), self.spans[axis], self.periodic[axis], order
        )


def shape_of(spans: Sequence[int], periodic: Sequence[bool]) -> tuple[int, int]:
    """Return the number of coefficients along each coordinate."""
    first, second = (n if closed else n + DEGREE for n, closed in zip(spans, periodic, strict=True))
    return first, second


def local_basis(
    x: Array, bounds: tuple[float, float], spans: int, periodic: bool, order: int = 0
) -> tuple[NDArray[np.int64], list[Array]]:
    """Return the indices (n, 6) of the coefficients that act at points (n,), and weights (n, 6) by derivative."""
    scale = spans / (bounds[1] - bounds[0])
    place = (x - bounds[0]) * scale
    if periodic:
        place = np.mod(place, spans)
    span = np.clip(np.floor(place).astype(np.int64), 0, spans - 1)
    s = place - span
    pieces = _pieces(spans, periodic)[span]  # (n, 6, 6)
    weights = []
    for derivative in range(order + 1):
        factors = np.array([factorial(k) / factorial(k - derivative) if k >= derivative else 0.0 for k in range(ORDER)])
        powers = s[:, None] ** np.maximum(np.arange(ORDER) - derivative, 0) * factors
        weights.append(np.einsum("nap,np->na", pieces, powers) * scale**derivative)
    indices = span[:, None] + np.arange(ORDER)
    return (np.mod(indices, spans) if periodic else indices), weights


def fit_spline(
    xi: Array,
    positions: Array,
    bounds: tuple[tuple[float, float], tuple[float, float]],
    spans: tuple[int, int],
    periodic: tuple[bool, bool],
) -> Spline:
    """Return the spline of least squares through positions (n, 3) at points (n, 2); `bounds` are lower and upper."""
    from scipy.sparse import csr_array, identity
    from scipy.sparse.linalg import splu

    lower, upper = bounds
    shape = shape_of(spans, periodic)
    (rows, (first,)), (columns, (second,)) = (
        local_basis(xi[:, axis], (lower[axis], upper[axis]), spans[axis], periodic[axis]) for axis in (0, 1)
    )
    unknown = (rows[:, :, None] * shape[1] + columns[:, None, :]).reshape(len(xi), -1)
    weights = (first[:, :, None] * second[:, None, :]).reshape(len(xi), -1)
    starts = np.arange(len(xi) + 1) * unknown.shape[1]
    design = csr_array((weights.ravel(), unknown.ravel(), starts), shape=(len(xi), shape[0] * shape[1]))
    normal = (design.T @ design).tocsc()
    ridge = RIDGE * normal.diagonal().mean() * identity(normal.shape[0], format="csc")
    factors = splu((normal + ridge).tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    centre = positions.mean(axis=0)  # B-splines sum to one, so that the centre can be subtracted and added again
    found = np.zeros((normal.shape[0], 3))
    for _ in range(1 + REFINEMENTS):
        found += factors.solve(design.T @ (positions - centre - design @ found))
    return Spline(
        lower=lower,
        upper=upper,
        spans=spans,
        periodic=periodic,
        coefficients=tuple(map(tuple, (found + centre).T.tolist())),
    )
