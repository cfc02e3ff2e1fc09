"""Solving for the output layer: a symmetric positive definite system, with point supports as exact constraints."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.ndf.energy import NormalEquations
from shellbench.ndf.field import Ansatz, Features
from shellbench.ndf.jets import VALUE
from shellbench.ndf.supports import point_supports

JITTER = 1e-14  # on the unit diagonal: a few times the rounding of the matrix itself
MAX_JITTER = 1e-6  # beyond this the answer would be the jitter's


@dataclass(frozen=True)
class OutputLayer:
    """The solved output weights.

    Attributes
    ----------
    weights
        (3 M,).
    reactions
        (k,): the forces that hold the constraints, N.
    jitter
        What had to be added to the scaled diagonal.
    """

    weights: Tensor
    reactions: Tensor
    jitter: float


def solve_output(equations: NormalEquations, constraints: Tensor, targets: Tensor, stiffness: float) -> OutputLayer:
    """Minimise the energy subject to `constraints` (k, 3 M) w = `targets` (k,), metres.

    `stiffness` (N/m) weighs the constraints in the matrix, where they only serve its definiteness: they are held
    exactly by Lagrange multipliers.

    Raises
    ------
    SolveFailure
        If the matrix is not finite or not positive definite.
    """
    matrix = equations.stiffness + equations.anchor.T @ equations.anchor + stiffness * constraints.T @ constraints
    load = equations.load + stiffness * constraints.T @ targets
    if not bool(torch.isfinite(matrix).all()):
        raise SolveFailure("the energy of the features is not finite")
    diagonal = matrix.diagonal().clamp_min(0.0).sqrt()
    scale = torch.where(diagonal > 0, 1 / diagonal, torch.zeros_like(diagonal))
    factor, jitter = _cholesky(matrix * scale[:, None] * scale)

    def inverse(right: Tensor) -> Tensor:
        return torch.cholesky_solve(right * scale[:, None], factor) * scale[:, None]

    weights = inverse(load[:, None])[:, 0]
    if not len(constraints):
        return OutputLayer(weights, load.new_zeros(0), jitter)
    response = inverse(constraints.T)
    compliance = constraints @ response
    multipliers = torch.linalg.solve(compliance, constraints @ weights - targets)
    weights = weights - response @ multipliers
    correction = torch.linalg.solve(compliance, constraints @ weights - targets)  # rounding of large weights
    return OutputLayer(weights - response @ correction, -(multipliers + correction), jitter)


def _cholesky(scaled: Tensor) -> tuple[Tensor, float]:
    jitter = JITTER
    while jitter <= MAX_JITTER:
        scaled.diagonal().fill_(1 + jitter)
        factor, info = torch.linalg.cholesky_ex(scaled)
        if int(info) == 0:
            return factor, jitter
        jitter *= 10
    raise SolveFailure("the normal matrix of the output layer is not positive definite")


def potential_energy(equations: NormalEquations, weights: Tensor) -> float:
    """Return the potential energy of output weights (3 M,) on the rule of the equations, J."""
    return float(0.5 * weights @ (equations.stiffness @ weights) - equations.load @ weights) + equations.constant


def solve_nested(ansatz: Ansatz, features: Features, equations: NormalEquations, width: int) -> OutputLayer:
    """Solve for the weights of the first `width` network features and all fixed ones; the others are zero."""
    total, hidden = features.count, features.network.width
    each = np.concatenate([np.arange(width), np.arange(hidden, total)])
    kept = torch.as_tensor(np.concatenate([each + c * total for c in range(3)]), device=equations.load.device)
    constraints, targets = point_constraints(ansatz, features)
    part = NormalEquations(
        equations.stiffness[kept][:, kept], equations.load[kept], equations.anchor[:, kept], equations.constant
    )
    solved = solve_output(part, constraints[:, kept], targets, ansatz.case.material.membrane_stiffness)
    weights = torch.zeros_like(equations.load)
    weights[kept] = solved.weights
    return replace(solved, weights=weights)


def point_constraints(ansatz: Ansatz, features: Features) -> tuple[Tensor, Tensor]:
    """Return rows (k, 3 M) and targets (k,), metres, that hold the point supports."""
    placement, supports = features.placement, point_supports(ansatz.case, ansatz.t)
    points = np.array([s.point.xi for s in supports]).reshape(-1, 2)
    if not supports or ansatz.soft:
        return features.network.weights[0].new_zeros((0, 3 * features.count)), placement.tensor(np.zeros(0))
    components = [s.component for s in supports]
    index = torch.arange(len(supports), device=placement.device)
    held = ansatz.factors.matrix(points, placement)[VALUE][index, components]
    rows = (held[:, :, None] * features.values(points)[:, None, :]).reshape(len(supports), -1)
    lift = ansatz.lift.jet(points, placement)[VALUE][index, components]
    return rows, placement.tensor(np.array([s.value for s in supports])) - lift
