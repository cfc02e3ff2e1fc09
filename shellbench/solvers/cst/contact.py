"""Obstacles that a mesh of triangles meets in motion, by a penalty at its vertices.

As cloth simulators have it: a vertex of area A that is a depth d inside of an obstacle is pushed out along the
obstacle's normal by k A d, without friction. The step in time chooses the stiffness: k = 100 rho / dt^2, with rho the
mass per area, so that what presses with its own weight g sinks in by g dt^2 / 100.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.contact import gaps

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STIFFNESS = 100.0  # of the penalty, in units of mass over the squared step in time


@dataclass(frozen=True)
class Pressing:
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
    def in_step(cls, case: Case, points: Array, mass: Array, at: float, dt: float) -> Pressing:
        """Return them for a step in time dt, s, of vertices of mass (v,), kg."""
        return cls(case, points, STIFFNESS * mass / dt**2, at)

    def _depths(self, displacement: Array) -> tuple[Array, Array]:
        gap, normal = gaps(self.case, self.points, displacement, self.at)
        return np.maximum(-gap, 0.0), normal

    def energy(self, displacement: Array) -> float:
        """Return the energy of the penalty, J."""
        depth, _ = self._depths(displacement)
        return float(np.sum(self.stiffness * depth**2) / 2)

    def forces(self, displacement: Array) -> Array:
        """Return what obstacles exert on the vertices (v, 3), N."""
        depth, normal = self._depths(displacement)
        return (self.stiffness * depth)[:, None] * normal

    def tangent(self, displacement: Array, free: Integers) -> csc_array:
        """Return the matrix of the free unknowns, N/m, positive semidefinite: how normals turn is left out."""
        depth, normal = self._depths(displacement)
        touched = np.flatnonzero(depth)
        blocks = self.stiffness[touched, None, None] * normal[touched, :, None] * normal[touched, None, :]
        unknowns = 3 * touched[:, None] + np.arange(3)
        rows, columns = np.repeat(unknowns, 3, axis=1).ravel(), np.tile(unknowns, 3).ravel()
        size = displacement.size
        return csc_array((blocks.ravel(), (rows, columns)), shape=(size, size))[free][:, free]
