"""Paths step by step: under load, by a displacement, past marks by arc length, and over an edit of the shell."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar

from shellbench.solvers.stepping.control import (
    CLOSE,
    CLOSER,
    CUT,
    EASY,
    GROWTH,
    SMALLEST_STEP,
    NotConvergedError,
    PathEndsError,
    State,
    step_end,
)

Found = TypeVar("Found", bound=State)
Start = TypeVar("Start")

SHORTEST_EDIT = 1 / 32  # of the way of an edit: where a shorter step were needed, the path is followed from rest


class ControlledPath(Protocol[Found]):
    """A path that is controlled by a displacement; the load factor is an unknown."""

    def rate(self, state: Found) -> float:
        """Return the rate of the displacement in the load factor; NotConvergedError if the tangent is singular."""

    def to_displacement(self, state: Found, value: float, target: float) -> Found:
        """Return the state at a displacement, from one at another; NotConvergedError if it is not found."""

    def check_branch(self, state: Found, rises: bool) -> None:
        """Raise PathEndsError if the path has passed a branch; `rises` is True if the load rises along it."""


def load_steps(
    find: Callable[[Found, float], Found],
    start: Found,
    marks: Sequence[float],
    first: float,
    shortest: float,
    easy: int = EASY,
) -> Iterator[Found]:
    """Yield the states of equilibrium on the way from one to the last of increasing load factors.

    Parameters
    ----------
    find
        Returns the state at a load factor from another one, or raises NotConvergedError.
    start
        A state to go on from.
    marks
        Load factors to land on; those before the start are left out.
    first, shortest
        Length of the first step, and of the shortest one.
    easy
        Iterations of a state after which the next step may be longer.

    Raises
    ------
    PathEndsError
        If a step can't be cut further, or a state is no minimum.
    """
    # 1. Take equal steps of at most `step` to the next mark.
    # 2. After a failure, cut the step; a state that is found but not stable counts as a failure, since a shorter step
    #    may stay on the stable branch.
    # 3. After an easy step, let `step` grow; the growth is judged by the step made, so that a short step before a mark
    #    leaves `step` unchanged.
    state, step = start, first
    for mark in marks:
        while state.t < mark:
            target = step_end(state.t, mark, step)
            try:
                found = find(state, target)
                reason = "" if found.stable else f"the state at load factor {target:.6g} is not stable"
            except NotConvergedError:
                found, reason = state, f"no equilibrium was found at load factor {target:.6g}"
            if reason:
                step = (target - state.t) * CUT
                if step < shortest:
                    raise PathEndsError(reason)
                continue
            if found.iterations <= easy:
                step = max(step, (target - state.t) * GROWTH)
            state = found
            yield state


def displacement_steps(
    path: ControlledPath[Found], rest: Found, first_rate: float, marks: Sequence[float], end: float, share: float
) -> Iterator[Found]:
    """Yield the states at increasing values of a displacement; the load factor is unknown.

    Parameters
    ----------
    path
        The path to follow.
    rest, first_rate
        The unloaded state, and the rate of the displacement there.
    marks, end
        Values to land on, and the last one.
    share
        Longest step, as a share of the path.

    Raises
    ------
    PathEndsError
        If a step can't be cut further, or the path has passed a branch.
    """
    # The displacement is given and t is unknown, so that limit points of the load are passed.
    # 1. Predict along the tangent to the next value, and correct by Newton's method.
    # 2. If the load turns between two states, repeat the step shorter: a turning point and a branch within one step
    #    hide each other. Within a short step this is less likely.
    # 3. Compare the direction of the load with the tangent's inertia, which distinguishes a branch from a limit point.
    state, value, rising = rest, 0.0, True
    step = longest = end * share
    for mark in sorted({*marks, end}):
        while value < mark:
            target = step_end(value, mark, step)
            try:
                found = path.to_displacement(state, value, target)
                rises = path.rate(found) * first_rate > 0
            except NotConvergedError:
                step = (target - value) * CUT
                if step < SMALLEST_STEP * end:
                    raise PathEndsError(f"no equilibrium was found at a displacement of {target:.6g}") from None
                continue
            if rises != rising and target - value > CLOSE * longest:
                step = CLOSER * (target - value)
                continue
            path.check_branch(found, rises)
            state, value, rising = found, target, rises
            yield state
            step = min(longest, step * GROWTH) if state.iterations <= EASY else step


class Marks(Generic[Found]):
    """Values of the displacement on which a path by arc length lands, each at its first passage.

    After a snap-back the same value belongs to another state, which does not count.
    """

    def __init__(self, path: ControlledPath[Found], marks: Sequence[float], end: float) -> None:
        self.path = path
        self.waiting = sorted({*marks, end})
        self.highest = 0.0

    def states_passed(self, state: Found, value: float, found: Found, reached: float) -> Iterator[Found]:
        """Yield the states at the marks that a step from `value` to `reached` passes, and the step's own after them.

        The step's own state is left out after the last mark, and if it is the state at a mark.

        Raises
        ------
        PathEndsError
            If the state at a mark is not found.
        """
        near, at = state, value
        while self.waiting and reached >= self.waiting[0] > self.highest:
            mark = self.waiting.pop(0)
            try:
                near = found if reached == mark else self.path.to_displacement(near, at, mark)
            except NotConvergedError:
                raise PathEndsError(f"the state at a displacement of {mark:.6g} was not found") from None
            at = mark
            yield near
        self.highest = max(self.highest, reached)
        if self.waiting and reached != at:
            yield found


def follow_edit(find: Callable[[Start, float], tuple[Found, Start]], start: Start) -> tuple[Found, int]:
    """Return the state at the end of an edit, and the iterations of all states on the way.

    The edit is one step if Newton's method converges easily, else several shorter ones. All states on the way are
    minima, so that the branch is that of the earlier shell, as far as continuation shows.

    Parameters
    ----------
    find
        Returns the state at a share of the edit, and the start of the next step; or raises NotConvergedError.
    start
        Start of the first step: the earlier shell's state.

    Raises
    ------
    PathEndsError
        If a step can't be cut further.
    """
    share, step, iterations = 0.0, 1.0, 0
    while share < 1.0:
        target = min(1.0, share + step)
        try:
            found, onward = find(start, target)
            iterations += found.iterations
            easy = found.stable and (found.iterations <= EASY or step <= 2 * SHORTEST_EDIT)
        except NotConvergedError:
            easy = False
        if not easy:
            step *= CUT
            if step < SHORTEST_EDIT:
                raise PathEndsError(f"the edit could not be followed beyond {share:.0%} of it")
            continue
        start, share, step = onward, target, step * GROWTH
    return found, iterations
