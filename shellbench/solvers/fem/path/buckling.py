"""Continuation through buckling: the critical state by the tangent's inertia, and a descent from it to a stable state.

On a path of equilibrium states, regula falsi brackets the first state at which the tangent has a negative eigenvalue.
Beyond it the shell moves freely to a stable state. From a state pushed slightly along the softest mode,
pseudo-transient continuation,

    (K + mu M) dq = r,

descends in the potential energy; M is the shell's area as a mass, and 1/mu is the length of a step in time (Kelley &
Keyes 1998). mu is large enough that the matrix is positive definite and the energy falls. It decreases as the steps
succeed, and the iteration becomes Newton's method at the end. Only a minimum is accepted as an answer.

Waves that may travel around a shell of revolution are fixed (`revolution`). A relaxation may move them; there mu does
not fall below `NEUTRAL` of the softest stiffness at rest.

Kelley & Keyes (1998), Convergence analysis of pseudo-transient continuation, SIAM J. Numer. Anal. 35.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.algebra.factor import Factor, NotPositiveDefiniteError, factorise
from shellbench.solvers.fem.mechanics.assembly import weighted_products
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.basis import COMPONENTS, KINDS
from shellbench.solvers.fem.path.finite_state import FiniteState, HeldDirection, TangentFactor, solve_on_free
from shellbench.solvers.fem.path.newton import equilibrium, move_supports
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import CUT, EASY, GROWTH, Illinois, NotConvergedError, PathEndsError, step_end

Array = NDArray[np.float64]

# All of these were set on the sleeves (`sleeve_compression`, `sleeve_twist`) and a column; the cost of other values was
# not recorded. Only `BRACKET` affects an answer: the others control the search of a minimum, and only a minimum is
# accepted.
NEUTRAL = 1e-3  # least mu, relative to the stiffness of the softest mode at rest
BRACKET = 1e-6  # of the load factor: width of the bracket of the critical state
EASY_WITH_OLD = 2  # times as many iterations count as easy as by new tangents: old ones make more, and cheaper ones
BEYOND = 0.01  # of the critical load factor: distance beyond it at which the descent begins
INVERSE_STEPS = 12  # of inverse iteration for the softest mode, at most
MODE_SETTLED = 1e-6  # relative change of its stiffness that ends them: its square root is the error of the mode
PUSH = 0.05  # of the thickness: push of a state along its softest mode
SADDLES = 5  # that are left again before a relaxation gives up
EASIER, HARDER = 0.2, 8.0  # of mu after a step that lowers the energy as it should, and after one that does not
GAINED = 0.25  # share of the predicted gain of energy below which mu does not fall
MOST_RELAXING_STEPS = 400  # of a relaxation
RELAXED = (1e-7, 1e-9, 1e-11)  # predicted gain, relative to the energy, at which Newton's method tries to take over


def following_steps(
    problem: FiniteProblem, marks: Sequence[float], first: float, shortest: float
) -> Iterator[FiniteState]:
    """Yield the stable states on the way from rest to the end of the path, through buckling or up to it.

    Parameters
    ----------
    problem
        The problem to solve.
    marks
        Increasing load factors to land on.
    first, shortest
        Length of the first step, and of the shortest one.

    Raises
    ------
    PathEndsError
        If no stable state is found, or the shell buckles before a mark of a path that ends there.
    """
    # 1. Take load steps with Newton's method, as long as their states are minima.
    # 2. Find the critical state between the first state that is no minimum and the one before, and yield it.
    # 3. End there, or descend from there to a stable state slightly beyond, wherever it lies.
    # 4. Take load steps again, with travelling waves held. Cut a step that fails or ends on a saddle.
    # 5. If none can be cut further, descend once more.
    # Textbooks switch branches at the critical point by its eigenvector. This needs an isolated, simple mode. Thin
    # shells buckle in clusters of modes, and the branch found may be unstable; a descent finds a minimum.
    buckling = Buckling(problem)
    state, step, buckled = problem.at_rest(), first, False
    for mark in marks:
        while state.t < mark:
            target = step_end(state.t, mark, step)
            try:
                found = buckling.equilibrium(state, target, holding=buckled)
                stable = found.stable
            except NotConvergedError:
                found, stable = state, False
            # A step that did not converge is no sign of buckling: only an unstable equilibrium starts the search.
            if not stable and not buckled and found is not state:
                state = buckling.last_stable_state(state, found)
                yield replace(state, critical=True)
                if problem.case.ends_critical:
                    if any(mark > state.t for mark in problem.case.states):
                        raise PathEndsError(f"the shell buckles at load factor {state.t:.6g}")
                    return
                buckled, step = True, BEYOND * state.t
                state = _relax_or_end(buckling, state, min(mark, state.t + step))
                yield state
                continue
            if not stable:
                step = (target - state.t) * CUT
                if step >= shortest:
                    continue
                step = max(BEYOND * state.t, shortest)  # far enough for the instability to show
                found = _relax_or_end(buckling, state, min(mark, state.t + step))
            elif found.iterations <= EASY_WITH_OLD * EASY:
                step = max(step, (target - state.t) * GROWTH)
            state = found
            yield state


def _relax_or_end(buckling: Buckling, state: FiniteState, t: float) -> FiniteState:
    try:
        return buckling.relax(state, t)
    except NotConvergedError:
        raise PathEndsError(f"no stable state was found at load factor {t:.6g}") from None


@dataclass(frozen=True)
class Buckling:
    """The means to follow a shell through buckling."""

    problem: FiniteProblem

    @cached_property
    def area(self) -> BlockMatrix:
        """The area as a mass, m^2."""
        case, mesh = self.problem.case, self.problem.mesh
        return weighted_products(
            mesh, case.surface, self.problem.quadrature, lambda points: np.ones((len(points), COMPONENTS))
        )

    @cached_property
    def softest_stiffness(self) -> float:
        """Stiffness of the softest mode at rest, N/m^3."""
        rest = self.problem.at_rest()
        if rest.factor is None:
            raise NotConvergedError
        return self.softest_mode(self.problem.ties(0.0), rest.factor)[1]

    @cached_property
    def problem_with_held_waves(self) -> FiniteProblem:
        """The problem with travelling waves held."""
        return replace(self.problem, holding=True)

    def softest_mode(self, ties: Ties, factor: TangentFactor) -> tuple[Array, float]:
        """Return the mode (nodes, 12) of the stiffness nearest zero, at most 1 m, and that stiffness, N/m^3."""
        # Inverse iteration, M-weighted, for the eigenvalue nearest zero, until Rayleigh's quotient of the mode settles:
        # x . K x = x . M m where K x = M m. In a cluster any mixture of its modes is soft, and only the direction of a
        # push is needed. The seed is fixed, so that answers are reproducible.
        mode, stiffness = np.random.default_rng(0).normal(size=(self.problem.mesh.node_count, 12)), math.inf
        weighted = _product(self.area, mode)
        for _ in range(INVERSE_STEPS):
            mode, before = solve_on_free(ties, factor, weighted), stiffness
            work, weighted = float(np.sum(mode * weighted)), _product(self.area, mode)
            stiffness = work / float(np.sum(mode * weighted))
            size = np.abs(mode[:, :: len(KINDS)]).max()
            mode, weighted = mode / size, weighted / size
            if abs(stiffness - before) <= MODE_SETTLED * abs(stiffness):
                break
        return mode, stiffness

    def tangent(self, state: FiniteState) -> BlockMatrix:
        """Return the tangent stiffness K at a state, supports not applied."""
        return self.problem.tangent(state.q, state.t, state.strained, state.strained.stresses)

    def stiffness(self, tangent: BlockMatrix, t: float, mu: float = 0.0) -> Factor:
        """Return the factorised K + mu M on the free unknowns at a load factor.

        Raises
        ------
        NotConvergedError
            If it is singular.
        """
        matrix = replace(tangent, blocks=tangent.blocks + mu * self.area.blocks) if mu else tangent
        reduced = self.problem.ties(t).reduce(matrix)
        if not np.all(np.isfinite(reduced.blocks)):
            raise NotConvergedError
        try:
            # Not "imposed": pivots made positive front by front give an arbitrary descent direction. K + mu M gives
            # that of a short motion. The caller raises mu until no pivot is negative.
            return factorise(reduced, self.problem.dissection, "reported")
        except NotPositiveDefiniteError:
            raise NotConvergedError from None

    def last_stable_state(self, below: FiniteState, above: FiniteState) -> FiniteState:
        """Return the last stable state between a stable and an unstable one, within `BRACKET` of the stability limit.

        Raises
        ------
        PathEndsError
            If the path can't be followed between them.
        """
        # Regula falsi for the root of the least stiffness, from stable states only. The textbook solves K + dt dK for
        # its eigenvalue instead, which is linear in t, and thin shells are not.
        low, high, unstable = below, above.t, above.t
        root = Illinois(self._least_stiffness(below), self._least_stiffness(above))
        while high - low.t > BRACKET * high:
            # The trial is beside the root, where the tangent is singular, toward the farther end.
            share = root.trial_share
            trial = low.t + share * (high - low.t) + math.copysign(BRACKET / 4 * high, 0.5 - share)
            try:
                middle = self.equilibrium(low, trial)
                value = self._least_stiffness(middle)
            except NotConvergedError:
                high, root.at_high = trial, None  # too long a step, or beyond buckling: a shorter one decides
                continue
            if value > 0:
                low = middle
                root.raise_low(value)
            else:
                high = unstable = trial
                root.lower_high(value)
        if high != unstable:  # failures of Newton's method are no evidence of buckling
            raise PathEndsError(f"no equilibrium was found between {low.t:.6g} and {unstable:.6g}")
        return low

    def equilibrium(self, start: FiniteState, t: float, holding: bool = False) -> FiniteState:
        """Return the state at a load factor with its own factorised tangent; waves may be held.

        Raises
        ------
        NotConvergedError
            If Newton's method does not get there, or the tangent is singular.
        """
        # Newton's method leaves the tangent of an earlier iteration, which is too inaccurate near a critical state. The
        # next step also begins with the state's own tangent.
        problem = self.problem_with_held_waves if holding else self.problem
        found = equilibrium(problem, start, t, frugal=True)
        tangent = self.tangent(found)
        factor = self.stiffness(tangent, t)
        forgiven = int(HeldDirection.from_ties(problem.ties(t), factor, problem.wave_direction(found.q)).negative)
        return replace(found, tangent=tangent, factor=factor, forgiven=forgiven)

    def _least_stiffness(self, state: FiniteState) -> float:
        """Return the stiffness nearest to zero of any mode of a state, N/m^3, negative if the state is unstable."""
        if state.factor is None:
            raise NotConvergedError
        least = abs(self.softest_mode(self.problem.ties(state.t), state.factor)[1])
        return least if state.stable else -least

    def relax(self, start: FiniteState, t: float) -> FiniteState:
        """Return a stable state at a load factor, by descent from another state whose supports are moved there.

        Raises
        ------
        NotConvergedError
            If none is found.
        """
        # 1. Move the supports, with the shell's response by its tangent.
        # 2. Push the state along its softest mode, off a saddle or critical point.
        # 3. Descend until the gain is small, then try Newton's method, which converges quadratically.
        # 4. Accept a minimum. If Newton's method finds a saddle or nothing, descend further; in the end, push again.
        state = self._move_supports(start, t)
        for _ in range(SADDLES):
            state = self._push_along_softest_mode(state)
            for relaxed in RELAXED:
                state = self._descend(state, relaxed)
                try:
                    found = self.equilibrium(state, t, holding=True)
                except NotConvergedError:
                    continue
                if found.stable:
                    return found  # a saddle is not accepted: a descent direction exists
        raise NotConvergedError

    def _move_supports(self, start: FiniteState, t: float) -> FiniteState:
        """Return a state with its supports moved, and the shell's response by its tangent."""
        ties = self.problem.ties(t)
        moved = ties.particular[..., 0] + ties.to_nodal(ties.to_free(start.q[..., None]))[..., 0] - start.q
        if np.any(moved):
            moved, _ = move_supports(self.problem_with_held_waves, start, t, ties, moved)
        return self.problem.state_at(t, start.q + moved, start)

    def _push_along_softest_mode(self, state: FiniteState) -> FiniteState:
        """Return a state pushed along its softest mode, to the side where the energy is less."""
        # At a symmetric state both sides gain equally in second order. The energy itself decides, third order included.
        mode, _ = self.softest_mode(self.problem.ties(state.t), self.stiffness(self.tangent(state), state.t))
        push = PUSH * self.problem.case.material.thickness * mode
        sides = [self.problem.state_at(state.t, state.q + sign * push, state) for sign in (1.0, -1.0)]
        return min(sides, key=self.problem.potential)

    def _descend(self, state: FiniteState, relaxed: float) -> FiniteState:
        """Descend in the potential energy until a step is predicted to gain at most a share of it."""
        problem, ties = self.problem, self.problem.ties(state.t)
        # Pseudo-transient continuation, a step in four:
        # 1. Factorise K + mu M, with mu raised until it is positive definite: the step then is a descent.
        # 2. Compute dq = (K + mu M)^-1 r, whose quadratic model gains at least r . dq / 2.
        # 3. Move if the energy falls at all.
        # 4. Lower mu if it fell by a fair share of the prediction, and raise it otherwise.
        # Kelley and Keyes set mu by the residual's norm, which may rise while the energy falls. Here steps are judged
        # by the energy, as in a trust region with the radius 1 / mu.
        mu, value, tangent = self.softest_stiffness, problem.potential(state), self.tangent(state)
        for _ in range(MOST_RELAXING_STEPS):
            factor = self.stiffness(tangent, state.t, mu)
            if factor.negative_count:
                mu *= HARDER
                continue
            residual = problem.forces(state.q, state.t) - state.strained.forces
            step = solve_on_free(ties, factor, residual)
            predicted = float(np.sum(residual * step)) / 2
            if predicted <= relaxed * state.strained.energy:
                return state
            found = problem.state_at(state.t, state.q + step, state)
            gained = value - problem.potential(found)
            if gained > 0:
                state, value, tangent = found, value - gained, self.tangent(found)
            # Where waves may travel, K is nearly singular at the minimum too. A step without mu would run along them.
            mu = max(mu * EASIER, NEUTRAL * self.softest_stiffness) if gained >= GAINED * predicted else mu * HARDER
        raise NotConvergedError


def _product(matrix: BlockMatrix, vector: Array) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])
