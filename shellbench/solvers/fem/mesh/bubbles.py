"""Interpolation of a function in the basis of degree p: values and slopes at the nodes, and bubbles in between.

Along one coordinate, the coefficients of the bubbles follow from the error e of the function's cubic Hermite
interpolant. They are moments of e, chosen so that the second derivative of the error is orthogonal to those of the
bubbles. Polynomials of degree p are reproduced exactly. In two dimensions, the two interpolations are done in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from shellbench.solvers.fem.mesh.basis import Degree, Derivative, axis_functions, gauss_rule
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Derivatives = Callable[[Array], Mapping[Derivative, Array]]

MOMENT_POINTS = 6  # Gauss points of a cell at which moments are taken: exact for a remainder of degree 10


def moment_points() -> Array:
    """Return the points (g,) of the unit interval at which `fitted_bubbles` takes a function."""
    return np.asarray((gauss_rule(MOMENT_POINTS)[0] + 1) / 2)


def fitted_bubbles(degree: Degree, ends: Array, inside: Array) -> Array:
    """Return the coefficients of the bubbles of c cells along a line.

    Parameters
    ----------
    degree
        p.
    ends
        (c, 2, 2, ...) value, and slope times the cell's length, at both ends of each cell.
    inside
        (c, g, ...) values at `moment_points`.

    Returns
    -------
    Array
        (c, p - 3, ...).
    """
    # b'' is a multiple of a Legendre polynomial L_m, so that (e'', b'') = (e, L_m''): L_2'' is constant, L_3'' linear.
    points, weights = gauss_rule(MOMENT_POINTS)
    table = axis_functions((points + 1) / 2, 0, degree)
    left = inside - np.einsum("gek,cek...->cg...", table[..., :2], ends)
    powers = points ** np.arange(degree - 3)[:, None] * weights
    moments = powers / np.sum(powers * table[:, 0, 2:].T, axis=1, keepdims=True)
    return np.asarray(np.einsum("bg,cg...->cb...", moments, left))


def interpolation_coefficients(mesh: TensorMesh, derivatives: Derivatives) -> Array:
    """Return the coefficients (nodes, ..., kinds) of functions whose values, slopes and u,12 are given at points."""
    # Take values of f, f,1, f,2 and f,12 on the tensor grid of mesh lines and moment points; then fit one coordinate
    # after the other.
    samples, sizes = [], []
    for axis, line in enumerate(mesh.lines):
        h = np.diff(line)
        inside = (line[:-1, None] + h[:, None] * moment_points()).ravel()
        samples.append(np.concatenate([line, inside, *([mesh.lower_sides(axis)] if mesh.basis.folded == axis else [])]))
        sizes.append(h)
    grid = np.stack(np.meshgrid(*samples, indexing="ij"), axis=-1)
    given = derivatives(grid.reshape(-1, 2))
    tail = given[0, 0].shape[1:]
    at = {key: given[key].reshape(*grid.shape[:2], *tail) for key in ((0, 0), (1, 0), (0, 1), (1, 1))}
    result = np.zeros((*mesh.shape, *tail, len(mesh.kinds)))
    second = {m: _coefficients_along(mesh, 0, at[0, m], at[1, m], sizes[0]) for m in (0, 1)}
    columns = {
        k: _coefficients_along(mesh, 1, np.swapaxes(second[0][k], 0, 1), np.swapaxes(second[1][k], 0, 1), sizes[1])
        for k in mesh.basis.numbers(0)
    }
    for number, (k, m) in enumerate(mesh.kinds):
        found = np.swapaxes(columns[k][m], 0, 1)[: mesh.shape[0], : mesh.shape[1]]
        result[: found.shape[0], : found.shape[1], ..., number] = found
    return result.reshape(mesh.node_count, *tail, len(mesh.kinds))


def _coefficients_along(mesh: TensorMesh, axis: int, values: Array, slopes: Array, h: Array) -> list[Array]:
    """Return value, slope and bubbles, of samples along the first axis of arrays: at lines, or by cell.

    Across folds the slope is the mean of both sides, and its jump comes last.
    """
    lines = len(mesh.lines[axis])
    cells = lines - 1
    lengths = h.reshape(-1, *[1] * (values.ndim - 1))
    folded = mesh.basis.folded == axis
    upper, lower = slopes[:lines], slopes[-lines:] if folded else slopes[:lines]
    ends = np.stack(
        [
            np.stack([values[:cells], upper[:cells] * lengths], axis=1),
            np.stack([values[1:lines], lower[1:] * lengths], axis=1),
        ],
        axis=1,
    )
    inside = values[lines : lines + cells * MOMENT_POINTS].reshape(cells, MOMENT_POINTS, *values.shape[1:])
    bubbles = fitted_bubbles(mesh.degree, ends, inside)
    return [values[:lines], (upper + lower) / 2, *np.moveaxis(bubbles, 1, 0), *([upper - lower] if folded else [])]
