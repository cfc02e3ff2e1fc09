"""The path of a field from rest: load steps, displacement control, and arc length (Riks 1979, IJSS 15).

The path lands on marks, by load or by displacement. A step grows as long as Newton's method (see `newton`) converges.
It is cut if it does not converge, if it leads to a state that is no minimum of the energy (under load control), or if
it turns away from its initial tangent (by arc length).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.records.path_end import branch_passed
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import FIRST_STEP, Constraint, PathState, equilibrium, on_path, path_rate
from shellbench.solvers.stepping import paths
from shellbench.solvers.stepping.control import (
    ARC_CUT,
    ARC_GROWTH,
    CLOSE,
    CLOSER,
    CUT,
    EASY,
    LONGEST_ARC,
    SMALLEST_STEP,
    STRAIGHT,
    NotConvergedError,
    PathEndsError,
    checked_rate,
)
from shellbench.solvers.stepping.paths import Marks

Find = Callable[[PathProblem, PathState, float], PathState]
"""Finds the state at a load factor from another one, or raises `NotConvergedError`."""

PATH_STEPS = 32  # steps of a path that is followed by displacement, and of its first length by arc
MOST_STEPS = 1000  # of a path that is followed by arc length
ARC_SAMPLES = 9  # points a side at which the length of an arc is measured


@dataclass(frozen=True)
class ByDisplacement:
    """A problem whose path is controlled by the displacement row . w."""

    problem: PathProblem
    row: Tensor

    def rate(self, state: PathState) -> float:
        """Return the rate of the displacement in the load factor."""
        return float(self.row @ path_rate(self.problem, state))

    def first_rate(self, tangent: Tensor) -> float:
        """Return the rate of the displacement at rest by dw/dt; PathEndsError if the loads don't move it."""
        return checked_rate(float(self.row @ tangent), float(self.row.norm() * tangent.norm()))

    def to_displacement(self, state: PathState, value: float, target: float) -> PathState:
        """Return the state at a displacement, predicted along the tangent at another."""
        tangent = path_rate(self.problem, state)
        rate = float(self.row @ tangent)
        if rate == 0.0:
            raise NotConvergedError
        change = (target - value) / rate
        return on_path(self.problem, state, Constraint(self.row, target), (change * tangent, change))

    def check_branch(self, found: PathState, rises: bool) -> None:
        """Check that only limit points were passed: there the tangent's determinant and the load's rate change sign."""
        if found.tangent is not None and found.tangent.positive != rises:
            raise PathEndsError(branch_passed(self.problem.ansatz.case, found.t))


def load_steps(problem: PathProblem, marks: Sequence[float], find: Find = equilibrium) -> Iterator[PathState]:
    """Yield the states from rest to the last of increasing load factors; see `stepping.paths.load_steps`."""
    rest, end = PathState.rest(problem), marks[-1]
    yield from paths.load_steps(partial(find, problem), rest, marks, FIRST_STEP * end, SMALLEST_STEP * end)


def displacement_steps(problem: PathProblem, row: Tensor, marks: Sequence[float], end: float) -> Iterator[PathState]:
    """Yield the states at increasing values of the displacement row . w; see `stepping.paths.displacement_steps`."""
    path, rest = ByDisplacement(problem, row), PathState.rest(problem)
    first = path.first_rate(path_rate(problem, rest))
    yield from paths.displacement_steps(path, rest, first, marks, end, 1 / PATH_STEPS)


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
    # 2. Cut a step that does not converge, or that turns aside, by its cosine with the tangent.
    # 3. Shorten a step over a turning point, and check that no branch was passed.
    # 4. Land on the marks at the displacement's first passage.
    # Textbooks measure an arc by the unknowns. Weights of random features have no meaningful magnitude; the
    # displacement at points is measured instead. The load is left out of the arc, as Crisfield proposed.
    measured = _samples(problem)
    state, value, path = PathState.rest(problem), 0.0, ByDisplacement(problem, row)
    landings = Marks(path, marks, end)
    tangent = path_rate(problem, state)
    first = path.first_rate(tangent)
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
            ahead = path_rate(problem, found)
        except NotConvergedError:
            arc *= CUT
            if arc < SMALLEST_STEP * longest:
                raise PathEndsError(f"no equilibrium was found beyond load factor {state.t:.6g}") from None
            continue
        # The last step determines the direction of travel. The textbook's sign of det K also changes at a branch.
        sign_found = math.copysign(1.0, float(moved @ (measured @ ahead)))
        heads = math.copysign(1.0, float(row @ ahead)) * sign_found
        if (sign_found, heads) != (sign, heading) and arc > CLOSE * longest:
            arc *= CLOSER
            continue
        path.check_branch(found, sign_found * first > 0)
        reached = float(row @ found.weights)
        yield from landings.states_passed(state, value, found, reached)
        if not landings.waiting:
            return
        state, value = found, reached
        tangent, sign, heading = ahead, sign_found, heads
        seen = measured @ tangent
        # Unlike a load step, an arc is also cut after a slow step that converged.
        arc = min(longest, arc * ARC_GROWTH) if found.iterations <= EASY else arc * ARC_CUT
    raise PathEndsError(f"the path did not reach a displacement of {end:.6g} in {MOST_STEPS} steps")


def _samples(problem: PathProblem) -> Tensor:
    """Return the rows (3 n, 3 M) of the displacement on a grid of n points, divided by the root of n."""
    points = problem.ansatz.case.surface.domain.grid(ARC_SAMPLES, ARC_SAMPLES).reshape(-1, 2)
    rows = [problem.row(points[[k]], np.eye(3)[[c]]) for k in range(len(points)) for c in range(3)]
    samples: Tensor = torch.stack(rows) / len(points) ** 0.5
    return samples
