"""Mass, springs and loads of a cloth, lumped at its vertices.

What is spread over the area is taken at the midpoints of the triangles' sides, a rule that is exact for quadratic
functions, and shared among the corners by the linear shape functions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import AreaLoad, GravityLoad, PointLoad, PressureLoad
from shellbench.problems.shell.places import Point
from shellbench.solvers.mujoco.grid import Grid

Array = NDArray[np.float64]

MIDPOINTS = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])  # barycentric; each weighs a third


@dataclass(frozen=True)
class Loading:
    """What acts on the vertices of a grid beside the elastic forces."""

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
