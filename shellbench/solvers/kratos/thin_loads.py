"""Loads as forces and moments on nodes.

Loads on the area and on edges are consistent with bilinear displacements, by Gauss' rule on the true midsurface and
its true edges. They put no moments on nodes, as the element has no shape functions of its own between its nodes;
the difference is of second order in the cells' size, as the element's own error. A point load acts on its node.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import EdgeLoad, MomentLoad, PointLoad
from shellbench.problems.shell.measure import load_density
from shellbench.problems.shell.places import Edge, Point
from shellbench.solvers.kratos.thin_mesh import QuadMesh, bilinear
from shellbench.solvers.kratos.thin_supports import node_at

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

GAUSS_POINTS = 3  # along a side of a cell; exact to degree 5


@dataclass(frozen=True)
class Loads:
    """What acts on the nodes of a shell.

    Attributes
    ----------
    case, mesh
        What is solved, the case of a part for one, and its mesh.
    """

    case: Case
    mesh: QuadMesh

    @cached_property
    def _rule(self) -> tuple[Array, Array, Array]:
        """Points (e q, 2), the corners' shares (q, 4) and the areas (e, q) that points stand for, m^2."""
        x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        places = np.stack(np.meshgrid((x + 1) / 2, (x + 1) / 2, indexing="ij"), axis=-1).reshape(-1, 2)
        corners = np.stack([a.ravel() for a in np.indices(self.mesh.cells)], axis=-1)
        points = (self.mesh.lower + (corners[:, None] + places) * self.mesh.steps).reshape(-1, 2)
        tangents = self.case.surface.derivatives(points, order=1)
        stretch = np.linalg.norm(np.cross(tangents[1, 0], tangents[0, 1]), axis=-1)
        weights = np.outer(w, w).ravel() / 4 * np.prod(self.mesh.steps)
        return points, bilinear(places), stretch.reshape(len(corners), -1) * weights

    def _shared(self, density: Array) -> Array:
        """Return the shares (v, k) of the nodes in densities (e q, k) per area."""
        _, shares, areas = self._rule
        by_corner = np.einsum("qa,eq,eqk->eak", shares, areas, density.reshape(*areas.shape, -1))
        total = np.zeros((self.mesh.node_count, density.shape[-1]))
        np.add.at(total, self.mesh.quads, by_corner)
        return total

    @cached_property
    def areas(self) -> Array:
        """(v,) the midsurface that each node stands for, m^2."""
        return self._shared(np.ones((len(self._rule[0]), 1)))[:, 0]

    def forces(self, t: float) -> Array:
        """Return forces and moments (v, 6) at a load factor, N and N m."""
        case = self.case
        total = np.zeros((self.mesh.node_count, 6))
        total[:, :3] = self._shared(load_density(case, self._rule[0], t))
        for load in case.loads:
            for name in load.on if isinstance(load, EdgeLoad | MomentLoad | PointLoad) else ():
                place = case.places[name]
                if isinstance(load, PointLoad) and isinstance(place, Point):
                    force = case.evaluate(load.force, np.asarray(place.xi), t)[0, 0]
                    total[node_at(place, self.mesh), :3] += force
                elif isinstance(load, EdgeLoad | MomentLoad) and isinstance(place, Edge):
                    columns = slice(0, 3) if isinstance(load, EdgeLoad) else slice(3, 6)
                    total[:, columns] += self._on_edge(place, load, t)
        return total

    def _on_edge(self, edge: Edge, load: EdgeLoad | MomentLoad, t: float) -> Array:
        """Return the shares (v, 3) of nodes in a load on an edge."""
        total = np.zeros((self.mesh.node_count, 3))
        case, running = self.case, 1 - edge.axis
        x, w = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        local = (x + 1) / 2
        count, step = self.mesh.cells[running], self.mesh.steps[running]
        places = self.mesh.lower[running] + (np.arange(count)[:, None] + local).ravel() * step
        points = edge.points(case.surface.domain, places)
        tangent = case.surface.derivatives(points, order=1)[(0, 1) if running == 1 else (1, 0)]
        lengths = np.linalg.norm(tangent, axis=-1) * np.tile(w / 2 * step, count)
        if isinstance(load, EdgeLoad):
            density = case.evaluate(load.vector, points, t)[0, 0]
        else:
            axis = np.asarray(load.axis) / np.linalg.norm(load.axis)
            density = case.formula(load.value).derivatives(points, 0, t)[0, 0][:, None] * axis
        parts = (lengths[:, None] * density).reshape(count, GAUSS_POINTS, 3)
        nodes = self.mesh.edge(edge.axis, edge.side == "max")
        ends = np.append(nodes, nodes[:1]) if self.mesh.closed[running] else nodes
        np.add.at(total, ends[:-1], np.einsum("q,nqc->nc", 1 - local, parts))
        np.add.at(total, ends[1:], np.einsum("q,nqc->nc", local, parts))
        return total
