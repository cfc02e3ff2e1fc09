"""Gauss rules on the cells of a mesh and along its edges."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from skfem.quadrature import get_quadrature
from skfem.refdom import Refdom

from shellbench.problems.shell.question.places import Edge
from shellbench.solvers.fem.mesh.basis import Basis, Derivative, gauss_rule, kind_scales, tabulate
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

CHUNK = 64  # cells that are integrated at once: 12 MB in degree 5; 512 would take thrice the time, for their memory


@dataclass(frozen=True)
class Quadrature:
    """Gauss points of the unit cell, from scikit-fem.

    Attributes
    ----------
    points, weights
        (n, 2) and (n,).
    """

    points: Array
    weights: Array

    @classmethod
    def of_order(cls, mesh: TensorMesh, order: int) -> Quadrature:
        """Return the rule that is exact for polynomials of this degree in each coordinate."""
        return _quadrature(mesh.grid.refdom, order)

    @cached_property
    def table(self) -> Callable[[tuple[Derivative, ...], Basis], Array]:
        """(n orders, functions) derivatives of the unit cell's basis, by order (fast) and by basis: made once."""

        def tabulated(orders: tuple[Derivative, ...], basis: Basis) -> Array:
            tables = [tabulate(self.points, d, basis).reshape(len(self.points), -1) for d in orders]
            return np.stack(tables, axis=1).reshape(-1, tables[0].shape[-1])

        return cache(tabulated)

    def on_cells(self, mesh: TensorMesh, cells: slice | Integers) -> tuple[Array, Array]:
        """Return points (cells, n, 2) in the domain and weights (cells, n) with the cells' parametric area."""
        sizes = mesh.sizes[cells]
        points = mesh.origins[cells][:, None] + self.points * sizes[:, None]
        return mesh.domain.wrap(points), self.weights * np.prod(sizes, axis=-1, keepdims=True)


@cache
def _quadrature(unit_cell: type[Refdom], order: int) -> Quadrature:
    points, weights = get_quadrature(unit_cell, order)
    return Quadrature(np.ascontiguousarray(points.T), weights)


@dataclass(frozen=True)
class EdgeRule:
    """Gauss points along an edge, on the cells beside it: c cells with g points each.

    Attributes
    ----------
    cells, sizes
        (c,) numbers of the cells, and (c, 2) their sizes.
    unit, weights
        (g, 2) points on a side of the unit cell, and (g,) their weights, which sum up to 2.
    points
        (c g, 2) in the domain.
    """

    cells: Integers
    sizes: Array
    unit: Array
    weights: Array
    points: Array

    @classmethod
    def on_edge(cls, mesh: TensorMesh, edge: Edge, count: int) -> EdgeRule:
        """Put so many points on the side of each cell."""
        cells = mesh.edge_cells(edge)
        # The edge is a side of the unit cell: 0 or 1 in its fixed coordinate, all of the other one.
        x, w = gauss_rule(count)
        unit = np.full((count, 2), float(edge.side == "max"))
        unit[:, 1 - edge.axis] = (x + 1) / 2
        sizes = mesh.sizes[cells]
        points = mesh.domain.wrap(mesh.origins[cells][:, None] + unit * sizes[:, None])
        return cls(cells, sizes, unit, w, points.reshape(-1, 2))


def cell_portions(mesh: TensorMesh, size: int = CHUNK) -> Iterator[slice]:
    """Yield the cells of a mesh in portions."""
    count = len(mesh.nodes)
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def basis_scales(mesh: TensorMesh, cells: slice) -> Array:
    """Return the factors (cells, 4, (p - 1)^2) from the unit cell's basis to the scaled degrees of freedom."""
    return kind_scales(mesh.sizes[cells], mesh.basis)[:, None] / mesh.node_scales[mesh.nodes[cells]]
