"""The grid of a flex's vertices on a midsurface, with two triangles a cell.

This module also has mass, springs and loads of a cloth, lumped at its vertices. Densities over the area are evaluated
at the midpoints of the triangles' sides, a rule that is exact for quadratic functions. The linear shape functions
distribute them to the corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import AreaLoad, GravityLoad, PointLoad, PressureLoad
from shellbench.problems.shell.question.places import Edge, Place, Point

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

NEAR = 1e-9  # of a cell: how far a held point may lie from its vertex


@dataclass(frozen=True)
class Grid:
    """Equal cells on the parametric rectangle; each is cut from its lower left to its upper right corner.

    Attributes
    ----------
    case
        Case with the midsurface of the vertices.
    cells
        Number of cells along xi1 and xi2.
    """

    case: Case
    cells: tuple[int, int]

    @cached_property
    def points(self) -> Array:
        """(v, 2) curvilinear coordinates of the vertices; xi2 runs first."""
        first, second = self.cells
        return self.case.surface.domain.grid(first + 1, second + 1).reshape(-1, 2)

    @cached_property
    def rest(self) -> Array:
        """(v, 3) positions of the vertices at rest, m."""
        return self.case.surface.position(self.points)

    @cached_property
    def triangles(self) -> Integers:
        """(t, 3) vertices of the triangles, counter-clockwise about a1 x a2: the lower halves first, then the upper."""
        number = np.arange(len(self.points)).reshape(self.cells[0] + 1, self.cells[1] + 1)
        low, right, high, left = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        lower, upper = np.stack([low, right, high], axis=-1), np.stack([low, high, left], axis=-1)
        return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)]).astype(np.int64)

    @cached_property
    def areas(self) -> Array:
        """(t,) areas of the flat triangles at rest, m^2."""
        a, b, c = np.moveaxis(self.rest[self.triangles], 1, 0)
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=-1) / 2)

    def scattered(self, shares: Array) -> Array:
        """Add up the values of the triangles' corners, (t, 3, ...), at the vertices, (v, ...)."""
        total = np.zeros((len(self.points), *shares.shape[2:]))
        np.add.at(total, self.triangles, shares)
        return total

    def locate(self, points: ArrayLike) -> tuple[Integers, Array]:
        """Return the triangles (n,) that points (n, 2) lie in, and their barycentric coordinates (n, 3)."""
        domain, counts = self.case.surface.domain, np.array(self.cells)
        place = (np.asarray(points, dtype=float) - domain.lower) / domain.size * counts
        cell = np.clip(np.floor(place), 0, counts - 1).astype(np.int64)
        s, t = (place - cell).T
        below = s >= t
        weights = np.stack([1 - np.maximum(s, t), np.where(below, s - t, s), np.where(below, t, t - s)], axis=-1)
        number = cell[:, 0] * self.cells[1] + cell[:, 1]
        return np.where(below, number, number + counts.prod()), weights

    def vertices_on(self, place: Place) -> Integers:
        """Return the vertices on a place.

        Raises
        ------
        InputError
            If it is a point that no vertex lies on.
        """
        domain = self.case.surface.domain
        match place:
            case Edge(axis=axis):
                return np.flatnonzero(self.points[:, axis] == place.coordinate(domain))
            case Point(xi=xi):
                apart = np.abs(self.points - xi) / np.array(domain.size) * self.cells
                found = np.flatnonzero(apart.max(axis=1) <= NEAR)
                if not len(found):
                    first, second = self.cells
                    raise InputError(
                        f"field 'cells': '{place.name}' is held, and no vertex of {first} x {second} cells lies there"
                    )
                return found
            case _:
                return np.arange(len(self.points))

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """(v, 3) True if a support holds a vertex, by component."""
        held = np.zeros(self.rest.shape, dtype=bool)
        for number in range(len(self.case.supports)):
            held |= self.held_by(number)
        return held

    def held_by(self, number: int) -> NDArray[np.bool_]:
        """Return the components of each vertex that one of the case's supports holds, (v, 3)."""
        held = np.zeros(self.rest.shape, dtype=bool)
        support = self.case.supports[number]
        for name in support.on:
            vertices = self.vertices_on(self.case.places[name])
            for component in support.held:
                held[vertices, "xyz".index(component)] = True
        return held


MIDPOINTS = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])  # barycentric; each weighs a third


@dataclass(frozen=True)
class Loading:
    """Loads on the vertices of a grid beside the elastic forces."""

    grid: Grid

    @property
    def case(self) -> Case:
        """The grid's case."""
        return self.grid.case

    @cached_property
    def samples(self) -> Array:
        """(t, 3, 2) curvilinear coordinates of the midpoints of sides."""
        return np.asarray(MIDPOINTS @ self.grid.points[self.grid.triangles])

    def lumped(self, density: Array) -> Array:
        """Return the vertices' shares (v, ...) in a density per area at `samples` (t, 3, ...)."""
        shares = np.einsum("t,qa,tq...->ta...", self.grid.areas / len(MIDPOINTS), MIDPOINTS, density)
        return self.grid.scattered(shares)

    @cached_property
    def masses(self) -> Array:
        """(v,) kg."""
        return self.case.material.areal_density * self.lumped(np.ones(self.samples.shape[:2]))

    @cached_property
    def springs(self) -> Array:
        """(v, 3) stiffness, N/m."""
        return self.lumped(self.case.spring_stiffness(self.samples))

    def forces(self, t: float) -> Array:
        """Return all loads at a time as forces (v, 3) on the vertices, N."""
        total = np.zeros((len(self.grid.points), 3))
        for load in self.case.loads:
            match load:
                case AreaLoad(vector=vector):
                    total += self.lumped(self.case.evaluate(vector, self.samples, t)[0, 0])
                case GravityLoad(acceleration=vector):
                    weight = self.case.material.areal_density * self.case.evaluate(vector, self.samples, t)[0, 0]
                    total += self.lumped(weight)
                case PressureLoad(value=value):
                    x = self.case.surface.derivatives(self.samples, order=1)
                    normal = np.cross(x[1, 0], x[0, 1])
                    size = self.case.formula(value).derivatives(self.samples, 0, t)[0, 0]
                    total += self.lumped(normal * (size / np.linalg.norm(normal, axis=-1))[..., None])
                case PointLoad():
                    total += self._at_points(load, t)
        return total

    def _at_points(self, load: PointLoad, t: float) -> Array:
        total = np.zeros((len(self.grid.points), 3))
        for place in (self.case.places[name] for name in load.on):
            assert isinstance(place, Point)  # the case allows no other
            triangle, weights = self.grid.locate([place.xi])
            force = self.case.evaluate(load.force, np.array(place.xi), t)[0, 0]
            total[self.grid.triangles[triangle[0]]] += weights[0, :, None] * force
        return total
