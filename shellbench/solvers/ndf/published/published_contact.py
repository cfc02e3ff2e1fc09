"""The published loss of collisions: Kairanda et al., equation (75).

    lambda |Omega| / (N_Omega N_t) sum_ij max(eps - phi(x(xi_i, t_j)), 0),  lambda = 1000, eps = .001 m

It is linear in the depth: an obstacle presses with lambda, in N/m^2, wherever the shell is nearer than eps, and with
nothing elsewhere. Areas are those of the midsurface, as in the functional (35), and phi is the case's own distance: the
paper fits a network to it.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import gaps
from shellbench.solvers.ndf.field.jets import Array

WEIGHT = 1000.0  # lambda, N/m^2
MARGIN = 1e-3  # eps, m


def collision(case: Case, points: Array, times: Array, displacement: Tensor) -> Tensor:
    """Return lambda max(eps - phi, 0) (T, N), N/m, of a displacement (T, N, 3) at points (N, 2) and times (T,), s."""
    where = displacement.detach().cpu().double().numpy()
    found = [gaps(case, points, u, float(t)) for u, t in zip(where, times, strict=True)]
    gap, normal = (displacement.new_tensor(np.stack(part)) for part in zip(*found, strict=True))
    along = ((displacement - displacement.detach()) * normal).sum(-1)  # zero; its derivative is that of phi
    return WEIGHT * torch.relu(MARGIN - gap - along)


def pressing(case: Case, points: Array, areas: Array, t: float, displacement: Array) -> Array:
    """Return what the loss presses with (N, 3), N, at points (N, 2) that stand for areas (N,), m^2, at a time t, s."""
    gap, normal = gaps(case, points, displacement, t)
    return np.asarray(WEIGHT * (areas * (gap < MARGIN))[:, None] * normal)
