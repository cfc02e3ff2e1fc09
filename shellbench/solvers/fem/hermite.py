"""Bicubic Hermite (Bogner-Fox-Schmit) basis, tabulated once on the unit cell.

A node carries u, u,1, u,2 and u,12 of each Cartesian component, the derivatives with respect to the curvilinear
coordinates themselves. On a cell of size (h1, h2) the basis function that belongs to the derivative (k, l) is
h1**k h2**l times its counterpart on the unit cell, so nothing is ever inverted; scikit-fem's `ElementQuadBFS`
inverts a Vandermonde matrix in global coordinates instead, whose condition grows to 3.5e14 on 64 x 64 cells.

Bogner, Fox & Schmit (1965), The generation of interelement-compatible stiffness and mass matrices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Derivative = tuple[int, int]

KINDS: tuple[Derivative, ...] = ((0, 0), (1, 0), (0, 1), (1, 1))  # derivatives of u that a node carries
CORNERS: tuple[Derivative, ...] = ((0, 0), (0, 1), (1, 1), (1, 0))  # of a cell, as MeshQuad.init_tensor orders them
FUNCTIONS = len(CORNERS) * len(KINDS)  # of one component on a cell

# H[end][slope]: coefficients of 1, x, x^2, x^3; 1 at its own end, in value or in slope, and 0 otherwise
_CUBICS = np.array([[[1, 0, -3, 2], [0, 1, -2, 1]], [[0, 0, 3, -2], [0, 0, -1, 1]]], dtype=float)


def cubics(x: ArrayLike, derivative: int = 0) -> Array:
    """Return the four cubic Hermite functions of the unit interval.

    Parameters
    ----------
    x
        (...) coordinates in [0, 1].
    derivative
        Order of the derivative.

    Returns
    -------
    Array
        (..., 2, 2): by end of the interval, and by value (0) or slope (1) at that end.
    """
    at = np.asarray(x, dtype=float)
    coefficients = _CUBICS
    for _ in range(derivative):
        coefficients = coefficients[..., 1:] * np.arange(1, coefficients.shape[-1])
    powers = np.ones((*at.shape, coefficients.shape[-1]))
    for degree in range(1, coefficients.shape[-1]):
        np.multiply(powers[..., degree - 1], at, out=powers[..., degree])
    flat = coefficients.reshape(-1, coefficients.shape[-1])
    return np.asarray((powers @ flat.T).reshape(*at.shape, *coefficients.shape[:-1]))


def tabulate(points: ArrayLike, derivative: Derivative) -> Array:
    """Return a derivative of the 16 basis functions of the unit cell.

    Parameters
    ----------
    points
        (..., 2) in the unit square.
    derivative
        How often to differentiate in each direction.

    Returns
    -------
    Array
        (..., 4, 4): by corner, in the order of `CORNERS`, and by kind, in the order of `KINDS`.
    """
    xi = np.asarray(points, dtype=float)
    first, second = (cubics(xi[..., axis], derivative[axis]) for axis in (0, 1))
    table = np.empty((len(CORNERS), len(KINDS), *xi.shape[:-1]))  # each function for itself, which is faster
    for row, (i, j) in zip(table, CORNERS, strict=True):
        for function, (k, m) in zip(row, KINDS, strict=True):
            np.multiply(first[..., i, k], second[..., j, m], out=function)
    return np.moveaxis(table, (0, 1), (-2, -1))


def kind_scales(sizes: ArrayLike) -> Array:
    """Return h1**k h2**l (..., 4) for the four `KINDS`, of sizes (..., 2)."""
    h = np.asarray(sizes, dtype=float)
    scales = np.ones((*h.shape[:-1], len(KINDS)))
    for number, kind in enumerate(KINDS):
        for axis in (0, 1):
            if kind[axis]:
                scales[..., number] *= h[..., axis]
    return scales
