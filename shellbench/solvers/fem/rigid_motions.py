"""Rigid motions of a mesh: their nodal interpolants, how to pin them, and how to take their mean away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.rigid import rigid_modes
from shellbench.solvers.fem.assembly import COMPONENTS, NODE_DOFS, Quadrature, chunks, derivative_on_cells
from shellbench.solvers.fem.constraints import Ties
from shellbench.solvers.fem.hermite import KINDS
from shellbench.solvers.fem.kinematics import Midsurface
from shellbench.solvers.fem.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


def nodal_rigid_motions(case: Case, mesh: TensorMesh) -> Array:
    """Return the interpolants (nodes, 12, 6) of the rigid motions, in the scaled degrees of freedom."""
    modes = rigid_modes(case.surface, mesh.domain.wrap(mesh.node_points), order=2)
    stacked = np.stack([modes[kind] for kind in KINDS], axis=2) * mesh.node_scales[:, None, :, None]
    return np.asarray(stacked.reshape(mesh.node_count, NODE_DOFS, -1))


def determinate_pins(ties: Ties, motions: Array) -> tuple[Integers, Integers]:
    """Choose as many displacements as there are loose motions, so that holding them holds the shell.

    They are the pivots of a QR factorisation: the displacements that resist the motions best.
    """
    untied = np.setdiff1d(np.arange(len(motions)), ties.nodes)
    dofs = np.arange(COMPONENTS) * len(KINDS)
    candidates = motions[untied][:, dofs].reshape(-1, motions.shape[-1])
    _, _, pivots = qr(candidates.T, mode="economic", pivoting=True)
    chosen = pivots[: motions.shape[-1]]
    return untied[chosen // COMPONENTS], dofs[chosen % COMPONENTS]


def mean_rigid_motion(case: Case, mesh: TensorMesh, quadrature: Quadrature, coefficients: Array, loose: Array) -> Array:
    """Return the part of a field (nodes, 3, 4, states) that is a loose rigid motion in the mean over the area."""
    motions = (nodal_rigid_motions(case, mesh) @ loose).reshape(*coefficients.shape[:-1], -1)
    motions = motions / mesh.node_scales[:, None, :, None]
    fields = np.concatenate([coefficients, motions], axis=-1)
    products = np.zeros((loose.shape[1], fields.shape[-1]))
    for cells in chunks(mesh):
        points, weights = quadrature.on_cells(mesh, cells)
        flat = points.reshape(-1, 2)
        area = weights.ravel() * Midsurface.at(case.surface.derivatives(flat, order=2)).area
        exact = rigid_modes(case.surface, flat)[0, 0] @ loose
        values = derivative_on_cells(mesh, cells, quadrature, fields, (0, 0))
        weighted = (exact * area[:, None, None]).reshape(-1, loose.shape[1])
        products += weighted.T @ values.reshape(-1, fields.shape[-1])
    overlap, gram = np.split(products, [coefficients.shape[-1]], axis=1)
    return np.asarray(motions @ np.linalg.solve(gram, overlap))
