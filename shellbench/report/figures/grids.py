"""Grids of points on a surface: their facets, coordinate lines and normals, and finer grids through them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

Array = NDArray[np.float64]


def inward(position: Array) -> Array:
    """Return unit normals (n1, n2, 3) of a surface (n1, n2, 3), on the side on which most of its middle lies."""
    first, second = (np.gradient(position, axis=axis, edge_order=2) for axis in (0, 1))
    normal = np.cross(first, second)  # its length is an area: what follows is a mean over the surface
    inside = np.sum(normal * (position.mean(axis=(0, 1)) - position)) >= 0
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    unit = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    return np.asarray(unit if inside else -unit)


def facets(grid: Array) -> Array:
    """Return the (m, 4, 3) facets of a grid of points (n1, n2, 3)."""
    corners = (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def facet_means(values: Array) -> Array:
    """Return the mean (m,) over the corners of each facet of values (n1, n2)."""
    corners = values[:-1, :-1] + values[1:, :-1] + values[1:, 1:] + values[:-1, 1:]
    return (corners / 4.0).reshape(-1)


def refined(grid: Array, cells: int) -> Array:
    """Return a grid (n1, n2, 3) of at least `cells` cells a side, by cubic splines through the given points."""
    if min(grid.shape[:2]) < 4 or min(grid.shape[:2]) > cells:
        return grid
    parameters = [np.arange(n, dtype=float) for n in grid.shape[:2]]
    fine = [np.linspace(0.0, p[-1], (len(p) - 1) * -(-cells // (len(p) - 1)) + 1) for p in parameters]
    return np.stack([RectBivariateSpline(*parameters, grid[..., i], s=0)(*fine) for i in range(3)], axis=-1)


def wires(grid: Array, lines: int) -> Array:
    """Return the (m, 2, 3) pieces of coordinate lines about as far apart in one direction as in the other.

    There are `lines` of them on a square surface; edges are always among them.
    """
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).sum(axis).mean() for axis in (0, 1)]
    spacing = max(float(np.sqrt(steps[0] * steps[1])), 1e-300) / (lines - 1)
    pieces = []
    for lattice, length in ((grid, steps[0]), (grid.swapaxes(0, 1), steps[1])):
        number = int(np.clip(round(float(length) / spacing) + 1, 2, len(lattice)))
        chosen = np.unique(np.linspace(0, len(lattice) - 1, number).round().astype(int))
        along = lattice[chosen]
        pieces.append(np.stack([along[:, :-1], along[:, 1:]], axis=2).reshape(-1, 2, 3))
    return np.concatenate(pieces)
