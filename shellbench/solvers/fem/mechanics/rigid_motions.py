"""Rigid motions of a mesh: their nodal interpolants, and pins against them.

The module also treats waves that may travel around a shell of revolution: a direction in which a buckled state has no
stiffness.

If x,1 = e cross x + d, a turn about the axis e carries the midsurface into itself. It carries an unsymmetric state of
equilibrium into another one of the same energy. A uniform mesh keeps this symmetry for turns by whole cells only. In
between, the energy has a slight minimum at every cell, so that the tangent has a small eigenvalue of either sign.
Newton's method then fixes the waves, w . dq = 0; this needs no force.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.spatial.transform import Rotation

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import middle_and_size, motions_of
from shellbench.problems.shell.symmetry.symmetry import axis_of_revolution
from shellbench.solvers.fem.mesh.basis import COMPONENTS, CUBIC, KINDS, SAME, Derivative
from shellbench.solvers.fem.mesh.bubbles import interpolation_coefficients
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Largest change of a state by a turn, relative to its displacements, at which it counts as symmetric. Newton's method
# leaves less, and waves of a buckled shell change by more.
SYMMETRIC_STATE = 1e-6


def nodal_rigid_motions(case: Case, mesh: TensorMesh) -> Array:
    """Return the interpolants (nodes, 3 (p - 1)^2, 6) of the rigid motions, in the scaled degrees of freedom."""
    # The position is interpolated instead of the motions: they are linear in it, and twice as many functions.
    centre, size = middle_and_size(case.surface)

    def arms(points: Array) -> Mapping[Derivative, Array]:
        x = case.surface.derivatives(mesh.domain.wrap(points), order=2)
        return {key: (value - centre if key == (0, 0) else value) / size for key, value in x.items()}

    if mesh.degree == CUBIC:
        at = arms(mesh.node_points)
        nodal = np.stack([at[kind] for kind in KINDS], axis=1)
    else:
        nodal = np.swapaxes(interpolation_coefficients(mesh, arms), 1, 2)
    motions = motions_of(nodal, False)
    motions[:, KINDS.index((0, 0)), :, :COMPONENTS] = np.eye(COMPONENTS)
    scaled = np.swapaxes(motions, 1, 2) * mesh.node_scales[:, None, :, None]
    return np.asarray(scaled.reshape(mesh.node_count, COMPONENTS * len(mesh.kinds), -1))


def determinate_pins(tied: Integers, motions: Array) -> tuple[Integers, Integers]:
    """Choose as many displacements as there are loose motions, so that holding them holds the shell.

    Nodes with supports, `tied`, have no pins.

    The pins are the pivots of a QR factorisation: the displacements that resist the motions best.
    """
    untied = np.setdiff1d(np.arange(len(motions)), tied)
    dofs = np.arange(COMPONENTS) * (motions.shape[1] // COMPONENTS)
    candidates = motions[untied][:, dofs].reshape(-1, motions.shape[-1])
    _, _, pivots = qr(candidates.T, mode="economic", pivoting=True)
    chosen = pivots[: motions.shape[-1]]
    return untied[chosen // COMPONENTS], dofs[chosen % COMPONENTS]


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
        """Return the shell of revolution of a case; None if waves can't travel around it."""
        steps = np.diff(mesh.lines[0])
        axis = axis_of_revolution(case) if case.surface.domain.periodic[0] else None
        if axis is None or np.ptp(steps) > SAME * steps.max():
            return None
        return cls(mesh, Rotation.from_rotvec(steps[0] * axis).as_matrix())

    def wave_direction(self, q: Array) -> Array | None:
        """Return the difference (nodes, 12) of a state turned forward and back by a cell; None if it is symmetric."""
        fields = q.reshape(*self.mesh.shape, COMPONENTS, len(KINDS))
        on = np.einsum("cd,ijdk->ijck", self.turn, np.roll(fields, 1, axis=0))
        back = np.einsum("dc,ijdk->ijck", self.turn, np.roll(fields, -1, axis=0))
        change = (on - back).reshape(q.shape)
        return change if np.abs(change).max() > SYMMETRIC_STATE * np.abs(q).max() else None
