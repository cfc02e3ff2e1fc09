"""Solving for the output layer: a symmetric positive definite system, with supports as exact constraints.

These are point supports, and slopes held at edges that no factor holds (`choices.Slopes`).

The inverse of a nearly singular Gram matrix, regularised at a fixed level.

Random features are nearly dependent: the least eigenvalues of their Gram matrix are rounding, and may be negative.
A level that is raised until a Cholesky factorisation succeeds makes the answer depend on that rounding, and so on the
processor. Here the level is fixed. Where Cholesky fails all the same, the eigenvalues are found, negative ones are
called zero, and the same level is added: both ways give the same inverse but for rounding.

What the level takes from combinations that are weak, but not as weak as rounding, iterative refinement gives back. With
M = A + level I, the residual of M^-1 b is level M^-1 b, so that k refinements add up to

    sum of (level M^-1)^i M^-1 b, i = 0 .. k:   a share 1 - (level / (lambda + level))^(k + 1) of each eigenvector.

The sum needs no residual, whose rounding M^-1 would magnify.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.jets import D1, D2, VALUE, Array, Integers, from_derivatives
from shellbench.solvers.ndf.field.quadrature import RuleSpec, edge_rule
from shellbench.solvers.ndf.field.supports import edge_supports, point_supports
from shellbench.solvers.ndf.strains.energy import NormalEquations
from shellbench.solvers.ndf.strains.sampled import FeatureSet

REFINEMENTS = 3  # they leave 1e-4 of a combination ten times as stiff as the level, where none would leave 9 %
INDEFINITE = 1e-9  # negative eigenvalue, by the largest, that no rounding explains: it leaves 1e-13


class IndefiniteError(ArithmeticError):
    """The matrix is not positive semidefinite."""


@dataclass(frozen=True)
class RegularisedInverse:
    """(D^-1 A D^-1 + level I)^-1 between scales D^-1, with D^2 the diagonal of A.

    Attributes
    ----------
    level
        What is added to the unit diagonal of the scaled matrix.
    scale
        (n,) D^-1; zero where the diagonal is.
    factor
        (n, n) lower triangle of the Cholesky factor, or eigenvectors divided by the roots of their eigenvalues.
    triangular
        Which of them it is.
    pivots
        Of LU factors (n, n) instead, of a matrix that is not definite.
    """

    level: float
    scale: Tensor
    factor: Tensor
    triangular: bool
    pivots: Tensor | None = None

    @classmethod
    def from_matrix(cls, matrix: Tensor, level: float) -> RegularisedInverse:
        """Factorise a symmetric positive semidefinite matrix (n, n).

        Raises
        ------
        IndefiniteError
            If it is not finite, or has an eigenvalue that is negative beyond rounding.
        """
        # Scaled to a unit diagonal, features of any magnitude are regularised alike. A feature of no stiffness gets no
        # weight.
        diagonal = matrix.diagonal().clamp_min(0.0).sqrt()
        scale = torch.where(diagonal > 0, 1 / diagonal, torch.zeros_like(diagonal))
        scaled = matrix * scale[:, None] * scale
        scaled.diagonal().fill_(1 + level)
        if not bool(torch.isfinite(scaled).all()):
            raise IndefiniteError
        factor, info = torch.linalg.cholesky_ex(scaled)
        if int(info) == 0:
            return cls(level, scale, factor, triangular=True)
        # The level is in `scaled` already: an eigenvalue below it was negative in A, and is called zero.
        values, vectors = torch.linalg.eigh(scaled)
        if not float(values[0]) >= -INDEFINITE * float(values[-1]):
            raise IndefiniteError
        return cls(level, scale, vectors / values.clamp_min(level).sqrt(), triangular=False)

    @classmethod
    def of_indefinite(cls, matrix: Tensor, level: float) -> RegularisedInverse:
        """Factorise a matrix (n, n) that need be neither definite nor symmetric.

        Raises
        ------
        IndefiniteError
            If it is not finite.
        """
        diagonal = matrix.diagonal().abs().sqrt()
        scale = torch.where(diagonal > 0, 1 / diagonal, torch.zeros_like(diagonal))
        scaled = matrix * scale[:, None] * scale
        scaled.diagonal().add_(level)
        if not bool(torch.isfinite(scaled).all()):
            raise IndefiniteError
        factor, pivots = torch.linalg.lu_factor(scaled)
        return cls(level, scale, factor, triangular=False, pivots=pivots)

    def half(self, right: Tensor) -> Tensor:
        """Return H (n, m) with H^T H = right^T A^-1 right, not refined, for right-hand sides (n, m)."""
        scaled = right * self.scale[:, None]
        if not self.triangular:
            return self.factor.T @ scaled
        result: Tensor = torch.linalg.solve_triangular(self.factor, scaled, upper=False)
        return result

    def __matmul__(self, right: Tensor) -> Tensor:
        """Return A^-1 right, refined, for right-hand sides (n, m)."""
        step = self._solve(right * self.scale[:, None])
        total = step
        for _ in range(REFINEMENTS):
            # The series of the top. The textbook forms b - A x instead, whose rounding M^-1 would magnify.
            step = self.level * self._solve(step)
            total = total + step
        return total * self.scale[:, None]

    def _solve(self, scaled: Tensor) -> Tensor:
        if self.pivots is not None:
            turned: Tensor = torch.linalg.lu_solve(self.factor, self.pivots, scaled)
            return turned
        if not self.triangular:
            return self.factor @ (self.factor.T @ scaled)
        solved: Tensor = torch.cholesky_solve(scaled, self.factor)
        return solved


SAME_ROW = 1e-6  # share of the softest combination of constraints below which one is stiffer than rounding can tell
JITTER = 1e-12  # on the unit diagonal: ten times what rounding leaves of the matrix, so that it decides nothing


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
        Work of the loads that what was added to the diagonal has left without resistance, J.
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
        (n, k) of the weights to forces of the constraints, and (k, k) from what these miss to their forces.
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
        cls, equations: NormalEquations, constraints: Tensor, targets: Tensor, stiffness: float, level: float = JITTER
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
        for _ in range(2 if len(self.constraints) else 0):  # once more for the rounding of large weights
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


def solve_output(
    equations: NormalEquations, constraints: Tensor, targets: Tensor, stiffness: float, level: float = JITTER
) -> OutputLayer:
    """Minimise the energy subject to `constraints` (k, 3 M) w = `targets` (k,), metres.

    `stiffness` (N/m) weighs the constraints in the matrix, where they only serve its definiteness: they are held
    exactly by Lagrange multipliers. `level` is that of the regularised inverse.

    Raises
    ------
    SolveFailure
        If the matrix is not finite, or not positive semidefinite.
    """
    # The energy is quadratic in the output layer: its minimum is one linear system, not an optimisation.
    # 1. A = K + what anchors rigid motions + k C^T C, the last as in an augmented Lagrangian.
    # 2. Unconstrained weights A^-1 f by the regularised inverse.
    # 3. Multipliers from the Schur complement C A^-1 C^T, twice, and weights that hold C w = targets. Rows that the
    #    features can't tell apart make it singular: of its pseudo-inverse, they share the multiplier.
    # 4. The work of the residual: what regularisation has cost.
    # Textbooks solve the indefinite saddle system at once. Here K alone may be singular, as only C stops rigid motions.
    # With k C^T C it is definite, and the minimum under C w = targets is the same for any k.
    return HeldInverse.from_equations(equations, constraints, targets, stiffness, level).layer()


def potential_energy(equations: NormalEquations, weights: Tensor) -> float:
    """Return the potential energy of output weights (3 M,) on the rule of the equations, J."""
    return float(0.5 * weights @ (equations.stiffness @ weights) - equations.load @ weights) + equations.constant


def solve_part(
    ansatz: Ansatz, features: Features, equations: NormalEquations, part: Integers, level: float = JITTER
) -> OutputLayer:
    """Solve for the weights of some features, by their numbers (n,); all others are zero."""
    kept, held = held_part(ansatz, features, equations, part, level)
    return spread(ansatz, features, kept, held.layer())


def held_part(
    ansatz: Ansatz, features: Features, equations: NormalEquations, part: Integers, level: float = JITTER
) -> tuple[Tensor, HeldInverse]:
    """Return the (component, feature) pairs (n,) of some features, and the inverse for their weights."""
    # One matrix serves all bases whose features are among its own.
    kept = torch.as_tensor(features.pairs(part), device=equations.load.device)
    constraints, targets = (torch.cat(both) for both in zip(*_constraints(ansatz, features), strict=True))
    within = NormalEquations(
        equations.stiffness[kept][:, kept], equations.load[kept], equations.anchor[:, kept], equations.constant
    )
    stiffness = ansatz.case.material.membrane_stiffness
    return kept, HeldInverse.from_equations(within, constraints[:, kept], targets, stiffness, level)


def spread(ansatz: Ansatz, features: Features, kept: Tensor, solved: OutputLayer) -> OutputLayer:
    """Return the output layer of all pairs from that of some, with the forces of point supports alone."""
    weights = solved.weights.new_zeros(3 * features.count)
    weights[kept] = solved.weights
    reactions = solved.reactions[: len(point_supports(ansatz.case, ansatz.t))]
    return replace(solved, weights=weights, reactions=reactions)


def _constraints(ansatz: Ansatz, features: Features) -> list[tuple[Tensor, Tensor]]:
    return [point_constraints(ansatz, features), *slope_constraints(ansatz, features)]


def point_constraints(ansatz: Ansatz, features: FeatureSet) -> tuple[Tensor, Tensor]:
    """Return rows (k, 3 M) and targets (k,), metres, that hold the point supports."""
    placement, supports = features.placement, point_supports(ansatz.case, ansatz.t)
    points = np.array([s.point.xi for s in supports]).reshape(-1, 2)
    if not supports or ansatz.soft:
        return placement.tensor(np.zeros((0, 3 * features.count))), placement.tensor(np.zeros(0))
    components = [s.component for s in supports]
    index = torch.arange(len(supports), device=placement.device)
    held = ansatz.factors.matrix(points, placement)[VALUE][index, components]
    rows = (held[:, :, None] * features.values(points)[:, None, :]).reshape(len(supports), -1)
    lift = ansatz.lift.jet(points, placement)[VALUE][index, components]
    return rows, placement.tensor(np.array([s.value for s in supports])) - lift


NOWHERE = np.zeros((0, 2))
SLOPES = RuleSpec((12, 12), 6)  # along an edge whose slope is held by rows; twice the panels around a turn


def slope_constraints(
    ansatz: Ansatz, features: FeatureSet, spec: RuleSpec | None = None, focal: Array = NOWHERE
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield, edge by edge, rows (k, 3 M) and targets (k,), metres, that hold slopes where an ansatz asks for rows.

    `spec` and the points (k, 2) that it is graded toward give the Gauss points; None: those of `SLOPES`.
    A row is u,n . a3 at a Gauss point, times sqrt(h ds): as stiff as the membrane, it is as stiff as bending over h.
    """
    case, placement = ansatz.case, features.placement
    for support in edge_supports(case):
        edge, held = support.edge, support.slope
        if held is None or not support.free or ansatz.slopes == "even":
            continue
        panels = [n * (1 + turns) for n, turns in zip(SLOPES.panels, case.surface.domain.periodic, strict=True)]
        chosen = spec or replace(SLOPES, panels=(panels[0], panels[1]))
        rule = edge_rule(case.surface.domain, edge, focal, chosen)
        x = from_derivatives(case.surface.derivatives(rule.points, 2), placement)
        across, along = (D1, D2) if edge.axis == 0 else (D2, D1)
        length = x[along].norm(dim=-1)
        share = (x[across] * x[along]).sum(-1) / length**2
        conormal = torch.zeros_like(x[..., 0])  # the planes of a jet that make its derivative along n
        conormal[across], conormal[along] = 1.0, -share
        conormal /= (x[across] - share[:, None] * x[along]).norm(dim=-1)
        normal = torch.linalg.cross(x[D1], x[D2], dim=-1)
        normal /= normal.norm(dim=-1, keepdim=True)
        normal *= (case.material.thickness * placement.tensor(rule.weights) * length).sqrt()[:, None]
        matrix, jets = ansatz.factors.matrix(rule.points, placement), features.jets(rule.points)
        turned = torch.einsum("nc,pn,pncd->nd", normal, conormal, matrix)
        moved = torch.einsum("nc,ncd->nd", normal, matrix[VALUE])
        slopes = torch.einsum("pn,pnj->nj", conormal, jets)
        rows = turned[:, :, None] * jets[VALUE][:, None] + moved[:, :, None] * slopes[:, None]
        wanted = from_derivatives(case.motion(held, edge, rule.points, ansatz.t, 2), placement)
        wanted = wanted - ansatz.lift.jet(rule.points, placement)
        yield rows.reshape(len(rows), -1), torch.einsum("nc,pn,pnc->n", normal, conormal, wanted)
