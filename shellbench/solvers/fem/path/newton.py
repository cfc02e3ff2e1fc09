"""Newton's method for the equations of equilibrium at finite strain, at a load factor or with one more equation.

On a path that no load factor marks, the load factor t is an unknown, and the additional equation is c . q + d t = s.

Newton's method takes the stresses in the geometric part of the tangent from the linear prediction of the step before, C
(eps(q) + eps'(q) dq), and those of the displacement itself everywhere else (the mixed integration point method:
Magisano, Leonetti & Garcea 2017). A thin shell's membrane stresses follow from a displacement only if that is exact to
second order. With their prediction a large step converges in a few iterations, still quadratically.

Magisano, Leonetti & Garcea (2017), How to improve efficiency and robustness of the Newton method in geometrically
non-linear structural problem discretized via displacement-based finite elements, CMAME 313.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shellbench.solvers.fem.algebra.factor import NotPositiveDefiniteError
from shellbench.solvers.fem.mechanics.ties import Ties
from shellbench.solvers.fem.mesh.basis import ROUNDING, UNSTRAINED
from shellbench.solvers.fem.path.finite_state import (
    Constraint,
    FiniteState,
    HeldDirection,
    MovedSupportsFactor,
    TangentFactor,
    solve_on_free,
)
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import NotConvergedError

Array = NDArray[np.float64]

# Work of the residual on the last step, relative to the energy: with a new tangent the next one's is its square, 1e-20.
CONVERGED = 1e-10
# Largest residual force before the last step, relative to the largest nodal force: along a stiff direction a large one
# does little work.
BALANCED = 1e-3
MOST_ITERATIONS = 14  # a step that takes more is cut
MOST_IN_CONTACT = 40  # the same with contact, where points touch and separate, and gaps close in rounds
FEW = 3  # iterations with an obstacle that is soft
# Growth of that work beyond which no iteration converges. The first steps of a thin shell raise it by its membrane
# stresses.
HOPELESS = 1e8
# Ratio of that work from iteration to iteration beyond which an old tangent is replaced: 0.1 of the error.
SLOW = 1e-2
UNKNOWN = float(np.finfo(float).max)  # work before a first step by an old tangent: the second one tells of it
# Of `CONVERGED`, if the last step was made by an old tangent: the next one is up to `SLOW` of it, 1e-16.
STRICT = 1e-4


class KnownTangent(NamedTuple):
    """A tangent beside a state, and the work of the residual on the step that was made by it, J."""

    factor: TangentFactor
    work: float


def equilibrium(
    problem: FiniteProblem, start: FiniteState, t: float, tolerance: float = CONVERGED, frugal: bool = False
) -> FiniteState:
    """Return the state at a load factor, from another one.

    If `frugal`, Newton's method keeps its tangents as long as it converges; the state's tangent is then that of a
    nearby state.

    Raises
    ------
    NotConvergedError
        If Newton's method does not get there.
    """
    ties = problem.ties(t)
    # The change of q that moves the start onto the supports at t, and changes nothing else.
    moved = ties.particular[..., 0] + ties.to_nodal(ties.to_free(start.q[..., None]))[..., 0] - start.q
    known: KnownTangent | None = None
    if not _is_rounding(problem, start, moved):
        moved, known = move_supports(problem, start, t, ties, moved)
    try:
        return _newton(problem, start, t, ties, moved, None, tolerance, known if frugal else None, frugal)
    except NotConvergedError:
        if start.pressure is None:
            raise
        # through soft obstacles, without the points that were in contact
        return _newton(problem, replace(start, pressure=None), t, ties, moved, None, tolerance, None, frugal)


def _is_rounding(problem: FiniteProblem, start: FiniteState, step: Array) -> bool:
    """Return True if a step (nodes, 12) is no more than rounding; with possible contact, only if it is zero."""
    return bool(np.abs(step).max() <= (ROUNDING * np.abs(start.q).max() if problem.points is None else 0.0))


def move_supports(
    problem: FiniteProblem, start: FiniteState, t: float, ties: Ties, moved: Array
) -> tuple[Array, KnownTangent]:
    """Return a motion of the supports with the shell's response by its tangent at the start, and that tangent."""
    # A support that moves alone would strain only the cells beside it, and these far too much. One linear solve at the
    # start, K dq = r(q, t) - K moved, spreads the motion over the shell.
    pressing = problem.obstacle_contact(start, t)
    own = None if pressing else start.tangent
    matrix = own or problem.tangent(start.q, start.t, start.strained, start.strained.stresses)
    right = problem.forces(start.q, t) - start.strained.forces
    if pressing:
        pressed = pressing.contact_at(start.q)
        pressing.add_stiffness(matrix, pressed)
        right = right + pressed.nodal
    right = right - (matrix @ moved[..., None])[..., 0]
    factor: TangentFactor
    if own and start.factor is not None:
        factor = MovedSupportsFactor(start.factor, problem.ties(start.t), ties)
    else:
        try:
            factor = problem.reduced_factor(ties, matrix)
        except NotPositiveDefiniteError:
            raise NotConvergedError from None
    hold = HeldDirection.from_ties(ties, factor, problem.wave_direction(start.q))
    step = hold.without_direction(solve_on_free(ties, factor, right))
    return moved + step, KnownTangent(factor, abs(float(np.sum(right * step))))


def state_on_path(
    problem: FiniteProblem,
    start: FiniteState,
    constraint: Constraint,
    guess: tuple[Array, float],
    nearby: TangentFactor | None = None,
) -> FiniteState:
    """Return the state that satisfies a constraint, from another one and a guess of the step (dq, dt) to it.

    The tangent of a state nearby is tried first, if there is one.

    Raises
    ------
    NotConvergedError
        If Newton's method does not get there.
    """
    ties = problem.ties(start.t)
    known = None if nearby is None else KnownTangent(nearby, UNKNOWN)
    return _newton(problem, start, start.t + guess[1], ties, guess[0], constraint, CONVERGED, known, frugal=True)


def _newton(
    problem: FiniteProblem,
    start: FiniteState,
    t: float,
    ties: Ties,
    step: Array,
    constraint: Constraint | None,
    tolerance: float,
    known: KnownTangent | None,
    frugal: bool,
) -> FiniteState:
    """Iterate from `start` after a first step that satisfies the supports (and is a mere prediction)."""
    # Newton's method with predicted stresses:
    # 1. Compute the residual r = f - W' at q, and its size relative to the largest nodal force.
    # 2. Factorise K: strains from q, but the stresses of its geometric part from the step before (see the module's
    #    docstring).
    # 3. Compute dq = K^-1 r, without travelling waves if they are held, or bordered by the constraint of a path.
    # 4. Predict the next stresses, C (eps + eps' dq), from the old q, if a new K needs them.
    # 5. Stop when the work r . dq is at rounding and r was already small before the step. The scales are the shell's
    #    own forces and energy, plus those by rounding in a rigidly moved shell, which has neither.
    # 6. Add the forces of obstacles and their part of K. Obstacles that are touched for the first time are soft for a
    #    few iterations, and then harden. If gaps are still open at the end, continue with the pressures as multipliers.
    # 7. If `frugal`, try the old tangent first in 2. and 3.: a solve costs a tenth of a tangent. Its step is kept if
    #    the work falls fast. The work then falls by a constant ratio, and 5. requires less of it.
    # The textbook takes the stresses of q itself, and damps its steps by a line search. A thin shell's membrane
    # stresses after a bending step are spurious and large, and would spoil K. There is no line search, since the
    # residual may grow at first although the step is right. The caller shortens a step that does not converge.
    q, strained, predicted = start.q, start.strained, partial(tuple, start.strained.stresses)
    factor: TangentFactor | None = None
    pressing = problem.obstacle_contact(start, t)
    if np.any(step):
        predicted = partial(problem.energy.predicted_stresses, strained, step)
        q = q + step
        strained = problem.energy.deform(q)
    first, before, residuals, waves = 0.0, np.inf, [], problem.wave_direction(start.q)
    if known is not None:
        factor, before = known.factor, known.work
    elif _is_rounding(problem, start, step):
        factor = start.factor  # at the start itself the tangent is known
    hold = None if factor is None else HeldDirection.from_ties(ties, factor, waves)
    pressed = pressing.contact_at(q) if pressing else None
    membrane = problem.case.material.membrane_stiffness
    for iteration in range(1, (MOST_IN_CONTACT if pressing else MOST_ITERATIONS) + 1):
        forces = problem.forces(q, t)
        if pressed:
            forces = forces + pressed.nodal
        right = forces - strained.forces
        # The scale includes the start's forces: an unloaded shell has no others at its end.
        largest = max(np.abs(forces).max(), np.abs(strained.forces).max(), np.abs(start.strained.forces).max())
        unbalanced, moved = _largest_free_force(ties, right), UNSTRAINED * float(np.abs(q).max())
        residuals.append(unbalanced / max(largest, np.finfo(float).tiny))
        aged = frugal and not pressing and factor is not None and before < np.inf
        if aged and factor is not None and hold is not None:
            step, change = _step(problem, ties, factor, right, q, t, constraint, hold)
            aged = abs(float(np.sum(right * step))) <= SLOW * before
        if not aged:
            if iteration > 1 or factor is None or known is not None:
                try:
                    contact = (pressing, pressed) if pressing and pressed else None
                    factor = problem.factorised(q, t, strained, predicted(), contact)
                except NotPositiveDefiniteError:
                    raise NotConvergedError from None
                hold = HeldDirection.from_ties(ties, factor, waves)
            assert factor is not None
            assert hold is not None
            step, change = _step(problem, ties, factor, right, q, t, constraint, hold)
        t += change
        decrement = abs(float(np.sum(right * step)))
        predicted = partial(problem.energy.predicted_stresses, strained, step)
        q = q + step
        strained = problem.energy.deform(q)
        # The scale also includes the start's energy, for the same reason.
        scale = max(strained.energy + abs(float(np.sum(forces * q))), start.strained.energy)
        first = first or decrement
        # Spurious stresses may raise the work for a few iterations, but not beyond this bound.
        if not np.isfinite(scale) or decrement > HOPELESS * first:
            break
        # r . K^-1 r is also small for a large r along a stiff direction, hence the second condition.
        least = STRICT * tolerance if aged else tolerance
        idle = decrement <= max(least * scale, membrane * moved**2)
        settled = idle and unbalanced <= max(BALANCED * largest, membrane * moved)
        before = decrement
        if pressing:
            if pressing.softer and (settled or iteration % FEW == 0):
                pressing, settled, first = replace(pressing, softer=pressing.softer[1:]), False, 0.0
            pressing = replace(pressing, held=None)
            pressed = pressing.contact_at(q)
            if settled and not pressed.gaps_are_closed:
                pressing, settled = pressing.next_round(pressed), False
                pressed = pressing.contact_at(q)
        if settled:
            assert hold is not None
            angles, forgiven = problem.angles(q, start), int(hold.negative)
            found = FiniteState(t, q, strained, angles, factor, iteration, tuple(residuals), forgiven=forgiven)
            return replace(found, pressure=pressed.pressure, touch=pressed.forces) if pressed else found
    raise NotConvergedError


def _step(
    problem: FiniteProblem,
    ties: Ties,
    factor: TangentFactor,
    right: Array,
    q: Array,
    t: float,
    constraint: Constraint | None,
    hold: HeldDirection,
) -> tuple[Array, float]:
    """Return a step (nodes, 12) by a tangent, and that of the load factor."""
    if constraint is not None:
        return _bordered_step(problem, ties, factor, right, q, t, constraint)
    return hold.without_direction(solve_on_free(ties, factor, right)), 0.0


def _bordered_step(
    problem: FiniteProblem, ties: Ties, factor: TangentFactor, right: Array, q: Array, t: float, constraint: Constraint
) -> tuple[Array, float]:
    # Bordering: the matrix [K, -f'; c, d] is neither symmetric nor of the mesh's pattern. Two solves with the
    # factor of K replace it: dq = K^-1 r + dt K^-1 f', with dt from the constraint. At a limit point itself K is
    # singular, but iterations do not hit it to rounding.
    rate = problem.force_rate(q)
    both = ties.to_free(np.stack([right, rate], axis=-1))
    solved = ties.to_nodal(factor.solve(both) * ties.free[..., None])
    fixed, moving = solved[..., 0], solved[..., 1]
    row = constraint.row
    missing = constraint.value - float(np.sum(row * (q + fixed))) - constraint.factor * t
    slope = float(np.sum(row * moving)) + constraint.factor
    if slope == 0.0:
        raise NotConvergedError
    change = missing / slope
    return fixed + change * moving, change


def _largest_free_force(ties: Ties, forces: Array) -> float:
    return float(np.abs(ties.to_free(forces[..., None])).max())
