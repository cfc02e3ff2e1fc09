"""The path of a shell through buckling: its critical load, and the stable states beyond it.

Up to the first state that is no minimum of the energy the path is followed as under load control. The critical load is
where the tangent's smallest eigenvalue, relative to the stiffness at rest, passes zero: it is found between a stable
and an unstable state by the Illinois variant of regula falsi (Dowell & Jarratt 1971, BIT 11). A little beyond it the
shell relaxes from there (`relaxation`); from there on load steps are taken as long as they lead to stable
states, and where they don't the shell relaxes again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from shellbench.solvers.ndf.continuation import (
    CUT,
    EASY,
    FIRST_STEP,
    GROWTH,
    SMALLEST_STEP,
    STRAIGHT,
    PathEndsError,
    landing,
)
from shellbench.solvers.ndf.equilibrium import NotConvergedError, PathProblem
from shellbench.solvers.ndf.newton import PathState, equilibrium
from shellbench.solvers.ndf.relaxation import NEUTRAL, relaxed

LOCATED = 1e-4  # of the critical load factor: how well it is found
LEFT = 1e-2  # of the critical load factor: so far beyond it the shell is let go, before other modes can buckle too
OVERSHOT = 5e-2  # of the load factor where the smallest eigenvalue should vanish: no step goes farther beyond it
SHORT = 1 / 64  # of the path: a step this short that does not converge is one to another branch
SHORT_BUCKLED = 1 / 8  # the same of a buckled shell, which jumps from one pattern of waves to the next
SECANTS = 40  # trials of a critical load; bisections alone need some ten
ABOUT_TO_BUCKLE = 0.1  # eigenvalue, of 1 at rest, above which it is Newton's method that fails and not the shell


def follow_steps(problem: PathProblem, marks: Sequence[float]) -> Iterator[PathState]:
    """Yield stable states from rest to the last of increasing load factors, and the first critical one.

    Raises
    ------
    PathEndsError
        If no stable state is found, however short the step.
    """
    state = PathState.rest(problem)
    for state in _to_buckling(problem, marks):
        yield state
    if state.critical:
        yield from _beyond_buckling(problem, state, marks)


def _to_buckling(problem: PathProblem, marks: Sequence[float]) -> Iterator[PathState]:
    """Yield the states up to the last mark, or to the first critical one."""
    state, end = PathState.rest(problem), marks[-1]
    step, foretold = FIRST_STEP * end, end
    for mark in marks:
        while state.t < mark:
            target = min(landing(state.t, mark, step), (1 + OVERSHOT) * max(foretold, state.t))
            found = _stepped(problem, state, target)
            if found is not None and found.stable:
                if found.iterations <= EASY:
                    step = max(step, (target - state.t) * GROWTH)
                foretold = _zero(state, found) or end
                state = found
            elif found is None and target - state.t > SHORT * end:
                step = (target - state.t) * CUT
                continue
            else:
                state, foretold = _critical(problem, state, found, target), end
                if _lowest(state) <= ABOUT_TO_BUCKLE:
                    yield replace(state, critical=True)
                    return
                if target - state.t < SMALLEST_STEP * end:
                    raise PathEndsError(f"no equilibrium was found at load factor {target:.6g}")
            yield state


def _beyond_buckling(problem: PathProblem, state: PathState, marks: Sequence[float]) -> Iterator[PathState]:
    """Yield stable states from a critical one to the last mark."""
    end, step = marks[-1], LEFT * state.t
    for mark in marks:
        while state.t < mark:
            target = landing(state.t, mark, step)
            found = _stepped(problem, state, target, straight=False)
            if found is None and target - state.t > SHORT_BUCKLED * end:
                step = (target - state.t) * CUT
                continue
            if found is None or not found.stable:
                try:
                    found = relaxed(problem, state, target)
                except NotConvergedError:
                    step = (target - state.t) * CUT
                    if step < SMALLEST_STEP * end:
                        raise PathEndsError(f"no stable state was found at load factor {target:.6g}") from None
                    continue
                step = max(step, FIRST_STEP * end)
            elif found.iterations <= EASY:
                step = max(step, (target - state.t) * GROWTH)
            state = found
            yield state


def _critical(problem: PathProblem, stable: PathState, unstable: PathState | None, beyond: float) -> PathState:
    """Return the last stable state before a load factor at which there is an unstable one, or none.

    A field that is not quite symmetric may lead around the bifurcation: a state whose smallest eigenvalue has risen
    again is one of the buckled shell.
    """
    low, high = _lowest(stable), _lowest(unstable) if unstable is not None else None
    side = 0
    for _ in range(SECANTS):
        if beyond - stable.t <= LOCATED * beyond or abs(_lowest(stable)) <= NEUTRAL:
            break
        share = 0.5 if high is None else low / (low - high)
        t = stable.t + min(max(share, LOCATED), 1 - LOCATED) * (beyond - stable.t)
        found = _stepped(problem, stable, t)
        if found is not None and found.stable and _lowest(found) > _lowest(stable):
            found = None
        if found is not None and found.stable:
            stable, low = found, _lowest(found)
            high = high / 2 if high is not None and side > 0 else high
            side = 1
        else:
            beyond, high = t, _lowest(found) if found is not None else None
            low = low / 2 if side < 0 else low
            side = -1
    return stable


def _zero(before: PathState, after: PathState) -> float | None:
    """Return the load factor where the smallest eigenvalue vanishes if it goes on to fall as between two states."""
    fall = _lowest(before) - _lowest(after)
    return after.t + _lowest(after) / fall * (after.t - before.t) if fall > 0 else None


def _lowest(state: PathState) -> float:
    return 1.0 if state.tangent is None else state.tangent.lowest


def _stepped(problem: PathProblem, state: PathState, t: float, straight: bool = True) -> PathState | None:
    """Return the state at a load factor by Newton's method, None if it does not converge.

    Nor if it must be `straight` and leads elsewhere than it set out to, as a step over a bifurcation to the buckled
    shell does.
    """
    try:
        found = equilibrium(problem, state, t, NEUTRAL)
    except NotConvergedError:
        return None
    if not straight or state.tangent is None:
        return found
    ahead = state.tangent.solve(problem.deform(state.weights, t, state.deformed.angles).residual)
    moved = found.weights - state.weights
    along = problem.likeness(ahead, moved)
    return found if along >= STRAIGHT else None
