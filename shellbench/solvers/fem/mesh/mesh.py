"""Tensor-product meshes of the parametric rectangle, closed by renumbering nodes.

The cells are those of scikit-fem's `MeshQuad.init_tensor`; its vertices on a seam of a periodic surface are given
one node number, because a periodic mesh of scikit-fem does not take C1 elements.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from skfem import MeshQuad

from shellbench.problems.shell.question.folds import ASIDE, Fold
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.fem.mesh.basis import (
    COMPONENTS,
    CORNERS,
    CUBIC,
    JUMP,
    ROUNDING,
    SAME,
    Basis,
    Degree,
    Integers,
    kind_scales,
    kinds_of,
)

Array = NDArray[np.float64]

MIN_PERIODIC_CELLS = 4  # with fewer, a node meets the same neighbour on both sides


@dataclass(frozen=True)
class TensorMesh:
    """A tensor-product mesh.

    Attributes
    ----------
    domain
        The parametric rectangle that it covers.
    lines
        For each coordinate the increasing mesh lines, both ends included; of a periodic coordinate they span one
        period, from wherever the mesh begins.
    degree
        p, of the functions on a cell in each coordinate.
    folds
        Folds of the surface: mesh lines of one coordinate; in degree 4 and 5.
    """

    domain: Domain
    lines: tuple[Array, Array]
    degree: Degree = CUBIC
    folds: tuple[Fold, ...] = ()

    def __post_init__(self) -> None:
        for axis in (0, 1):
            if self.domain.periodic[axis] and len(self.lines[axis]) <= MIN_PERIODIC_CELLS:
                raise ValueError(f"a periodic coordinate needs at least {MIN_PERIODIC_CELLS} cells")

    @property
    def cells(self) -> tuple[int, int]:
        """Number of cells along each coordinate."""
        return (len(self.lines[0]) - 1, len(self.lines[1]) - 1)

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes along each coordinate."""
        first, second = (n + (not closed) for n, closed in zip(self.cells, self.domain.periodic, strict=True))
        return (first, second)

    @cached_property
    def basis(self) -> Basis:
        """Functions of a cell."""
        return Basis(self.degree, self.folds[0].axis if self.folds else None)

    @cached_property
    def kinds(self) -> tuple[tuple[int, int], ...]:
        """Degrees of freedom of a node, for each component; see `kinds_of`."""
        return kinds_of(self.basis)

    def fold_column(self, fold: Fold) -> int:
        """Return the number, along its coordinate, of the nodes of a fold."""
        away = (self.lines[fold.axis] - fold.at) / self.domain.size[fold.axis]  # a closed mesh begins anywhere
        away -= np.round(away) * self.domain.periodic[fold.axis]
        return int(np.argmin(np.abs(away))) % self.shape[fold.axis]

    def lower_sides(self, axis: int) -> Array:
        """Return the mesh lines of a coordinate, those on folds moved to their lower side."""
        line = self.lines[axis].copy()
        columns = [self.fold_column(fold) for fold in self.folds if fold.axis == axis]
        both = [len(line) - 1] if 0 in columns else []  # the seam is the first line and the last one
        line[[*columns, *both]] -= 2 * ASIDE * self.domain.size[axis]
        return line

    @cached_property
    def folded_nodes(self) -> NDArray[np.bool_]:
        """(nodes,) mask of the nodes on folds."""
        moved = [self.lower_sides(axis) != line for axis, line in enumerate(self.lines)]
        first, second = (mask[:count] for mask, count in zip(moved, self.shape, strict=True))
        return np.asarray((first[:, None] | second).ravel())

    @cached_property
    def used_dofs(self) -> NDArray[np.bool_]:
        """(nodes, (p - 1)^2) mask of the numbers that are used: at the last node no cell begins."""
        result = np.ones((*self.shape, len(self.kinds)), dtype=bool)
        for number, (k, m) in enumerate(self.kinds):
            if k > 1 and not self.domain.periodic[0]:
                result[-1, :, number] = False
            if m > 1 and not self.domain.periodic[1]:
                result[:, -1, number] = False
            if JUMP in (k, m):
                result[..., number] &= self.folded_nodes.reshape(self.shape)
        return result.reshape(self.node_count, -1)

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return self.shape[0] * self.shape[1]

    @property
    def dof_count(self) -> int:
        """Number of degrees of freedom of the nodes."""
        return COMPONENTS * len(self.kinds) * self.node_count

    @cached_property
    def grid(self) -> MeshQuad:
        """scikit-fem's mesh, before it is closed."""
        return MeshQuad.init_tensor(*self.lines)

    @cached_property
    def nodes(self) -> Integers:
        """(cells, 4) node numbers of the corners of every cell, in the order of `CORNERS`."""
        vertices = self.grid.t.T
        first, second = np.divmod(vertices, len(self.lines[1]))
        return np.asarray((first % self.shape[0]) * self.shape[1] + second % self.shape[1], dtype=np.int64)

    @cached_property
    def cell_corners(self) -> tuple[Integers, Array]:
        """(cells, 4) as `nodes`, and (cells, 2) as `sizes`; of cells the second coordinate of which runs fastest."""
        middles = (line[:-1] + np.diff(line) / 2 for line in self.lines)
        nodes, _, sizes = self.locate(np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2))
        return nodes, sizes

    @cached_property
    def origins(self) -> Array:
        """(cells, 2) lower corner of every cell."""
        return np.asarray(self.grid.p[:, self.grid.t[CORNERS.index((0, 0))]].T)

    @cached_property
    def sizes(self) -> Array:
        """(cells, 2) sides of every cell."""
        return np.asarray(self.grid.p[:, self.grid.t[CORNERS.index((1, 1))]].T) - self.origins

    @cached_property
    def node_points(self) -> Array:
        """(nodes, 2) curvilinear coordinates of the nodes."""
        first, second = (line[:count] for line, count in zip(self.lines, self.shape, strict=True))
        return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def node_scales(self) -> Array:
        """(nodes, (p - 1)^2) local length of the mesh to the power of each derivative that a node carries.

        Derivatives times these lengths have the unit of displacements, so that the stiffness matrix stays well scaled.
        """
        lengths = []
        for axis, line in enumerate(self.lines):
            h = np.diff(line)
            before, after = (h[-1:], h[:1]) if self.domain.periodic[axis] else (h[:1], h[-1:])
            mean = (np.concatenate([before, h]) + np.concatenate([h, after])) / 2
            lengths.append(mean[: self.shape[axis]])
        return kind_scales(np.stack(np.meshgrid(*lengths, indexing="ij"), axis=-1).reshape(-1, 2), self.basis)

    def edge_nodes(self, edge: Edge) -> Integers:
        """Return the nodes of an edge, or of a part of one, in the order of the running coordinate."""
        numbers = np.arange(self.node_count).reshape(self.shape)
        found = np.asarray(np.take(numbers, 0 if edge.side == "min" else -1, axis=edge.axis))
        return np.asarray(found[edge.covers(self.domain, self.node_points[found, 1 - edge.axis])])

    def edge_cells(self, edge: Edge) -> Integers:
        """Return the cells along an edge, or a part of one, in the order of the running coordinate."""
        at = self.origins[:, edge.axis] + (self.sizes[:, edge.axis] if edge.side == "max" else 0.0)
        bound = self.lines[edge.axis][0 if edge.side == "min" else -1]
        found = np.flatnonzero(np.abs(at - bound) <= ROUNDING * self.domain.size[edge.axis])
        found = found[np.argsort(self.origins[found, 1 - edge.axis])]
        middle = (self.origins + self.sizes / 2)[found, 1 - edge.axis]
        return np.asarray(found[edge.covers(self.domain, middle)])

    def node_at(self, xi: tuple[float, float]) -> int:
        """Return the node at a point, or raise ValueError if there is none."""
        point = self.into_period(np.asarray(xi))
        index = []
        for axis, line in enumerate(self.lines):
            nearest = int(np.argmin(np.abs(line - point[axis])))
            if abs(line[nearest] - point[axis]) > SAME * self.domain.size[axis]:
                raise ValueError(f"no node at {xi}")
            index.append(nearest % self.shape[axis])
        return index[0] * self.shape[1] + index[1]

    def into_period(self, points: ArrayLike) -> Array:
        """Bring points (..., 2) into the period that the mesh spans; others are left as they are."""
        xi = np.array(points, dtype=float)
        for axis, line in enumerate(self.lines):
            if self.domain.periodic[axis]:
                xi[..., axis] = line[0] + np.mod(xi[..., axis] - line[0], line[-1] - line[0])
        return xi

    def locate(self, points: ArrayLike) -> tuple[Integers, Array, Array]:
        """Find points in the mesh.

        Parameters
        ----------
        points
            (n, 2) curvilinear coordinates, anywhere in a periodic coordinate.

        Returns
        -------
        tuple
            Node numbers of the corners (n, 4) of the cells that hold the points, in the order of `CORNERS`;
            coordinates (n, 2) in the unit cell; and the cells' sizes (n, 2).
        """
        index, unit, sizes = self._find(points)
        corners = np.array(CORNERS)
        first = (index[0][:, None] + corners[:, 0]) % self.shape[0]
        second = (index[1][:, None] + corners[:, 1]) % self.shape[1]
        return first * self.shape[1] + second, unit, sizes

    def find_cells(self, points: ArrayLike) -> tuple[Integers, Array, Array]:
        """Find points as `locate` does; return their cells (n,), by number in `cell_corners`, instead of nodes."""
        index, unit, sizes = self._find(points)
        return index[0] * self.cells[1] + index[1], unit, sizes

    def _find(self, points: ArrayLike) -> tuple[Integers, Array, Array]:
        xi = self.into_period(points)
        index = np.empty((2, len(xi)), dtype=np.int64)
        unit, sizes = np.empty_like(xi), np.empty_like(xi)
        for axis, line in enumerate(self.lines):
            index[axis] = np.clip(np.searchsorted(line, xi[:, axis], side="right") - 1, 0, len(line) - 2)
            sizes[:, axis] = np.diff(line)[index[axis]]
            unit[:, axis] = (xi[:, axis] - line[index[axis]]) / sizes[:, axis]
        return index, unit, sizes
