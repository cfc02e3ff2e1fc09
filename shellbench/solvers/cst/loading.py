"""Loads, springs and mass, lumped at the vertices of flat triangles.

Whatever is spread over the area is integrated on the flat triangles with the piecewise linear basis: a vertex takes
its share of each triangle around it. Forces at points are shared out by barycentric coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import AreaLoad, EdgeLoad, GravityLoad, PointLoad, PressureLoad
from shellbench.problems.shell.places import Edge, Point
from shellbench.solvers.cst.elastic import Elastic
from shellbench.solvers.cst.mesh import TriangleMesh

Array = NDArray[np.float64]

AREA_ORDER = 4  # degree to which loads and springs are integrated exactly on a triangle
EDGE_POINTS = 3  # Gauss points on each side of a triangle under an edge load; exact to degree 5


@dataclass(frozen=True)
class Loading:
    """What acts on the vertices beside the elastic forces.

    Attributes
    ----------
    areas
        (v,) a third of the triangles around each vertex, m^2.
    springs
        (v, 3) lumped stiffness, N/m.
    """

    case: Case
    mesh: TriangleMesh
    elastic: Elastic
    areas: Array
    springs: Array

    @classmethod
    def from_case(cls, case: Case, mesh: TriangleMesh, elastic: Elastic) -> Loading:
        """Lump areas and springs."""
        still = cls(case, mesh, elastic, np.zeros(mesh.vertex_count), np.zeros((mesh.vertex_count, 3)))
        areas = still._lumped(np.ones((len(still._area_points()[0]), 1)))[:, 0]
        springs = still._lumped(case.spring_stiffness(still._area_points()[0])) if case.springs else still.springs
        return cls(case, mesh, elastic, areas, springs)

    @property
    def mass(self) -> Array:
        """(v,) kg."""
        return self.areas * self.case.material.areal_density

    def _area_points(self) -> tuple[Array, Array, Array]:
        """Return points (t q, 2), barycentric coordinates (q, 3) and weights (q,) that add up to 1."""
        local, weights = get_quadrature(RefTri, AREA_ORDER)
        bary = np.stack([1 - local.sum(axis=0), *local], axis=-1)
        points = np.einsum("qa,tak->tqk", bary, self.mesh.corners).reshape(-1, 2)
        return self.mesh.domain.wrap(points), bary, weights / weights.sum()

    def _lumped(self, density: Array) -> Array:
        """Return the shares (v, k) of the vertices in densities (t q, k) per area."""
        _, bary, weights = self._area_points()
        membrane = self.elastic.membrane
        per_triangle = density.reshape(len(membrane.areas), len(weights), -1)
        shares = np.einsum("t,q,qa,tqk->tak", membrane.areas, weights, bary, per_triangle)
        total = np.zeros((self.mesh.vertex_count, density.shape[-1]))
        np.add.at(total, membrane.triangles, shares)
        return total

    def forces(self, t: float) -> Array:
        """Return all loads at a time or load factor as forces (v, 3) at the vertices, N."""
        points = self._area_points()[0]
        density = np.zeros((len(points), 3))
        total = np.zeros((self.mesh.vertex_count, 3))
        for load in self.case.loads:
            match load:
                case AreaLoad(vector=vector):
                    density += self.case.evaluate(vector, points, t)[0, 0]
                case GravityLoad(acceleration=acceleration):
                    density += self.case.material.areal_density * self.case.evaluate(acceleration, points, t)[0, 0]
                case PressureLoad(value=value):
                    x = self.case.surface.derivatives(points, order=1)
                    across = np.cross(x[1, 0], x[0, 1])
                    across /= np.linalg.norm(across, axis=-1, keepdims=True)
                    density += self.case.formula(value).derivatives(points, 0, t)[0, 0][..., None] * across
                case PointLoad() | EdgeLoad():
                    total += self._placed(load, t)
        return total + self._lumped(density)

    def _placed(self, load: PointLoad | EdgeLoad, t: float) -> Array:
        total = np.zeros((self.mesh.vertex_count, 3))
        for name in load.on:
            place = self.case.places[name]
            if isinstance(load, PointLoad) and isinstance(place, Point):
                points = np.array([place.xi])
                forces = self.case.evaluate(load.force, points, t)[0, 0]
            elif isinstance(load, EdgeLoad) and isinstance(place, Edge):
                points, lengths = self._edge_points(place)
                forces = self.case.evaluate(load.vector, points, t)[0, 0] * lengths[:, None]
            else:  # the case allows none
                continue
            triangle, weights = self.mesh.locate(points)
            np.add.at(total, self.mesh.triangles[triangle], weights[:, :, None] * forces[:, None, :])
        return total

    def _edge_points(self, edge: Edge) -> tuple[Array, Array]:
        """Return points (n, 2) on an edge, and the length (n,) of the straight sides that each stands for."""
        running = 1 - edge.axis
        count, low = self.mesh.cells[running], self.mesh.domain.lower[running]
        x, w = np.polynomial.legendre.leggauss(EDGE_POINTS)
        places = low + (np.arange(count)[:, None] + (x + 1) / 2).ravel() * self.mesh.steps[running]
        vertices = self.mesh.edge_vertices(edge)
        ends = np.append(vertices, vertices[:1]) if self.mesh.domain.periodic[running] else vertices
        lengths = np.linalg.norm(np.diff(self.elastic.rest[ends], axis=0), axis=1)
        return edge.points(self.mesh.domain, places), np.outer(lengths, w / 2).ravel()
