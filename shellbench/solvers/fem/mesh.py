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

from shellbench.problems.shell.places import Edge
from shellbench.problems.shell.surface import Domain
from shellbench.solvers.fem.hermite import CORNERS, kind_scales

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

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
    """

    domain: Domain
    lines: tuple[Array, Array]

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

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return self.shape[0] * self.shape[1]

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
        """(nodes, 4) local length of the mesh to the power of each derivative that a node carries.

        Derivatives times these lengths are all displacements, and the stiffness matrix stays well scaled.
        """
        lengths = []
        for axis, line in enumerate(self.lines):
            h = np.diff(line)
            before, after = (h[-1:], h[:1]) if self.domain.periodic[axis] else (h[:1], h[-1:])
            mean = (np.concatenate([before, h]) + np.concatenate([h, after])) / 2
            lengths.append(mean[: self.shape[axis]])
        return kind_scales(np.stack(np.meshgrid(*lengths, indexing="ij"), axis=-1).reshape(-1, 2))

    def edge_nodes(self, edge: Edge) -> Integers:
        """Return the nodes of an edge in the order of the running coordinate."""
        numbers = np.arange(self.node_count).reshape(self.shape)
        return np.asarray(np.take(numbers, 0 if edge.side == "min" else -1, axis=edge.axis))

    def edge_cells(self, edge: Edge) -> Integers:
        """Return the cells along an edge in the order of the running coordinate."""
        at = self.origins[:, edge.axis] + (self.sizes[:, edge.axis] if edge.side == "max" else 0.0)
        bound = self.lines[edge.axis][0 if edge.side == "min" else -1]
        found = np.flatnonzero(np.abs(at - bound) <= 1e-12 * self.domain.size[edge.axis])
        return np.asarray(found[np.argsort(self.origins[found, 1 - edge.axis])])

    def node_at(self, xi: tuple[float, float]) -> int:
        """Return the node at a point, or raise ValueError if there is none."""
        point = self.brought_in(np.asarray(xi))
        index = []
        for axis, line in enumerate(self.lines):
            nearest = int(np.argmin(np.abs(line - point[axis])))
            if abs(line[nearest] - point[axis]) > 1e-9 * self.domain.size[axis]:
                raise ValueError(f"no node at {xi}")
            index.append(nearest % self.shape[axis])
        return index[0] * self.shape[1] + index[1]

    def brought_in(self, points: ArrayLike) -> Array:
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
        xi = self.brought_in(points)
        index = np.empty((2, len(xi)), dtype=np.int64)
        unit, sizes = np.empty_like(xi), np.empty_like(xi)
        for axis, line in enumerate(self.lines):
            index[axis] = np.clip(np.searchsorted(line, xi[:, axis], side="right") - 1, 0, len(line) - 2)
            sizes[:, axis] = np.diff(line)[index[axis]]
            unit[:, axis] = (xi[:, axis] - line[index[axis]]) / sizes[:, axis]
        corners = np.array(CORNERS)
        first = (index[0][:, None] + corners[:, 0]) % self.shape[0]
        second = (index[1][:, None] + corners[:, 1]) % self.shape[1]
        return first * self.shape[1] + second, unit, sizes
