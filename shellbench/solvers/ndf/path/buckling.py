"""The path of a shell through buckling: its critical load, and the stable states beyond it.

Up to the first state that is no minimum of the energy, the path is followed under load control. At the critical load
the tangent's smallest eigenvalue, relative to the stiffness at rest, passes zero. It is found between a stable and an
unstable state by the Illinois variant of regula falsi (Dowell & Jarratt 1971). Slightly beyond it the shell relaxes to
a stable state (`relax_to_stable`). Load steps follow as long as they lead to stable states; otherwise the shell relaxes
again.

Relaxation: descent from any displacement to a stable state, by Newton's method in a trust region.

At each iterate the exact second-order model of the potential energy is minimised within a ball. Its radius follows from
the quality of the last prediction (Moré & Sorensen 1983, SIAM J. Sci. Stat. Comput. 4; Conn, Gould & Toint 2000). The
ball is measured by the stiffness at rest, so that the step is that of a pseudo-transient method,

    (K + mu K_rest) s = -g,

with the mu that the energy allows. It leaves a saddle along its most negative direction, always descends, and becomes
Newton's method at the end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.quadrature import ROUNDING
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import CONVERGED, FIRST_STEP, Deformed, PathState, equilibrium
from shellbench.solvers.stepping.control import (
    CUT,
    EASY,
    GROWTH,
    SMALLEST_STEP,
    STRAIGHT,
    Illinois,
    NotConvergedError,
    PathEndsError,
    step_end,
)

NEUTRAL = 1e-4
"""Eigenvalue of a tangent, relative to the stiffness at rest, that is called zero.

A perfect shell's smallest one falls from 1 at rest to 0 at the critical load, so one of this size moves that load by
about its own share. Waves that may travel around a shell have a zero one, of which a field makes a small number of
either sign."""
IMMATERIAL = 1e-4  # of the energy: largest predicted gain along neutral modes that is ignored
FIRST_RADIUS = 0.1  # of the norm of the present energy; the radius follows from gains after the first step
DOUBTED = 0.25  # these three are the usual ones (Conn, Gould & Toint 2000)
TRUSTED = 1 - DOUBTED  # shares of the predicted gain beyond which the radius grows, or below which it shrinks
WIDER, NARROWER = 2.0, 0.25
MOST_TRIALS = 400
SECULAR = 100  # bisections of the shift, at most
BISECTED = 1e-12  # relative width of the interval at which bisection ends: some thousand units of rounding


def relax_to_stable(problem: PathProblem, start: PathState, t: float) -> PathState:
    """Return a stable state at load factor t with at most the energy of the start there.

    Raises
    ------
    NotConvergedError
        If none was found.
    """
    # 1. Move the point supports, and decompose the tangent into all modes, once for each iterate.
    # 2. Drop the gradient's part along neutral modes if it is an artefact of the field.
    # 3. Stop at a minimum without a possible gain.
    # 4. Minimise the quadratic model in the ball, and try the step.
    # 5. Set the radius by the ratio of gain and prediction; move if the energy fell.
    # Textbooks factorise K + mu M again for each mu. These matrices are small enough for eigenvectors. With them a
    # trial of mu is a sum, and saddles and the hard case are visible.
    basis = problem.basis
    weights = start.weights + basis.held @ (problem.targets(t) - problem.constraints @ start.weights)
    deformed = problem.deform(weights, t, start.deformed.angles)
    size = _size(deformed)
    radius = FIRST_RADIUS * size
    model: tuple[Tensor, Tensor, Tensor] | None = None
    for iteration in range(1, MOST_TRIALS + 1):
        if model is None:
            tangent = basis.combine.T @ problem.tangent(deformed, t, weights) @ basis.combine
            if not bool(torch.isfinite(tangent).all()):
                raise NotConvergedError
            values, vectors = torch.linalg.eigh(tangent)
            # The gradient of the energy in the modes, -r. In this basis the stiffness at rest is the identity, and so
            # is the ball.
            model = values, vectors, -vectors.T @ (basis.combine.T @ deformed.residual)
        values, vectors, gradient = model
        scale = deformed.magnitude
        if float(values[0]) > -NEUTRAL:
            # Twice the gain of a Newton step, mode by mode.
            left = gradient**2 / values.abs().clamp_min(NEUTRAL)
            neutral = values.abs() <= NEUTRAL
            if float(left[neutral].sum()) <= IMMATERIAL * scale:  # an artefact of the field: not followed
                gradient, left = gradient.masked_fill(neutral, 0.0), left.masked_fill(neutral, 0.0)
            if float(left.sum()) <= CONVERGED * scale:
                return PathState(t, weights, deformed, iteration)
        step = trust_region_step(values, gradient, radius)
        predicted = -float(gradient @ step + (values * step * step).sum() / 2)
        change = basis.combine @ (vectors @ step)
        tried = problem.deform(weights + change, t, deformed.angles)
        gain = deformed.potential - tried.potential
        length = float(step.norm())
        # A full Newton step inside the ball is no test of the radius, which grows only if it has limited the step.
        if gain < DOUBTED * predicted or not gain > 0:
            radius = NARROWER * length
        elif gain > TRUSTED * predicted and length > 0.99 * radius:
            radius *= WIDER
        if gain > 0:
            weights, deformed, model = weights + change, tried, None
        elif radius < ROUNDING * size:
            break
    raise NotConvergedError


def trust_region_step(values: Tensor, gradient: Tensor, radius: float) -> Tensor:
    """Return the step (n,) of least g . s + s . K s / 2 within |s| <= radius, all in the eigenvectors of K.

    `values` (n,) are the ascending eigenvalues of K, `gradient` (n,) is g.
    """
    # Moré & Sorensen: s = -(K + mu)^-1 g with K + mu semidefinite, and |s| = radius unless mu = 0.
    # 1. Take the Newton step if K is definite and the step fits into the ball.
    # 2. Treat the hard case: g has nearly no part along the lowest mode, and no mu makes s long enough.
    # 3. Else find mu by bisection, between the least allowed one and one that makes s short enough.
    # Moré & Sorensen take Newton's method for 1 / |s|. Bisection needs no safeguards, and costs a sum each time.
    lowest = float(values[0])
    if lowest > 0:
        step = -gradient / values
        if float(step.norm()) <= radius:
            return step
    low = max(0.0, -lowest)
    high = low + float(gradient.norm()) / radius  # there the step is no longer than the radius
    floor = max(abs(lowest), float(values[-1]) * torch.finfo(values.dtype).eps)
    near = low + BISECTED * floor
    hard = -gradient / (values + near)
    if float(hard.norm()) < radius:  # the gradient step hardly leaves the saddle: the lowest direction fills the ball
        sign = -1.0 if float(gradient[0]) > 0 else 1.0
        rest = hard.clone()
        rest[0] = 0.0
        hard[0] = sign * max(radius**2 - float(rest @ rest), 0.0) ** 0.5
        return hard
    for _ in range(SECULAR):
        middle = (low + high) / 2
        if float((gradient / (values + middle)).norm()) > radius:
            low = middle
        else:
            high = middle
        if high - low <= BISECTED * high:
            break
    # From the upper end, so that the step is never longer than the radius.
    return -gradient / (values + high)


def _size(deformed: Deformed) -> float:
    """Return the norm of the displacement that stores the energy with the stiffness at rest."""
    return math.sqrt(2 * deformed.magnitude)


LOCATED = NEUTRAL  # of the critical load factor: its accuracy; an eigenvalue's error moves it by the same share
# The cases of the tuning of the next ones are not on record.
LEFT = 1e-2  # of the critical load factor: distance beyond it where relaxation starts, before other modes buckle
OVERSHOT = 5e-2  # of the load factor with a predicted zero eigenvalue: no step goes farther beyond it
SHORT = 1 / 64  # of the path: a shorter step that does not converge leads to another branch
SHORT_BUCKLED = 1 / 8  # the same for a buckled shell, which jumps from one pattern of waves to the next
SECANTS = 40  # trials of a critical load; bisections alone need some ten
ABOUT_TO_BUCKLE = 0.1  # eigenvalue, of 1 at rest, above which a failure is that of Newton's method, not of the shell


def follow_steps(problem: PathProblem, marks: Sequence[float], coarse: Sequence[PathState] = ()) -> Iterator[PathState]:
    """Yield stable states from rest to the last of increasing load factors, and the first critical one.

    Newton's method starts from the states of a `coarse` path, if there is one, fitted to this problem. Buckled states
    serve only if the coarse shell buckles at nearly the same load; otherwise its waves may differ.

    Raises
    ------
    PathEndsError
        If no stable state is found with the shortest step, or a mark lies beyond buckling and the path ends there.
    """
    state, case = PathState.rest(problem), problem.ansatz.case
    critical = next((near.t for near in coarse if near.critical), math.inf)
    before = {near.t: near for near in coarse if near.t <= critical}
    for state in _to_buckling(problem, sorted({*marks, *before}), before):
        yield state
    if not state.critical:
        return
    if not case.ends_critical:
        alike = abs(state.t - critical) <= LEFT * critical
        buckled = {near.t: near for near in coarse if alike and near.t > max(critical, state.t)}
        yield from _beyond_buckling(problem, state, marks, buckled)
    elif any(mark > state.t for mark in case.states):
        raise PathEndsError(f"the shell buckles at load factor {state.t:.6g}")


def _to_buckling(problem: PathProblem, marks: Sequence[float], coarse: dict[float, PathState]) -> Iterator[PathState]:
    """Yield the states up to the last mark, or to the first critical one; `coarse` states are initial guesses."""
    # Load steps to the first state that is no minimum:
    # 1. Predict the load factor where the lowest eigenvalue vanishes, by a secant through the last two states.
    # 2. Step, but not far beyond it: from too far, Newton's method may find a buckled state.
    # 3. If a short step fails, or a state is unstable, search the critical state in between.
    # 4. If that state is far from buckling, only Newton's method had failed: continue from it.
    state, end = PathState.rest(problem), marks[-1]
    step, predicted = FIRST_STEP * end, end
    for mark in marks:
        while state.t < mark:
            near = coarse.pop(mark, None)
            target = mark if near else min(step_end(state.t, mark, step), (1 + OVERSHOT) * max(predicted, state.t))
            found = _step_to(problem, state, target, near)
            if found is not None and found.stable:
                if found.iterations <= EASY:
                    step = max(step, (target - state.t) * GROWTH)
                predicted = _critical_load(state, found) or end
                state = found
                if abs(_lowest_eigenvalue(state)) <= NEUTRAL:
                    yield replace(state, critical=True)
                    return
            elif found is None and target - state.t > SHORT * end:
                step = (target - state.t) * CUT
                continue
            else:
                before, state, predicted = state, _critical_state(problem, state, found, target), end
                if _lowest_eigenvalue(state) <= ABOUT_TO_BUCKLE:
                    yield replace(state, critical=True)
                    return
                if state is before or target - state.t < SMALLEST_STEP * end:
                    raise PathEndsError(f"no equilibrium was found at load factor {target:.6g}")
            yield state


def _beyond_buckling(
    problem: PathProblem, state: PathState, marks: Sequence[float], coarse: dict[float, PathState]
) -> Iterator[PathState]:
    """Yield stable states from a critical one to the last mark; `coarse` states are initial guesses."""
    # Beyond the critical state a step need not be straight: the shell may jump to another pattern. Newton's method is
    # tried first, since it is quick. If it fails or finds a saddle, the trust region descends.
    end, step = marks[-1], LEFT * state.t
    for mark in marks:
        while state.t < mark:
            near = coarse.pop(mark, None)
            target = mark if near else step_end(state.t, mark, step)
            found = _step_to(problem, state, target, near, straight=False)
            if found is None and not near and target - state.t > SHORT_BUCKLED * end:
                step = (target - state.t) * CUT
                continue
            if found is None or not found.stable:
                try:
                    found = relax_to_stable(problem, near or state, target)
                except NotConvergedError:
                    step = (target - state.t) * CUT
                    if step < SMALLEST_STEP * end:
                        raise PathEndsError(f"no stable state was found at load factor {target:.6g}") from None
                    continue
            elif found.iterations <= EASY:
                step = max(step, (target - state.t) * GROWTH)
            state = found
            yield state


def _critical_state(problem: PathProblem, stable: PathState, unstable: PathState | None, beyond: float) -> PathState:
    """Return the last stable state before a load factor with an unstable state, or without a state.

    A field that is not quite symmetric may pass around the bifurcation: a state whose smallest eigenvalue has risen
    again is one of the buckled shell.
    """
    # Regula falsi for the root of the lowest eigenvalue. The textbook has a value at both ends. Here the upper end may
    # have no state, and then the interval is bisected.
    root = Illinois(_lowest_eigenvalue(stable), _lowest_eigenvalue(unstable) if unstable is not None else None)
    for _ in range(SECANTS):
        if beyond - stable.t <= LOCATED * beyond or abs(_lowest_eigenvalue(stable)) <= NEUTRAL:
            break
        t = stable.t + min(max(root.trial_share, LOCATED), 1 - LOCATED) * (beyond - stable.t)
        found = _step_to(problem, stable, t)
        if found is not None and found.stable and _lowest_eigenvalue(found) > _lowest_eigenvalue(stable):
            found = None
        if found is not None and found.stable:
            stable = found
            root.raise_low(_lowest_eigenvalue(found))
        else:
            beyond = t
            root.lower_high(_lowest_eigenvalue(found) if found is not None else None)
    return stable


def _critical_load(before: PathState, after: PathState) -> float | None:
    """Return the load factor where the smallest eigenvalue vanishes, extrapolated linearly from two states."""
    fall = _lowest_eigenvalue(before) - _lowest_eigenvalue(after)
    return after.t + _lowest_eigenvalue(after) / fall * (after.t - before.t) if fall > 0 else None


def _lowest_eigenvalue(state: PathState) -> float:
    """Return the smallest eigenvalue of the tangent at a state, relative to the stiffness at rest, where it is 1."""
    return 1.0 if state.tangent is None else state.tangent.lowest


def _step_to(
    problem: PathProblem, state: PathState, t: float, near: PathState | None = None, straight: bool = True
) -> PathState | None:
    """Return the state at a load factor by Newton's method, from `near` if given; None if it does not converge.

    It is also None if the step must be `straight` but turns away from its tangent, like a step over a bifurcation to
    the buckled shell.
    """
    try:
        found = equilibrium(problem, near or state, t, NEUTRAL)
    except NotConvergedError:
        return None
    if not straight or state.tangent is None:
        return found
    # Compare the tangent's direction at the state with the step of Newton's method.
    ahead = state.tangent.solve(problem.deform(state.weights, t, state.deformed.angles).residual)
    moved = found.weights - state.weights
    along = problem.cosine(ahead, moved)
    return found if along >= STRAIGHT else None
