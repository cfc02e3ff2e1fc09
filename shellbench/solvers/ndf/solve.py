"""Solving for the output layer: a symmetric positive definite system, with point supports as exact constraints."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.energy import NormalEquations
from shellbench.solvers.ndf.field import Ansatz, Features
from shellbench.solvers.ndf.jets import VALUE
from shellbench.solvers.ndf.regularised import IndefiniteError, RegularisedInverse
from shellbench.solvers.ndf.supports import point_supports

JITTER = 1e-12  # on the unit diagonal: ten times what rounding leaves of the matrix, so that it decides nothing


@dataclass(frozen=True)
class OutputLayer:
    """The solved output weights.

    Attributes
    ----------
    weights
        (3 M,).
    reactions
        (k,): the forces that hold the constraints, N.
    unbalanced
        Work of the loads that what was added to the diagonal has left without resistance, J.
    """

    weights: Tensor
    reactions: Tensor
    unbalanced: float


def solve_output(equations: NormalEquations, constraints: Tensor, targets: Tensor, stiffness: float) -> OutputLayer:
    """Minimise the energy subject to `constraints` (k, 3 M) w = `targets` (k,), metres.

    `stiffness` (N/m) weighs the constraints in the matrix, where they only serve its definiteness: they are held
    exactly by Lagrange multipliers.

    Raises
    ------
    SolveFailure
        If the matrix is not finite, or not positive semidefinite.
    """
    matrix = equations.stiffness + equations.anchor.T @ equations.anchor + stiffness * constraints.T @ constraints
    load = equations.load + stiffness * constraints.T @ targets
    if not bool(torch.isfinite(matrix).all()):
        raise SolveFailure("the energy of the features is not finite")
    try:
        inverse = RegularisedInverse.from_matrix(matrix, JITTER)
    except IndefiniteError:
        raise SolveFailure("the normal matrix of the output layer is not positive definite") from None
    weights = (inverse @ load[:, None])[:, 0]
    multipliers = load.new_zeros(len(constraints))
    if len(constraints):
        response = inverse @ constraints.T
        compliance = constraints @ response
        for _ in range(2):  # once more for the rounding of large weights
            change = torch.linalg.solve(compliance, constraints @ weights - targets)
            weights, multipliers = weights - response @ change, multipliers + change
    left = load - constraints.T @ multipliers - matrix @ weights
    return OutputLayer(weights, -multipliers, 0.5 * abs(float(weights @ left)))


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
