"""Solving for the output layer: a symmetric positive definite system, with supports as exact constraints."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.jets import Integers
from shellbench.solvers.ndf.field.supports import point_supports
from shellbench.solvers.ndf.linear.constraints import SAME_ROW, point_constraints, slope_constraints
from shellbench.solvers.ndf.linear.regularised import JITTER, IndefiniteError, RegularisedInverse
from shellbench.solvers.ndf.strains.energy import NormalEquations


@dataclass(frozen=True)
class OutputLayer:
    """The solved output weights.

    Attributes
    ----------
    weights
        (3 M,).
    reactions
        (k,): the forces that hold the constraints, N, those of the point supports first.
    unbalanced
        Work of the loads left unbalanced by the number added to the diagonal, J.
    """

    weights: Tensor
    reactions: Tensor
    unbalanced: float


@dataclass(frozen=True)
class HeldInverse:
    """The inverse of an energy's matrix among weights (n,) that hold constraints.

    Attributes
    ----------
    matrix, load
        (n, n) and (n,), the constraints' part included.
    constraints, targets
        (k, n) and (k,), metres.
    inverse
        Of the matrix.
    response, inverted
        (n, k) response of the weights to forces of the constraints, and (k, k) from the constraints' errors to their
        forces.
    """

    matrix: Tensor
    load: Tensor
    constraints: Tensor
    targets: Tensor
    inverse: RegularisedInverse
    response: Tensor
    inverted: Tensor

    @classmethod
    def from_equations(
        cls, equations: NormalEquations, constraints: Tensor, targets: Tensor, stiffness: float, level: float
    ) -> HeldInverse:
        """Factorise; see `solve_output`."""
        matrix = equations.stiffness + equations.anchor.T @ equations.anchor + stiffness * constraints.T @ constraints
        load = equations.load + stiffness * constraints.T @ targets
        if not bool(torch.isfinite(matrix).all()):
            raise SolveFailure("the energy of the features is not finite")
        try:
            inverse = RegularisedInverse.from_matrix(matrix, level)
        except IndefiniteError:
            raise SolveFailure("the normal matrix of the output layer is not positive definite") from None
        response = inverse @ constraints.T
        compliance = constraints @ response
        inverted = compliance
        if len(constraints):
            inverted = torch.linalg.pinv((compliance + compliance.T) / 2, rtol=SAME_ROW, hermitian=True)
        return cls(matrix, load, constraints, targets, inverse, response, inverted)

    def solve(self, loads: Tensor, targets: Tensor) -> tuple[Tensor, Tensor]:
        """Return the weights (n, m) under loads (n, m) that hold targets (k, m), and multipliers (k, m)."""
        weights = self.inverse @ loads
        multipliers = loads.new_zeros(targets.shape)
        for _ in range(2 if len(self.constraints) else 0):  # twice, because of the rounding of large weights
            change = self.inverted @ (self.constraints @ weights - targets)
            weights, multipliers = weights - self.response @ change, multipliers + change
        return weights, multipliers

    def layer(self, forces: Tensor | None = None) -> OutputLayer:
        """Return the weights under the load, and forces (n,) beside it."""
        load = self.load if forces is None else self.load + forces
        found, held = self.solve(load[:, None], self.targets[:, None])
        weights, multipliers = found[:, 0], held[:, 0]
        left = load - self.constraints.T @ multipliers - self.matrix @ weights
        return OutputLayer(weights, -multipliers, 0.5 * abs(float(weights @ left)))


def solve_output(equations: NormalEquations, constraints: Tensor, targets: Tensor, stiffness: float) -> OutputLayer:
    """Minimise the energy subject to `constraints` (k, 3 M) w = `targets` (k,), metres.

    `stiffness` (N/m) weighs the constraints in the matrix, where they only serve its definiteness: they are held
    exactly by Lagrange multipliers.

    Raises
    ------
    SolveFailure
        If the matrix is not finite, or not positive semidefinite.
    """
    # The energy is quadratic in the output layer: its minimum is one linear system, not an optimisation.
    # 1. Form A = K + anchors of rigid motions + k C^T C, the last as in an augmented Lagrangian.
    # 2. Compute the unconstrained weights A^-1 f by the regularised inverse.
    # 3. Compute multipliers from the Schur complement C A^-1 C^T, twice, and weights with C w = targets. Rows that the
    #    features can't distinguish make it singular: by its pseudo-inverse, they share the multiplier.
    # 4. Compute the work of the residual: the effect of regularisation.
    # Textbooks solve the indefinite saddle system at once. Here K alone may be singular, since only C holds rigid
    # motions. With k C^T C it is definite, and the minimum under C w = targets is the same for any k.
    return HeldInverse.from_equations(equations, constraints, targets, stiffness, JITTER).layer()


def potential_energy(equations: NormalEquations, weights: Tensor) -> float:
    """Return the potential energy of output weights (3 M,) on the rule of the equations, J."""
    return float(0.5 * weights @ (equations.stiffness @ weights) - equations.load @ weights) + equations.constant


def solve_part(
    ansatz: Ansatz, features: Features, equations: NormalEquations, part: Integers, level: float = JITTER
) -> OutputLayer:
    """Solve for the weights of some features, by their numbers (n,); all others are zero."""
    kept, held = held_part(ansatz, features, equations, part, level)
    return full_layer(ansatz, features, kept, held.layer())


def held_part(
    ansatz: Ansatz, features: Features, equations: NormalEquations, part: Integers, level: float = JITTER
) -> tuple[Tensor, HeldInverse]:
    """Return the (component, feature) pairs (n,) of some features, and the inverse for their weights."""
    # One matrix serves for all bases of subsets of its features.
    kept = torch.as_tensor(features.pairs(part), device=equations.load.device)
    constraints, targets = (torch.cat(both) for both in zip(*_constraints(ansatz, features), strict=True))
    within = NormalEquations(
        equations.stiffness[kept][:, kept], equations.load[kept], equations.anchor[:, kept], equations.constant
    )
    stiffness = ansatz.case.material.membrane_stiffness
    return kept, HeldInverse.from_equations(within, constraints[:, kept], targets, stiffness, level)


def full_layer(ansatz: Ansatz, features: Features, kept: Tensor, solved: OutputLayer) -> OutputLayer:
    """Return the output layer of all pairs from that of some, with the forces of point supports only."""
    weights = solved.weights.new_zeros(3 * features.count)
    weights[kept] = solved.weights
    reactions = solved.reactions[: len(point_supports(ansatz.case, ansatz.t))]
    return replace(solved, weights=weights, reactions=reactions)


def _constraints(ansatz: Ansatz, features: Features) -> list[tuple[Tensor, Tensor]]:
    return [point_constraints(ansatz, features), *slope_constraints(ansatz, features)]
