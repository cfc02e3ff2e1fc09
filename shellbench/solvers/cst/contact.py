"""Obstacles that a mesh of triangles meets in motion, by a penalty at its vertices.

As in cloth simulators, a vertex of area A at a depth d inside an obstacle is pushed out along the obstacle's normal by
k A d, without friction. The step in time determines the stiffness: k = 100 rho / dt^2, with rho the mass per area. A
vertex that presses with its own weight then sinks in by g dt^2 / 100.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import gaps

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STIFFNESS = 100.0  # of the penalty, in units of mass over the squared step in time


@dataclass(frozen=True)
class Obstacles:
    """The obstacles of a case at one time.

    Attributes
    ----------
    points
        (v, 2) of the vertices.
    stiffness
        (v,) k A, N/m.
    at
        s.
    """

    case: Case
    points: Array
    stiffness: Array
    at: float

    @classmethod
    def in_step(cls, case: Case, points: Array, mass: Array, at: float, dt: float) -> Obstacles:
        """Return the obstacles for a step in time dt, s, of vertices of mass (v,), kg."""
        return cls(case, points, STIFFNESS * mass / dt**2, at)

    def _depths(self, displacement: Array) -> Iterator[tuple[Array, Array]]:
        """Yield depths (v,), m, and normals (v, 3) for each obstacle: a vertex in a corner is pushed by both sides."""
        for obstacle in self.case.obstacles:
            alone = self.case.model_copy(update={"obstacles": (obstacle,)})
            gap, normal = gaps(alone, self.points, displacement, self.at)
            yield np.maximum(-gap, 0.0), normal

    def energy(self, displacement: Array) -> float:
        """Return the energy of the penalty, J."""
        return sum(float(np.sum(self.stiffness * depth**2) / 2) for depth, _ in self._depths(displacement))

    def forces(self, displacement: Array) -> Array:
        """Return the contact forces (v, 3) of obstacles on the vertices, N."""
        total = np.zeros_like(displacement)
        for depth, normal in self._depths(displacement):
            total += (self.stiffness * depth)[:, None] * normal
        return total

    def tangent(self, displacement: Array, free: Integers) -> csc_array:
        """Return the matrix of the free unknowns, N/m, without the turning of normals: positive semidefinite."""
        blocks = np.zeros((len(displacement), 3, 3))
        for depth, normal in self._depths(displacement):
            blocks += (self.stiffness * (depth > 0))[:, None, None] * normal[:, :, None] * normal[:, None, :]
        touched = np.flatnonzero(blocks.any(axis=(1, 2)))
        unknowns = 3 * touched[:, None] + np.arange(3)
        rows, columns = np.repeat(unknowns, 3, axis=1).ravel(), np.tile(unknowns, 3).ravel()
        size = displacement.size
        return csc_array((blocks[touched].ravel(), (rows, columns)), shape=(size, size))[free][:, free]
