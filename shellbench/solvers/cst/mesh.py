"""Triangle meshes of the parametric rectangle: a grid of vertices, each cell cut in two."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import MeshTri

from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.cst.settings import Diagonal

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FEWEST_PERIODIC = 4  # cells around a closed coordinate; with fewer, two triangles can share two edges
ON_VERTEX = 1e-9  # of a cell: how far a vertex may lie from a point that it stands for

# Corners of a cell as offsets along (xi1, xi2), and its two triangles by them, both counter-clockwise. "right" cuts a
# cell from its lower left corner to its upper right one, "left" the other way.
CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
HALVES = {"right": np.array([(0, 1, 2), (0, 2, 3)]), "left": np.array([(0, 1, 3), (1, 2, 3)])}


@dataclass(frozen=True)
class TriangleMesh:
    """A uniform grid of cells, two triangles each; vertices on the seam of a closed coordinate are one.

    Attributes
    ----------
    domain
        The parametric rectangle that it covers.
    cells
        Number of cells along each coordinate.
    diagonal
        How cells are cut; "alternating" changes from each cell to its neighbours, like the squares of a chessboard.
    """

    domain: Domain
    cells: tuple[int, int]
    diagonal: Diagonal = "right"

    def __post_init__(self) -> None:
        for count, closed in zip(self.cells, self.domain.periodic, strict=True):
            if closed and count < FEWEST_PERIODIC:
                raise ValueError(f"a closed coordinate needs at least {FEWEST_PERIODIC} cells")

    @property
    def shape(self) -> tuple[int, int]:
        """Number of vertices along each coordinate."""
        first, second = (n + (not closed) for n, closed in zip(self.cells, self.domain.periodic, strict=True))
        return (first, second)

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return self.shape[0] * self.shape[1]

    @property
    def steps(self) -> Array:
        """(2,) sides of a cell."""
        sizes: Array = np.array(self.domain.size)
        return sizes / self.cells

    @cached_property
    def points(self) -> Array:
        """(vertices, 2) curvilinear coordinates."""
        index: Array = np.indices(self.shape).reshape(2, -1).T.astype(float)
        return np.asarray(np.asarray(self.domain.lower) + index * self.steps)

    @cached_property
    def _corner_indices(self) -> Integers:
        """(triangles, 3, 2) grid indices of the corners, those beyond a seam not yet brought back."""
        cells = np.indices(self.cells).reshape(2, -1).T
        corners = cells[:, None, None] + CORNERS[np.stack([HALVES["right"], HALVES["left"]])][:, None]
        return np.asarray(corners[self._is_left(cells).astype(int), np.arange(len(cells))].reshape(-1, 3, 2))

    def _is_left(self, cells: Integers) -> NDArray[np.bool_]:
        if self.diagonal == "alternating":
            return np.asarray(cells.sum(axis=-1) % 2 == 1)
        return np.full(len(cells), self.diagonal == "left")

    @cached_property
    def corners(self) -> Array:
        """(triangles, 3, 2) curvilinear coordinates of the corners; beyond a seam they go on."""
        return np.asarray(self.domain.lower) + self._corner_indices * self.steps

    @cached_property
    def triangles(self) -> Integers:
        """(triangles, 3) vertices, counter-clockwise in (xi1, xi2)."""
        first, second = np.moveaxis(self._corner_indices % np.array(self.shape), -1, 0)
        return np.asarray(first * self.shape[1] + second, dtype=np.int64)

    @cached_property
    def hinges(self) -> tuple[Integers, Integers]:
        """Interior edges: vertices (hinges, 4) and triangles (hinges, 2).

        The edge goes from the first vertex to the second; the third is the other corner of the first triangle, which
        lies to the left of the edge, and the fourth that of the second triangle.
        """
        topology = MeshTri(np.ascontiguousarray(self.points.T), np.ascontiguousarray(self.triangles.T), validate=False)
        inside = topology.f2t[1] >= 0
        sides = np.asarray(topology.f2t[:, inside].T, dtype=np.int64)
        edge = topology.facets[:, inside].T
        opposite = [self._corner_opposite(edge, sides[:, k]) for k in (0, 1)]
        corners = self.triangles[sides[:, 0]]
        start = np.argmax(corners == edge[:, :1], axis=1)
        along = corners[np.arange(len(edge)), (start + 1) % 3] == edge[:, 1]
        edge = np.where(along[:, None], edge, edge[:, ::-1])
        return np.asarray(np.column_stack([edge, *opposite]), dtype=np.int64), sides

    def rim_triangles(self, edges: tuple[Edge, ...]) -> tuple[Integers, Integers]:
        """Return the triangles on edges of the rectangle: corners (w, 3), those on the edge first, and numbers (w, 2).

        Corners go counter-clockwise, so that the surface lies to the left of its edge. Each number stands twice.
        """
        corners, numbers = [], []
        for edge in edges:
            on = np.isin(self.triangles, self.edge_vertices(edge))
            outside = np.roll(on, -1, axis=1) & on  # sides that begin at this corner
            number = np.flatnonzero(outside.any(axis=1))
            start = np.argmax(outside[number], axis=1)
            order = (start[:, None] + np.arange(3)) % 3
            ends = np.take_along_axis(self.corners[number], order[:, :2, None], axis=1)
            sequence = np.argsort(ends[:, :, 1 - edge.axis].mean(axis=1))
            number, order = number[sequence], order[sequence]
            corners.append(np.take_along_axis(self.triangles[number], order, axis=1))
            numbers.append(number)
        return np.concatenate(corners), np.repeat(np.concatenate(numbers)[:, None], 2, axis=1)

    def side_middles(self, edge: Edge) -> Array:
        """Return the middles (n, 2) of the sides on an edge of the rectangle, by the running coordinate."""
        running = 1 - edge.axis
        places = self.domain.lower[running] + (np.arange(self.cells[running]) + 0.5) * self.steps[running]
        return edge.points(self.domain, places)

    def _corner_opposite(self, edge: Integers, triangle: Integers) -> Integers:
        corners = self.triangles[triangle]
        off = (corners != edge[:, :1]) & (corners != edge[:, 1:])
        return np.asarray(corners[np.arange(len(corners)), np.argmax(off, axis=1)])

    def edge_vertices(self, edge: Edge) -> Integers:
        """Return the vertices of an edge of the rectangle in the order of the running coordinate."""
        numbers = np.arange(self.vertex_count).reshape(self.shape)
        return np.asarray(np.take(numbers, 0 if edge.side == "min" else -1, axis=edge.axis))

    def vertex_at(self, xi: tuple[float, float]) -> int | None:
        """Return the vertex at a point, or None if there is none."""
        index = (np.asarray(xi) - np.asarray(self.domain.lower)) / self.steps
        nearest = np.rint(index).astype(int)
        if np.abs(index - nearest).max() > ON_VERTEX:
            return None
        first, second = nearest % np.array(self.shape)
        return int(first * self.shape[1] + second)

    def locate(self, points: ArrayLike) -> tuple[Integers, Array]:
        """Find points (n, 2): their triangles (n,) and barycentric coordinates (n, 3) in them."""
        local = (self.domain.wrap(points) - np.asarray(self.domain.lower)) / self.steps
        cell = np.clip(np.floor(local).astype(np.int64), 0, np.array(self.cells) - 1)
        s, t = np.moveaxis(local - cell, -1, 0)
        left = self._is_left(cell)
        second = np.where(left, s + t > 1, t > s)
        right_weights = np.where(second, (1 - t, s, t - s), (1 - s, s - t, t))
        left_weights = np.where(second, (1 - t, s + t - 1, 1 - s), (1 - s - t, s, t))
        number = 2 * (cell[:, 0] * self.cells[1] + cell[:, 1]) + second
        return np.asarray(number, dtype=np.int64), np.asarray(np.where(left, left_weights, right_weights).T)
