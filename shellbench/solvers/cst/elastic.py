"""The elastic shell and its loads, as sums over vertices.

Triangles, hinges and springs make the elastic energy. Loads, springs and mass are lumped at the vertices of flat
triangles. Area loads, springs and mass are integrated on the flat triangles with the piecewise linear basis: a vertex
takes its share of each triangle around it. Forces at points are distributed by barycentric coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from skfem.quadrature import get_quadrature
from skfem.refdom import RefTri

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import AreaLoad, EdgeLoad, GravityLoad, PointLoad, PressureLoad
from shellbench.problems.shell.question.places import Edge, Point
from shellbench.solvers.cst.elements import Hinges, Membrane, Walls
from shellbench.solvers.cst.mesh import TriangleMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Elastic:
    """Membrane and bending of a mesh; strains linearised or not.

    Attributes
    ----------
    rest
        (v, 3) positions of the vertices at rest.
    """

    rest: Array
    membrane: Membrane
    hinges: Hinges
    linear: bool

    @classmethod
    def from_case(cls, case: Case, mesh: TriangleMesh) -> Elastic:
        """Put a mesh on a case's midsurface."""
        rest = case.surface.position(mesh.domain.wrap(mesh.points))
        membrane = Membrane.from_mesh(mesh, rest, case.material)
        hinges = Hinges.from_mesh(mesh, rest, membrane, case.material, Walls.from_case(case, mesh))
        return cls(rest, membrane, hinges, case.linear)

    def strain(self, displacement: Array) -> Array:
        """Return the membrane strain (t, 3) of vertex displacements (v, 3)."""
        if self.linear:
            return self.membrane.linear_strain(displacement)
        return self.membrane.strain(self.rest + displacement)

    def hinge_changes(self, displacement: Array) -> Array:
        """Return the change (h,) of the hinges' angles, radians."""
        if self.linear:
            return self.hinges.linear_angle_change(displacement)
        return self.hinges.angle_change(self.rest + displacement)

    def energies(self, displacement: Array) -> tuple[float, float]:
        """Return the membrane and the bending energy, J."""
        membrane = self.membrane.energy(self.strain(displacement)).sum()
        return float(membrane), float(self.hinges.energy(self.hinge_changes(displacement)).sum())

    def gradient(self, displacement: Array) -> Array:
        """Return the derivative (v, 3) of the energy by the vertices: the forces that hold them so, N."""
        if self.linear:
            stress = self.membrane.stresses(self.strain(displacement)) * self.membrane.areas[:, None]
            stretching = np.einsum("tsk,ts->tk", self.membrane.rest_operator, stress)
            moment = 2 * self.hinges.stiffness * self.hinge_changes(displacement)
            bending = moment[:, None] * self.hinges.rest_gradient
        else:
            positions = self.rest + displacement
            stretching, bending = self.membrane.gradient(positions), self.hinges.gradient(positions)
        total = np.zeros_like(self.hinges.rest)
        np.add.at(total, self.membrane.triangles, stretching.reshape(-1, 3, 3))
        np.add.at(total, self.hinges.vertices, bending.reshape(-1, 4, 3))
        return total[: len(self.rest)]

    def tangent_values(self, displacement: Array, definite: bool = False) -> Array:
        """Return the entries of all elements' second derivatives, in the order that `entries` names their places.

        In linear theory they are those at rest, whatever the displacement.
        """
        positions = self.rest if self.linear else self.rest + displacement
        blocks = self.membrane.hessian(positions, definite), self.hinges.hessian(positions, definite)
        return np.concatenate([block.ravel() for block in blocks])

    @cached_property
    def entries(self) -> tuple[Integers, Integers]:
        """Rows and columns of `tangent_values` among the unknowns 3 v + component, those of walls after them."""
        rows, columns = [], []
        for vertices in (self.membrane.triangles, self.hinges.vertices):
            unknowns = (3 * vertices[:, :, None] + np.arange(3)).reshape(len(vertices), -1)
            full = (*unknowns.shape, unknowns.shape[1])
            rows.append(np.broadcast_to(unknowns[:, :, None], full).ravel())
            columns.append(np.broadcast_to(unknowns[:, None, :], full).ravel())
        return np.concatenate(rows), np.concatenate(columns)


@dataclass(frozen=True)
class Pattern:
    """Places of the elements' entries in the sparse matrix of the free unknowns.

    Attributes
    ----------
    free
        (n,) unknowns 3 v + component of the matrix.
    kept
        Mask of the entries that lie in it.
    slots
        (k,) places of these among the matrix' values.
    diagonal
        (n,) places of the diagonal there.
    indices, starts
        Of scipy's compressed columns.
    """

    free: Integers
    kept: Integers
    slots: Integers
    diagonal: Integers
    indices: Integers
    starts: Integers

    @classmethod
    def from_elastic(cls, elastic: Elastic, free: Integers) -> Pattern:
        """Find the pattern of the matrix of free unknowns."""
        number = np.full(elastic.hinges.rest.size, -1)
        number[free] = np.arange(len(free))
        rows, columns = (number[index] for index in elastic.entries)
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        own = np.arange(len(free))
        keys = np.concatenate([columns[kept] * len(free) + rows[kept], own * len(free) + own])
        places, slots = np.unique(keys, return_inverse=True)
        starts = np.searchsorted(places, np.arange(len(free) + 1) * len(free))
        slots = slots.ravel()
        return cls(free, kept, slots[: len(kept)], slots[len(kept) :], places % len(free), starts)

    def matrix(self, values: Array, diagonal: Array) -> csc_array:
        """Return the matrix (n, n) of the elements' values, with a diagonal (n,) added."""
        data = np.zeros(len(self.indices)) + np.bincount(self.slots, values[self.kept], len(self.indices))
        np.add.at(data, self.diagonal, diagonal)
        return csc_array((data, self.indices, self.starts), shape=(len(self.free), len(self.free)))


AREA_ORDER = 4  # degree to which loads and springs are integrated exactly on a triangle
EDGE_POINTS = 3  # Gauss points on each side of a triangle under an edge load; exact to degree 5


@dataclass(frozen=True)
class Loading:
    """Loads, springs and masses that act on the vertices beside the elastic forces.

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
        areas = still._lump(np.ones((len(still._area_points()[0]), 1)))[:, 0]
        springs = still._lump(case.spring_stiffness(still._area_points()[0])) if case.springs else still.springs
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

    def _lump(self, density: Array) -> Array:
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
                    total += self._forces_at_places(load, t)
        return total + self._lump(density)

    def _forces_at_places(self, load: PointLoad | EdgeLoad, t: float) -> Array:
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
