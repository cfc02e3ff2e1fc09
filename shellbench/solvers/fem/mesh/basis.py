"""Bicubic Hermite (Bogner-Fox-Schmit) basis, tabulated once on the unit cell.

A node carries u, u,1, u,2 and u,12 of each Cartesian component, the derivatives with respect to the curvilinear
coordinates themselves. On a cell of size (h1, h2) the basis function that belongs to the derivative (k, l) is h1**k
h2**l times its counterpart on the unit cell, so that no matrix is inverted. scikit-fem's `ElementQuadBFS` inverts a
Vandermonde matrix in global coordinates instead, whose condition number grows to 3.5e14 on 64 x 64 cells.

Bogner, Fox & Schmit (1965), The generation of interelement-compatible stiffness and mass matrices.

Degree 4 and 5 add bubbles along each coordinate, functions of one cell whose value and slope vanish at both its ends:
the second integrals of the Legendre polynomials from L_2 on (the hierarchic modes of Szabo & Babuska 1991, section 5).
The joints stay C1. A node carries the bubbles of the cell that begins at it, so that all nodes carry (p - 1)^2 numbers
of each component; at the last node of an open coordinate they are unused.

At folds the slope across the line jumps. One more function of each end of a cell carries the jump: half of its slope
function, with a minus sign at the end where the cell stops. Its numbers are used at folds only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Derivative = tuple[int, int]

# Thresholds of rounding, one name for each kind of number that is compared. None is tuned to an answer: each lies
# between the rounding of such numbers and the least meaningful difference.
SAME = 1e-9  # coordinates and times, relative to the whole; components of unit vectors of a surface
ROUNDING = 1e-12  # sums, products and solves, relative to their largest term: 4,500 eps
UNSTRAINED = 1e-14  # strain of a shell that is only moved, relative to its displacements: 45 eps

COMPONENTS = 3  # of a displacement
KINDS: tuple[Derivative, ...] = ((0, 0), (1, 0), (0, 1), (1, 1))  # derivatives of u that a node carries
CORNERS: tuple[Derivative, ...] = ((0, 0), (0, 1), (1, 1), (1, 0))  # of a cell, as MeshQuad.init_tensor orders them
FUNCTIONS = len(CORNERS) * len(KINDS)  # of one component on a cell

Degree = Literal[3, 4, 5]
CUBIC: Degree = 3
JUMP = -1  # number of the function that carries the jump of a slope at a fold


@dataclass(frozen=True)
class Basis:
    """The functions of a cell.

    Attributes
    ----------
    degree
        p in each coordinate.
    folded
        Coordinate across whose lines slopes may jump, or None.
    """

    degree: Degree = CUBIC
    folded: int | None = None

    def numbers(self, axis: int) -> tuple[int, ...]:
        """Return the functions of an end of a cell along a coordinate: value, slope, bubbles, jump of the slope."""
        return (*range(self.degree - 1), *((JUMP,) if self.folded == axis else ()))


CUBICS = Basis()

# H[end][slope]: coefficients of 1, x, x^2, x^3; 1 at its own end, in value or in slope, and 0 otherwise
_CUBICS = np.array([[[1, 0, -3, 2], [0, 1, -2, 1]], [[0, 0, 3, -2], [0, 0, -1, 1]]], dtype=float)
# the bubbles x^2 (1 - x)^2 and x^2 (1 - x)^2 (2 x - 1), times 16: they and the displacements are of one magnitude
_BUBBLES = 16 * np.array([[0, 0, 1, -2, 1, 0], [0, 0, -1, 4, -5, 2]], dtype=float)


@cache
def kinds_of(basis: Basis) -> tuple[tuple[int, int], ...]:
    """Return a node's degrees of freedom by coordinate, `KINDS` first: 0 is a value, 1 a slope, 2 and more bubbles."""
    pairs = ((a, b) for a in basis.numbers(0) for b in basis.numbers(1))
    return KINDS + tuple(pair for pair in pairs if pair not in KINDS)


def axis_functions(x: ArrayLike, derivative: int = 0, degree: Degree = CUBIC, folded: bool = False) -> Array:
    """Return the functions of the unit interval.

    Parameters
    ----------
    x
        (...) coordinates in [0, 1].
    derivative
        Order of the derivative.
    degree
        p.
    folded
        True if slopes may jump.

    Returns
    -------
    Array
        (..., 2, p - 1): by end of the interval, and by value (0) or slope (1) at that end; the bubbles follow, at the
        first end only. With `folded`, the function of the jump is the last one.
    """
    at = np.asarray(x, dtype=float)
    coefficients = np.zeros((len(_CUBICS), degree - 1 + folded, degree + 1))
    coefficients[:, :2, :4] = _CUBICS
    coefficients[0, 2 : degree - 1] = _BUBBLES[: degree - CUBIC, : degree + 1]
    if folded:
        coefficients[:, JUMP, :4] = _CUBICS[:, 1] * [[0.5], [-0.5]]
    for _ in range(derivative):
        coefficients = coefficients[..., 1:] * np.arange(1, coefficients.shape[-1])
    powers = np.ones((*at.shape, coefficients.shape[-1]))
    for power in range(1, coefficients.shape[-1]):
        np.multiply(powers[..., power - 1], at, out=powers[..., power])
    flat = coefficients.reshape(-1, coefficients.shape[-1])
    return np.asarray((powers @ flat.T).reshape(*at.shape, *coefficients.shape[:-1]))


def tabulate(points: ArrayLike, derivative: Derivative, basis: Basis = CUBICS) -> Array:
    """Return a derivative of the basis functions of the unit cell.

    Parameters
    ----------
    points
        (..., 2) in the unit square.
    derivative
        Order of the derivative in each direction.
    basis
        The functions.

    Returns
    -------
    Array
        (..., 4, (p - 1)^2): by corner, in the order of `CORNERS`, and by kind, in the order of `kinds_of`. Bubbles are
        zero at corners that a cell does not begin at.
    """
    xi = np.asarray(points, dtype=float)
    first, second = (
        axis_functions(xi[..., axis], derivative[axis], basis.degree, basis.folded == axis) for axis in (0, 1)
    )
    kinds = kinds_of(basis)
    table = np.empty((len(CORNERS), len(kinds), *xi.shape[:-1]))  # each function for itself, which is faster
    for row, (i, j) in zip(table, CORNERS, strict=True):
        for function, (k, m) in zip(row, kinds, strict=True):
            np.multiply(first[..., i, k], second[..., j, m], out=function)
    return np.moveaxis(table, (0, 1), (-2, -1))


@cache
def gauss_rule(count: int) -> tuple[Array, Array]:
    """Return points (count,) in [-1, 1] and weights of the Gauss rule, computed once and not to be written to."""
    points, weights = np.polynomial.legendre.leggauss(count)
    points.flags.writeable = weights.flags.writeable = False
    return points, weights


Integers = NDArray[np.int64]


def present_functions(basis: Basis) -> NDArray[np.int64]:
    """Return the numbers of a cell's functions (corner, kind) that are not zero everywhere, (p + 1)^2 of them."""
    kinds = kinds_of(basis)
    there = [(i == 0 or k < 2) and (j == 0 or m < 2) for i, j in CORNERS for k, m in kinds]
    return np.flatnonzero(there)


@cache
def present_on_axis(basis: Basis, axis: int) -> slice | Integers:
    """Return the numbers of the `axis_functions`, by end (slow), that are not zero: bubbles have the first end only."""
    numbers = basis.numbers(axis)
    if basis.folded != axis:
        return slice(basis.degree + 1)
    there = [end == 0 or number < 2 for end in (0, 1) for number in numbers]
    return np.flatnonzero(there)


@cache
def cell_functions(basis: Basis) -> tuple[Integers, Integers]:
    """Return corner and kind (p + 1, p + 1) of a cell's functions, by number along each coordinate.

    Along a coordinate these are the ones of `present_on_axis`.
    """
    first, second = (
        [(end, number) for end in (0, 1) for number in basis.numbers(axis) if end == 0 or number < 2] for axis in (0, 1)
    )
    kinds = kinds_of(basis)
    corner = [[CORNERS.index((i, j)) for j, _ in second] for i, _ in first]
    return np.array(corner), np.array([[kinds.index((k, m)) for _, m in second] for _, k in first])


def kind_scales(sizes: ArrayLike, basis: Basis = CUBICS) -> Array:
    """Return the factors (..., (p - 1)^2) of slopes, h1**k h2**l, for sizes (..., 2)."""
    h = np.asarray(sizes, dtype=float)
    kinds = kinds_of(basis)
    scales = np.ones((*h.shape[:-1], len(kinds)))
    for number, kind in enumerate(kinds):
        for axis in (0, 1):
            if kind[axis] in (1, JUMP):
                scales[..., number] *= h[..., axis]
    return scales
