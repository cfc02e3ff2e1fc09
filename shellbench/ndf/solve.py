"""Solving for the output layer: a symmetric positive definite system, with point supports as exact constraints."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.ndf.energy import NormalEquations

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
