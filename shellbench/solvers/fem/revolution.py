"""Waves that may travel around a shell of revolution: the direction in which a buckled state has no stiffness.

Where x,1 = e cross x + d, a turn about the axis e carries the midsurface into itself, and a state of equilibrium that
is not symmetric into another one of the same energy. A uniform mesh keeps that symmetry for turns by whole cells only:
in between the energy has a trace of a minimum at every cell, so that the tangent has a small eigenvalue of either sign.
Newton's method then holds the waves where they are, w . dq = 0, which costs nothing and counts for nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.symmetry import axis_of_revolution
from shellbench.solvers.fem.assembly import COMPONENTS
from shellbench.solvers.fem.hermite import KINDS
from shellbench.solvers.fem.mesh import TensorMesh

Array = NDArray[np.float64]

UNIFORM = 1e-9  # relative difference of the mesh's steps that is rounding
STILL = 1e-6  # largest change of a state by a turn, relative to its displacements, by which it is symmetric


@dataclass(frozen=True)
class Revolution:
    """A shell of revolution without loads, on a uniform mesh around its axis.

    Attributes
    ----------
    mesh
        Its mesh.
    turn
        (3, 3) rotation by one cell.
    """

    mesh: TensorMesh
    turn: Array

    @classmethod
    def from_case(cls, case: Case, mesh: TensorMesh) -> Revolution | None:
        """Return what is symmetric about a case; None if its waves could not travel."""
        steps = np.diff(mesh.lines[0])
        axis = axis_of_revolution(case) if case.surface.domain.periodic[0] else None
        if axis is None or np.ptp(steps) > UNIFORM * steps.max():
            return None
        return cls(mesh, Rotation.from_rotvec(steps[0] * axis).as_matrix())

    def direction(self, q: Array) -> Array | None:
        """Return the difference (nodes, 12) between a state turned on and turned back by a cell; None if it is none."""
        fields = q.reshape(*self.mesh.shape, COMPONENTS, len(KINDS))
        on = np.einsum("cd,ijdk->ijck", self.turn, np.roll(fields, 1, axis=0))
        back = np.einsum("dc,ijdk->ijck", self.turn, np.roll(fields, -1, axis=0))
        change = (on - back).reshape(q.shape)
        return change if np.abs(change).max() > STILL * np.abs(q).max() else None
