"""Where a shell is pinned that may move as a rigid body."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.mesh import COMPONENTS

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


def determinate_pins(ties: Ties, motions: Array) -> tuple[Integers, Integers]:
    """Choose as many displacements as there are loose motions, so that holding them holds the shell.

    They are the pivots of a QR factorisation: the displacements that resist the motions best.
    """
    untied = np.setdiff1d(np.arange(len(motions)), ties.nodes)
    dofs = np.arange(COMPONENTS) * (motions.shape[1] // COMPONENTS)
    candidates = motions[untied][:, dofs].reshape(-1, motions.shape[-1])
    _, _, pivots = qr(candidates.T, mode="economic", pivoting=True)
    chosen = pivots[: motions.shape[-1]]
    return untied[chosen // COMPONENTS], dofs[chosen % COMPONENTS]
