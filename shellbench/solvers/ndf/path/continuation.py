"""The path of a field from rest: load steps, displacement control, and arc length (Riks 1979, IJSS 15).

Marks are landed on, by load or by displacement. A step is as long as Newton's method (see `newton`) takes it, and cut
where it does not converge or, under load control, leads to a state that is no minimum of the energy, or, by arc length,
turns away from the tangent it started along.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.records.path_end import branch_passed
from shellbench.solvers.ndf.path.basis import NotConvergedError
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import Constraint, PathState, drift, equilibrium, on_path

Find = Callable[[PathProblem, PathState, float], PathState]
"""Finds the state at a load factor from another one, or raises `NotConvergedError`."""

EASY = 6  # iterations after which the next step may be longer
GROWTH, CUT = 2.0, 0.5
FIRST_STEP = 1 / 8  # of the path under load control
SMALLEST_STEP = 1e-4  # of the path
PATH_STEPS = 32  # steps of a path that is followed by displacement, and of its first length by arc
LONGEST_ARC = 1.5  # in units of the first one
STRAIGHT = 0.7  # cosine between a step and the tangent it started along, below which it may be on another branch
MOST_STEPS = 1000
CLOSE, CLOSER = (
    1 / 8,
    1 / 4,
)  # of the longest step: one over a turning point is no longer, and cut to this share if it is
UNMOVED = 1e-12  # rate of a displacement, relative to what it could be, that is rounding
SAMPLES = 9  # points a side at which the length of an arc is measured


class PathEndsError(Exception):
    """The path can't be followed further; the message is a clause that says why."""


def load_steps(problem: PathProblem, marks: Sequence[float], find: Find = equilibrium) -> Iterator[PathState]:
    """Yield the states from rest to the last of increasing load factors, each found from the one before.

    Raises
    ------
    PathEndsError
        If a step can't be cut further.
    """
    # Load control: equal parts up to the next mark, longer after an easy step, half after a failure. An unstable state
    # counts as a failure: a shorter step may stay on the stable branch.
    state, end = PathState.rest(problem), marks[-1]
    step = FIRST_STEP * end
    for mark in marks:
        while state.t < mark:
            target = landing(state.t, mark, step)
            try:
                found = find(problem, state, target)
                reason = "" if found.stable else f"the state at load factor {target:.6g} is not stable"
            except NotConvergedError:
                found, reason = state, f"no equilibrium was found at load factor {target:.6g}"
            if reason:
                step = (target - state.t) * CUT
                if step < SMALLEST_STEP * end:
                    raise PathEndsError(reason)
                continue
            if found.iterations <= EASY:
                step = max(step, (target - state.t) * GROWTH)
            state = found
            yield state


def displacement_steps(problem: PathProblem, row: Tensor, marks: Sequence[float], end: float) -> Iterator[PathState]:
    """Yield the states at increasing values of the displacement row . w, the load factor unknown.

    Raises
    ------
    PathEndsError
        If the loads do not move it, a step can't be cut further, or the path has passed a branch.
    """
    # Displacement control: row . w is given and t unknown, so that limit points of the load are passed.
    # 1. Predict along the tangent dw/dt, and correct by Newton's method bordered by row . w = target.
    # 2. Where the load turns between two states, repeat the step shorter.
    # 3. Compare the sign of the tangent's determinant with the direction of the load: a branch changes only the former.
    state, value = PathState.rest(problem), 0.0
    first = _first_rate(row, drift(problem, state))
    step = longest = end / PATH_STEPS
    rising = True
    for mark in sorted({*marks, end}):
        while value < mark:
            target = landing(value, mark, step)
            try:
                found = _to_displacement(problem, state, row, value, target)
                rises = float(row @ drift(problem, found)) * first > 0
            except NotConvergedError:
                step = (target - value) * CUT
                if step < SMALLEST_STEP * end:
                    raise PathEndsError(f"no equilibrium was found at a displacement of {target:.6g}") from None
                continue
            if rises != rising and target - value > CLOSE * longest:
                step = CLOSER * (target - value)
                continue
            _check_branch(problem.ansatz.case, found, rises)
            state, value, rising = found, target, rises
            yield state
            step = min(longest, step * GROWTH) if state.iterations <= EASY else step


def arc_length_steps(problem: PathProblem, row: Tensor, marks: Sequence[float], end: float) -> Iterator[PathState]:
    """Yield the states along the path by arc length, until the displacement row . w first reaches `end`.

    An arc is the root mean square of the displacement's change over a grid.

    Raises
    ------
    PathEndsError
        If the loads do not move the displacement, a step can't be cut further, or the path has passed a branch or does
        not get there.
    """
    # Arc length after Riks, in the plane normal to the tangent:
    # 1. Predict by an arc along the tangent, in the direction of travel; correct in the plane.
    # 2. Cut a step that does not converge, or that leads aside, by the cosine with the tangent.
    # 3. Shorten one over a turning point, and check that no branch was passed.
    # 4. Land on the marks at the displacement's first passage.
    # Textbooks measure an arc by the unknowns. Weights of random features have no magnitude of their own, so the
    # displacement at points is measured instead. The load is left out of the arc, as Crisfield proposed.
    measured = _samples(problem)
    state, value, highest = PathState.rest(problem), 0.0, 0.0
    waiting = sorted({*marks, end})
    tangent = drift(problem, state)
    first = _first_rate(row, tangent)
    seen = measured @ tangent
    arc = end / PATH_STEPS / abs(first) * float(seen.norm())
    longest, sign, heading = LONGEST_ARC * arc, math.copysign(1.0, first), 1.0
    for _ in range(MOST_STEPS):
        length = float(seen.norm())
        change = sign * arc / length
        arc_row = measured.T @ seen * (sign / length)
        constraint = Constraint(arc_row, float(arc_row @ state.weights) + arc)
        try:
            found = on_path(problem, state, constraint, (change * tangent, change))
            moved = measured @ (found.weights - state.weights)
            if arc < STRAIGHT * float(moved.norm()):
                raise NotConvergedError
            ahead = drift(problem, found)
        except NotConvergedError:
            arc *= CUT
            if arc < SMALLEST_STEP * longest:
                raise PathEndsError(f"no equilibrium was found beyond load factor {state.t:.6g}") from None
            continue
        # The direction of travel follows the step just made. The sign of det K, the textbook's, turns at a branch as
        # well.
        sign_found = math.copysign(1.0, float(moved @ (measured @ ahead)))
        heads = math.copysign(1.0, float(row @ ahead)) * sign_found
        if (sign_found, heads) != (sign, heading) and arc > CLOSE * longest:
            arc *= CLOSER
            continue
        _check_branch(problem.ansatz.case, found, sign_found * first > 0)
        reached = float(row @ found.weights)
        near, at = state, value
        while waiting and reached >= waiting[0] > highest:
            try:
                near = _to_displacement(problem, near, row, at, waiting[0])
            except NotConvergedError:
                raise PathEndsError(f"the state at a displacement of {waiting[0]:.6g} was not found") from None
            at = waiting.pop(0)
            yield near
        if not waiting:
            return
        if reached != at:
            yield found
        state, value, highest = found, reached, max(highest, reached)
        tangent, sign, heading = ahead, sign_found, heads
        seen = measured @ tangent
        # Unlike a load step an arc is also cut after a slow step that converged.
        arc = min(longest, arc * GROWTH**0.5) if found.iterations <= EASY else arc * CUT**0.5
    raise PathEndsError(f"the path did not reach a displacement of {end:.6g} in {MOST_STEPS} steps")


def _first_rate(row: Tensor, tangent: Tensor) -> float:
    """Return the controlled displacement's rate at rest."""
    rate = float(row @ tangent)
    if not abs(rate) > UNMOVED * float(row.norm() * tangent.norm()):
        raise PathEndsError("the loads do not move the displacement that the path is followed to")
    return rate


def _check_branch(case: Case, found: PathState, rises: bool) -> None:
    """Check that only limit points were passed: there the tangent's determinant changes sign with the load's rate."""
    if found.tangent is not None and found.tangent.positive != rises:
        raise PathEndsError(branch_passed(case, found.t))


def landing(value: float, mark: float, step: float) -> float:
    """Return the end of the next of equal steps to a mark, none longer than `step`."""
    # Equal parts leave no short step before a mark. The factor forgives rounding in the count.
    parts = math.ceil((mark - value) / step * (1 - 1e-9))
    return mark if parts <= 1 else value + (mark - value) / parts


def _to_displacement(problem: PathProblem, state: PathState, row: Tensor, value: float, target: float) -> PathState:
    tangent = drift(problem, state)
    rate = float(row @ tangent)
    if rate == 0.0:
        raise NotConvergedError
    change = (target - value) / rate
    return on_path(problem, state, Constraint(row, target), (change * tangent, change))


def _samples(problem: PathProblem) -> Tensor:
    """Return the rows (3 n, 3 M) of the displacement on a grid of n points, divided by the root of n."""
    points = problem.ansatz.case.surface.domain.grid(SAMPLES, SAMPLES).reshape(-1, 2)
    rows = [problem.row(points[[k]], np.eye(3)[[c]]) for k in range(len(points)) for c in range(3)]
    samples: Tensor = torch.stack(rows) / len(points) ** 0.5
    return samples
