"""Cells of a mesh: their shape functions, and the field that values at nodes make between them.

Cells are numbered as Abaqus, CalculiX, Nastran and Gmsh number theirs: corners first, in the sense in which the normal
is along a1 x a2, then the middles of the sides, the first of them between the first two corners.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Shape = Literal["tri3", "tri6", "quad4", "quad8", "quad9"]

_QUAD = [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0), (1, 0.5), (0.5, 1), (0, 0.5), (0.5, 0.5)]
_TRI = [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)]
PLACES: dict[Shape, Array] = {  # of the nodes of a cell, in a unit square or half of one
    "tri3": np.array(_TRI[:3], float),
    "tri6": np.array(_TRI, float),
    "quad4": np.array(_QUAD[:4], float),
    "quad8": np.array(_QUAD[:8], float),
    "quad9": np.array(_QUAD, float),
}
POWERS: dict[Shape, list[tuple[int, int]]] = {  # of the monomials s^i t^j that span its shape functions
    "tri3": [(0, 0), (1, 0), (0, 1)],
    "tri6": [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2)],
    "quad4": [(0, 0), (1, 0), (0, 1), (1, 1)],
    "quad8": [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2)],
    "quad9": [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2), (2, 2)],
}
MESHIO = dict(zip(PLACES, ("triangle", "triangle6", "quad", "quad8", "quad9"), strict=True))  # names in meshio
STEPS, NEAR = 12, 1e-12  # of Newton's method for the place of a point in its cell, and where it ends
CANDIDATES = (8, 64)  # cells in which a point is looked for, those with the nearest middles first


def corners_of(shape: Shape) -> int:
    """Return the number of corners of a cell."""
    return 3 if shape.startswith("tri") else 4


def shapes_at(shape: Shape, places: Array) -> tuple[Array, Array]:
    """Return shape functions (n, k) at places (n, 2) of the unit cell, and their derivatives (n, k, 2)."""
    powers = np.array(POWERS[shape])
    i, j = powers.T
    coefficients = np.linalg.inv(np.prod(PLACES[shape][:, None] ** powers, axis=-1))
    s, t = places[:, :1], places[:, 1:]
    values = s**i * t**j
    along = np.where(i > 0, i * s ** np.maximum(i - 1, 0), 0.0) * t**j
    across = s**i * np.where(j > 0, j * t ** np.maximum(j - 1, 0), 0.0)
    return values @ coefficients, np.stack([along @ coefficients, across @ coefficients], axis=-1)


@dataclass(frozen=True)
class Mesh:
    """Nodes in the coordinates of the surface, and cells between them.

    Attributes
    ----------
    xi
        (m, 2) coordinates of the nodes; a closed coordinate has its seam twice.
    cells
        (e, k) nodes of each cell.
    shape
        Of all cells.
    """

    xi: Array
    cells: Integers
    shape: Shape

    @cached_property
    def _finder(self) -> tuple[Any, Array]:
        """A finder of the nearest middles of cells, and the size (2,) of a cell, in which it measures."""
        from scipy.spatial import cKDTree

        corners = self.xi[self.cells[:, : corners_of(self.shape)]]
        size = np.ptp(corners, axis=1).mean(axis=0)
        return cKDTree(corners.mean(axis=1) / size), size

    def locate(self, points: Array) -> tuple[Integers, Array, Array]:
        """Return the cell (n,) of each point (n, 2), its place (n, 2) there, and by how much it lies outside (n,).

        Outside is measured in the unit cell: 0 for points in their cell.
        """
        # The cell is looked for among those with the nearest middles; more of them where cells are of unequal sizes.
        finder, size = self._finder
        cell, places = np.zeros(len(points), np.int64), np.zeros((len(points), 2))
        beyond, asked = np.full(len(points), np.inf), 0
        for count in CANDIDATES:
            lost = np.flatnonzero(beyond > NEAR)
            if len(lost):
                near = finder.query(points[lost] / size, k=np.arange(1, min(count, len(self.cells)) + 1))[1]
                for candidates in near.T[asked:]:
                    left = beyond[lost] > NEAR
                    there, by = self._place(candidates[left], points[lost[left]])
                    better = by < beyond[lost[left]]
                    of = lost[left][better]
                    cell[of], places[of], beyond[of] = candidates[left][better], there[better], by[better]
            asked = count
        return cell, places, np.where(beyond > NEAR, beyond, 0.0)

    def _place(self, cell: Integers, points: Array) -> tuple[Array, Array]:
        """Return the places (n, 2) of points in these cells, by Newton's method, and by how much they lie outside."""
        nodes = self.xi[self.cells[cell]]
        places = np.full((len(points), 2), 1 / 3 if self.shape.startswith("tri") else 1 / 2)
        with np.errstate(all="ignore"):
            for _ in range(STEPS):
                values, slopes = shapes_at(self.shape, places)
                missing = points - np.einsum("nk,nkc->nc", values, nodes)
                (a, c), (b, d) = np.einsum("nkd,nkc->dcn", slopes, nodes)
                step = np.stack([d * missing[:, 0] - b * missing[:, 1], a * missing[:, 1] - c * missing[:, 0]], axis=-1)
                step /= (a * d - b * c)[:, None]
                places = places + np.clip(step, -1, 1)
                if not np.abs(step).max(initial=0.0) >= NEAR:
                    break
            beyond = [-places.min(axis=-1), places.max(axis=-1) - 1]
            if self.shape.startswith("tri"):
                beyond.append(places.sum(axis=-1) - 1)
            ended = np.abs(step).max(axis=-1) < NEAR**0.5  # from far off it may not
            return places, np.where(ended, np.max(beyond, axis=0), np.inf)

    def interpolate(self, values: Array, points: Array) -> Array:
        """Return values (n, ...) at points (n, 2) from those of the nodes (m, ...)."""
        cell, places, _ = self.locate(points)
        shares, _ = shapes_at(self.shape, places)
        return np.asarray(np.einsum("nk,nk...->n...", shares, values[self.cells[cell]]))

    def rule(self, count: int) -> Iterator[tuple[Array, Array, Array]]:
        """Yield for each of Gauss's points: points (e, 2) of all cells, weights (e,) in xi, and the nodes' shares (k,).

        The rule has `count` points a side; on triangles it is that of a square whose side is a corner.
        """
        x, w = np.polynomial.legendre.leggauss(count)
        x, w = (x + 1) / 2, w / 2
        corners = self.xi[self.cells]
        for (s, ws), (t, wt) in ((a, b) for a in zip(x, w, strict=True) for b in zip(x, w, strict=True)):
            place, weight = ((s * (1 - t), t), ws * wt * (1 - t)) if self.shape.startswith("tri") else ((s, t), ws * wt)
            values, slopes = shapes_at(self.shape, np.array([place]))
            jacobian = np.linalg.det(np.einsum("kd,ekc->ecd", slopes[0], corners))
            yield np.einsum("k,ekc->ec", values[0], corners), weight * np.abs(jacobian), values[0]
