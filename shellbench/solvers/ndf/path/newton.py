"""Newton's method on the output weights of a field: at a load factor, or with one more equation on a path.

The stresses of the geometric stiffness come from the linear prediction of the last step, and all other terms from the
displacement itself: thin shells then allow large steps (Magisano, Leonetti & Garcea 2017, CMAME 313).

The unknowns are independent combinations of the features.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.ansatz import independent_combinations
from shellbench.solvers.ndf.strains.strain_measures import Strained
from shellbench.solvers.stepping.control import NotConvergedError

CONVERGED = 1e-10  # work of the residual on the last step, relative to the energy: the next one's is its square
MOST_ITERATIONS = 14  # a step that takes more is cut
FIRST_STEP = 1 / 8  # of a path under load: first step of Newton's method from rest; it is cut if that fails
HOPELESS = 1e8  # growth of that work beyond which no iteration converges: a guard


@dataclass(frozen=True)
class Deformed:
    """A displacement of the shell.

    Attributes
    ----------
    membrane, bending, work
        Parts of the strain energy, and the work of the loads, J.
    residual
        (3 M,): loads less internal forces, on the output weights.
    strained, stresses
        At the points of the rule: strains, and conjugate stresses (N, 6).
    angles
        By moment (n,): the rotation angles of its normals.
    """

    membrane: float
    bending: float
    work: float
    residual: Tensor
    strained: Strained
    stresses: Tensor
    angles: tuple[Tensor, ...]

    @property
    def potential(self) -> float:
        """Potential energy, J."""
        return self.membrane + self.bending - self.work

    @property
    def magnitude(self) -> float:
        """Magnitude of the potential energy, J: the sum of its parts, each without its sign."""
        return self.membrane + self.bending + abs(self.work)


@dataclass(frozen=True)
class Basis:
    """Independent fields: w = held target + combine y, with `combine` (3 M, r) and `held` (3 M, k)."""

    combine: Tensor
    held: Tensor

    @classmethod
    def from_stiffness(cls, stiffness: Tensor, constraints: Tensor, least: float = 0.0) -> Basis:
        """Choose a basis whose stiffness is the identity, and in which `constraints` (k, 3 M) w = target are held.

        Combinations of constraints that a unit of energy moves by at most `least`, metres, are left out.
        """
        # Null-space method: with K = 1 in `combine`, a singular value decomposition of the constraints splits it
        # orthogonally. The first columns of V hold the supports' displacements, the others move none of them.
        combine = independent_combinations(stiffness)
        if not len(constraints):
            return cls(combine, combine.new_zeros((len(stiffness), 0)))
        u, moved, v = torch.linalg.svd(constraints @ combine)
        k = int((moved > least).sum())
        return cls(combine @ v[k:].T, combine @ (v[:k].T / moved[:k]) @ u[:, :k].T)

    @property
    def size(self) -> int:
        """Number of unknowns r."""
        return self.combine.shape[1]

    def spread(self, y: Tensor) -> Tensor:
        """Return weights (3 M,) of unknowns (r,), without the held part."""
        return self.combine @ y

    def gather(self, force: Tensor) -> Tensor:
        """Return forces (r,) on the unknowns of forces (3 M,) on the weights."""
        return self.combine.T @ force


class Equations(Protocol):
    """The members of a problem that Newton's method needs; `equilibrium.PathProblem` has them."""

    @property
    def basis(self) -> Basis:
        """The unknowns."""

    @property
    def constraints(self) -> Tensor:
        """(k, 3 M): rows that are held."""

    @property
    def rest_weights(self) -> Tensor:
        """(3 M,) zeros: the output weights at rest."""

    @property
    def rounding_energy(self) -> float:
        """Energy that counts as rounding, J."""

    def targets(self, t: float) -> Tensor:
        """Return the displacements that the constraints prescribe (k,) at a load factor."""

    def deform(self, weights: Tensor, t: float, near: tuple[Tensor, ...] | None = None) -> Deformed:
        """Deform the shell by output weights (3 M,); angles are followed from `near`."""

    def tangent(
        self, deformed: Deformed, t: float, weights: Tensor | None = None, geometric: Tensor | None = None
    ) -> Tensor:
        """Return the second variation (3 M, 3 M) of the energy; `geometric` (N, 6) replace its stresses."""

    def load_stiffness(self, weights: Tensor, t: float) -> Tensor | None:
        """Return the derivative (3 M, 3 M) of loads that follow the shell; None without any."""

    def predicted_stresses(self, deformed: Deformed, change: Tensor, t: float = 0.0) -> Tensor:
        """Return the stresses (N, 6) that the first variation predicts after a change (3 M,) of weights."""

    def force_rate(self, weights: Tensor) -> Tensor:
        """Return the derivative (3 M,) of proportional loads in t."""


@dataclass(frozen=True)
class PathState:
    """A state of equilibrium.

    Attributes
    ----------
    t, weights, deformed
        Load factor, output weights (3 M,), and their deformation.
    iterations
        Newton iterations that led here.
    tangent
        That of the last iteration; None at rest.
    critical
        Whether the shell can buckle here for the first time.
    """

    t: float
    weights: Tensor
    deformed: Deformed
    iterations: int = 0
    tangent: Tangent | None = None
    critical: bool = False

    @classmethod
    def rest(cls, problem: Equations) -> PathState:
        """Return the unloaded state."""
        return cls(0.0, problem.rest_weights, problem.deform(problem.rest_weights, 0.0))

    @property
    def stable(self) -> bool:
        """True if the state is a minimum of the potential energy.

        A pressure that follows the shell has no potential. Then it is True if all steps from the state do positive
        work.
        """
        return self.tangent is None or self.tangent.definite


@dataclass(frozen=True)
class Constraint:
    """One more equation, row . w = value with a row (3 M,), for a path on which the load factor is unknown."""

    row: Tensor
    value: float


def equilibrium(problem: Equations, start: PathState, t: float, neutral: float = 0.0) -> PathState:
    """Return the state at a load factor, from another one; it is stable if its tangent is positive definite.

    Modes whose eigenvalue is less than `neutral` of the stiffness at rest are not changed.

    Raises
    ------
    NotConvergedError
        If Newton's method does not get there.
    """
    basis = problem.basis
    # Point supports are moved first. Steps in the basis do not move them.
    change = basis.held @ (problem.targets(t) - problem.constraints @ start.weights)
    return _newton(problem, start, t, change, None, neutral)


def on_path(problem: Equations, start: PathState, constraint: Constraint, guess: tuple[Tensor, float]) -> PathState:
    """Return the state that satisfies a constraint, from another one and a guess (dw, dt) of the step to it.

    Raises
    ------
    NotConvergedError
        If Newton's method does not get there.
    """
    return _newton(problem, start, start.t + guess[1], guess[0], constraint)


def has_converged(problem: Equations, deformed: Deformed, decrement: float, first: float) -> bool:
    """Return True if an iteration has converged, by the work of its last step and of its first one, J.

    Raises
    ------
    NotConvergedError
        If the work has grown beyond return.
    """
    # Below the energy of a strain of 1e-10 all is rounding, as in an unloaded shell.
    scale = max(deformed.magnitude, problem.rounding_energy)
    # Written so that NaN fails.
    if not scale < float("inf") or decrement > HOPELESS * first:
        raise NotConvergedError
    return decrement <= CONVERGED * scale


def path_rate(problem: Equations, state: PathState) -> Tensor:
    """Return dw/dt (3 M,) along the path at a state.

    Raises
    ------
    NotConvergedError
        If the tangent is singular there.
    """
    tangent = state.tangent or Tangent(problem, state.deformed, state.t, state.weights, None)
    return tangent.solve(problem.force_rate(state.weights))


class Tangent:
    """A tangent in the basis of independent fields, factorised; `definite` if it is positive.

    A following pressure makes it unsymmetric. Then `definite` is that of its symmetric part, and `whole` solves.

    With `neutral`, it is decomposed into its modes, and eigenvalues up to that size count as zero: they make no state
    unstable, and a solution has no part along them.
    """

    def __init__(
        self,
        problem: Equations,
        deformed: Deformed,
        t: float,
        weights: Tensor,
        geometric: Tensor | None,
        neutral: float = 0.0,
    ) -> None:
        self.combine = problem.basis.combine
        # Z^T K Z in independent fields that do not move the point supports: small, dense, and the identity at rest.
        matrix = problem.tangent(deformed, t, weights, geometric)
        self.reduced = self.combine.T @ matrix @ self.combine
        self.whole: tuple[Tensor, Tensor] | None = None
        load = problem.load_stiffness(weights, t)
        if load is not None:
            # An unsymmetric matrix needs LU. Its symmetric part shows if all steps do positive work.
            whole = self.reduced - self.combine.T @ load @ self.combine
            self.reduced = (whole + whole.T) / 2
            if bool(torch.isfinite(whole).all()):
                self.whole = torch.linalg.lu_factor(whole)
        if not bool(torch.isfinite(self.reduced).all()):
            raise NotConvergedError
        self.neutral = neutral
        self.positive = True  # its determinant
        # 1. With neutral modes: compute all modes, to leave some out.
        # 2. Else try Cholesky, for a stable state.
        # 3. If that fails, take LDL^T, and the sign of the determinant: it distinguishes limit points from branches.
        if neutral:
            self.values, self.vectors = torch.linalg.eigh(self.reduced)
            self.definite = float(self.values[0]) > -neutral
            return
        self.factor, info = torch.linalg.cholesky_ex(self.reduced)
        self.definite = int(info) == 0
        if not self.definite:
            self.factor, self.pivots, info = torch.linalg.ldl_factor_ex(self.reduced)
            if int(info) != 0:
                raise NotConvergedError
            self.positive = bool(torch.linalg.slogdet(self.reduced)[0] > 0)

    @cached_property
    def lowest(self) -> float:
        """Smallest eigenvalue, relative to the stiffness at rest."""
        return float((self.values if self.neutral else torch.linalg.eigvalsh(self.reduced))[0])

    def solve(self, right: Tensor) -> Tensor:
        """Return the output weights (3 M,) of a right-hand side (3 M,)."""
        reduced = (self.combine.T @ right)[:, None]
        if self.neutral:
            # A pseudo-inverse: the field does not move along a neutral mode, where Newton's step would be long and of
            # either sign.
            stiff = self.values.abs() > self.neutral
            compliance = torch.where(stiff, 1 / self.values, torch.zeros_like(self.values))
            solved = self.vectors @ (compliance[:, None] * (self.vectors.T @ reduced))
        elif self.whole is not None:
            solved = torch.linalg.lu_solve(*self.whole, reduced)
        elif self.definite:
            solved = torch.cholesky_solve(reduced, self.factor)
        else:
            solved = torch.linalg.ldl_solve(self.factor, self.pivots, reduced)
        weights: Tensor = self.combine @ solved[:, 0]
        return weights


def _newton(
    problem: Equations,
    start: PathState,
    t: float,
    step: Tensor,
    constraint: Constraint | None,
    neutral: float = 0.0,
) -> PathState:
    # Newton's method with predicted stresses (Magisano, Leonetti & Garcea 2017), an iteration in four:
    # 1. Factorise K from the strains of w, and in its geometric part from the stresses predicted by the step before.
    # 2. Compute dw = K^-1 r; on a path, bordered by the constraint, dw = K^-1 r + dt K^-1 f'.
    # 3. Predict the next stresses before w moves.
    # 4. Stop when the work r . dw is at rounding.
    # The textbook takes w's own stresses, and searches along dw. In a thin shell those stresses are far too large after
    # a bending step. Here the residual may grow at first, and the caller cuts a step that does not converge.
    weights, deformed, geometric = start.weights, start.deformed, start.deformed.stresses
    if bool(step.any()):
        geometric = problem.predicted_stresses(deformed, step)
        weights = weights + step
    if bool(step.any()) or t != start.t:
        deformed = problem.deform(weights, t, start.deformed.angles)
    known = None if bool(step.any()) else start.tangent  # at the start itself the tangent is known
    first = 0.0
    for iteration in range(1, MOST_ITERATIONS + 1):
        tangent = known or Tangent(problem, deformed, t, weights, geometric, neutral)
        known = None
        step = tangent.solve(deformed.residual)
        if constraint is not None:
            moving = tangent.solve(problem.force_rate(weights))
            slope = float(constraint.row @ moving)
            if slope == 0.0:
                raise NotConvergedError
            change = (constraint.value - float(constraint.row @ (weights + step))) / slope
            step, t = step + change * moving, t + change
        # The constraint is linear, so that it holds after each step. The work of r alone measures the distance from
        # equilibrium.
        decrement = abs(float(deformed.residual @ step))
        geometric = problem.predicted_stresses(deformed, step, t)
        weights = weights + step
        deformed = problem.deform(weights, t, deformed.angles)
        first = first or decrement
        if has_converged(problem, deformed, decrement, first):
            return PathState(t, weights, deformed, iteration, tangent)
    raise NotConvergedError
