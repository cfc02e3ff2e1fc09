"""Following the path of equilibrium from rest: load steps, displacement control, and arc length.

Load steps are as long as Newton's method takes them, and cut where it does not. Under displacement control and arc
length the load factor is an unknown: the additional equation prescribes the path's displacement, or lies in the plane
normal to the path's tangent (Riks 1979), so that limit points and snap-backs are passed. Marks (`Case.states`) are
always landed on, by load or by displacement.

Riks (1979), An incremental approach to the solution of snapping and buckling problems, IJSS 15.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.measure import unit
from shellbench.problems.shell.places import Point
from shellbench.problems.shell.quantities import DisplacementQuantity
from shellbench.solvers.fem.assembly import COMPONENTS
from shellbench.solvers.fem.finite_state import Constraint, FiniteState
from shellbench.solvers.fem.mesh import KINDS, kind_scales, tabulate
from shellbench.solvers.fem.problem import FiniteProblem, NotConvergedError

Array = NDArray[np.float64]

EASY = 6  # iterations after which the next step may be longer
EASY_IN_CONTACT = 20  # the same where points come into contact, a few in each iteration
GROWTH, CUT = 2.0, 0.5  # of a step after an easy one, and after one that did not converge
SMALLEST_STEP = 1e-4  # of the whole path
STEP_SHARE = 1 / 24  # of the path: the longest step by displacement, and the first one by arc length
LONGEST_ARC = 1.5  # arc in units of the first one
MOST_STEPS = 2000  # of a path that is followed by arc length
STRAIGHT = 0.7  # least share of a step that lies along the path's tangent: less is another branch
CLOSE, CLOSER = (
    1 / 8,
    1 / 4,
)  # of the longest step: one over a turning point is no longer, and cut to this share if it is
UNMOVED = 1e-12  # rate of a displacement, relative to what it could be, that is rounding


class PathEndsError(Exception):
    """The path can't be followed further; the message is a clause that says why."""


def load_steps(
    problem: FiniteProblem, marks: Sequence[float], first: float, shortest: float, start: FiniteState | None = None
) -> Iterator[FiniteState]:
    """Yield the states of equilibrium on the way from rest to the last of increasing load factors.

    Parameters
    ----------
    problem
        What is solved.
    marks
        Load factors that are landed on.
    first, shortest
        Length of the first step, and of the shortest one.
    start
        A state to go on from; rest if None.

    Raises
    ------
    PathEndsError
        If a step can't be cut further, or a state is no minimum.
    """
    # Load control: equal parts of at most `step` up to the next mark. They are longer after an easy step, and half
    # after a failure. A state that is found but not stable counts as a failure. A shorter step may stay on the stable
    # branch. Growth is judged by the step made, not by the one wanted. A short one before a mark leaves `step` as it
    # is.
    state, step = start or problem.rest(), first
    for mark in (m for m in marks if m > (start.t if start else 0.0)):
        while state.t < mark:
            remaining = mark - state.t
            # Equal parts instead of full steps and a rest, which would be short. The factor forgives rounding in the
            # count.
            parts = np.ceil(remaining / step * (1 - 1e-9))
            target = mark if parts <= 1 else state.t + remaining / parts
            try:
                found = problem.equilibrium(state, target)
                reason = "" if found.stable else f"the state at load factor {target:.6g} is not stable"
            except NotConvergedError:
                found, reason = state, f"no equilibrium was found at load factor {target:.6g}"
            if reason:
                step = (target - state.t) * CUT
                if step < shortest:
                    raise PathEndsError(reason)
                continue
            if found.iterations <= (EASY if problem.points is None else EASY_IN_CONTACT):
                step = max(step, (target - state.t) * GROWTH)
            state = found
            yield state


def functional(problem: FiniteProblem, quantity: DisplacementQuantity) -> Array:
    """Return the row (nodes, 12) whose product with q is a displacement quantity."""
    mesh, case = problem.mesh, problem.case
    places = [case.places[name] for name in quantity.points]
    points = np.array([place.xi for place in places if isinstance(place, Point)])
    directions = np.array([unit(d) for d in quantity.directions])
    nodes, local, sizes = mesh.locate(points)
    basis = tabulate(local, (0, 0)) * kind_scales(sizes)[:, None] / mesh.node_scales[nodes]
    row = np.zeros((mesh.node_count, COMPONENTS, len(KINDS)))
    for p in range(len(points)):
        row[nodes[p]] += np.einsum("ak,c->ack", basis[p], directions[p]) / len(points)
    return row.reshape(mesh.node_count, -1)


def displacement_steps(
    problem: FiniteProblem, row: Array, marks: Sequence[float], end: float, share: float = STEP_SHARE
) -> Iterator[FiniteState]:
    """Yield the states at increasing values of the displacement row . q, the load factor unknown.

    No step is longer than this share of the path.

    Raises
    ------
    PathEndsError
        If the loads do not move it, a step can't be cut further, or the path has passed a branch.
    """
    # Displacement control: row . q is given and t unknown, so that limit points of the load are passed.
    # 1. Predict along the tangent dq/dt to the next value, and correct by Newton's method.
    # 2. Where the load turns between two states, repeat the step shorter.
    # 3. Compare the direction of the load with the inertia of the tangent, which tells a branch from a limit point.
    state, value, rising = problem.rest(), 0.0, True
    first = _first_rate(row, problem.drift(state))
    step = longest = end * share
    for mark in sorted({*marks, end}):
        while value < mark:
            remaining = mark - value
            parts = np.ceil(remaining / step * (1 - 1e-9))
            target = mark if parts <= 1 else value + remaining / parts
            try:
                found = _to_displacement(problem, state, row, value, target)
                rises = float(np.sum(row * problem.drift(found))) * first > 0
            except NotConvergedError:
                step = (target - value) * CUT
                if step < SMALLEST_STEP * end:
                    raise PathEndsError(f"no equilibrium was found at a displacement of {target:.6g}") from None
                continue
            # A turning point and a branch that one step passes together hide each other. Over a short step that is less
            # likely.
            if rises != rising and target - value > CLOSE * longest:
                step = CLOSER * (target - value)
                continue
            _check_branch(found, rises)
            state, value, rising = found, target, rises
            yield state
            step = min(longest, step * GROWTH) if state.iterations <= EASY else step


def _to_displacement(
    problem: FiniteProblem, state: FiniteState, row: Array, value: float, target: float
) -> FiniteState:
    drift = problem.drift(state)
    rate = float(np.sum(row * drift))
    if rate == 0.0:
        raise NotConvergedError
    change = (target - value) / rate
    return problem.on_path(state, Constraint(row, 0.0, target), (change * drift, change))


def _first_rate(row: Array, drift: Array) -> float:
    """Return the controlled displacement's rate at rest."""
    rate = float(np.sum(row * drift))
    # The product is at most that of the lengths, by Cauchy and Schwarz. So far below that it is rounding.
    if not abs(rate) > UNMOVED * float(np.linalg.norm(row) * np.linalg.norm(drift)):
        raise PathEndsError("the loads do not move the displacement that the path is followed to")
    return rate


def _check_branch(found: FiniteState, rises: bool) -> None:
    """Check that only limit points were passed: each changes the tangent's inertia by one, and the load's direction."""
    # At a limit point one eigenvalue changes its sign, and so does dt along the path. At a branch dt does not. An even
    # number of negative ones therefore goes with a load that rises. Two branches in one step go unseen.
    if found.factor is not None and (found.factor.negative % 2 == 0) != rises:
        raise PathEndsError(f"a branch of other equilibria was passed before load factor {found.t:.6g}")


def arc_length_steps(
    problem: FiniteProblem, row: Array, marks: Sequence[float], end: float, share: float = STEP_SHARE
) -> Iterator[FiniteState]:
    """Yield the states along the path by arc length, until the displacement row . q first reaches `end`.

    The first step moves the displacement by this share of the path, and none is much longer. Between steps the marks
    are landed on at the displacement's first passage.

    Raises
    ------
    PathEndsError
        If the loads do not move the displacement, a step can't be cut further, or the path has passed a branch or does
        not get there.
    """
    # Arc length after Riks, each step in four:
    # 1. Predict by an arc along the tangent of the path, in the direction of travel.
    # 2. Correct in the plane normal to it: row_of_arc . q = its value at the state + arc.
    # 3. Refuse what is not straight ahead or turns over a long step, and check for branches.
    # 4. Land on the marks that were passed, by displacement control, and go on from the state of the step.
    # Riks counts t in the arc, whose weight is then arbitrary. Here only displacements count, as Crisfield proposed.
    # Crisfield's cylinder leaves two roots to choose from. A plane leaves one.
    weights = np.zeros(row.shape)
    weights[:, :: len(KINDS)] = 1.0 / len(row)  # the mean square of the nodes' displacements

    def size(change: Array) -> float:
        return float(np.sqrt(np.sum(weights * change**2)))

    state, value, highest = problem.rest(), 0.0, 0.0
    waiting = sorted({*marks, end})
    drift = problem.drift(state)
    first = _first_rate(row, drift)
    arc = end * share / abs(first) * size(drift)
    longest, sign, heading = LONGEST_ARC * arc, float(np.sign(first)), 1.0
    for _ in range(MOST_STEPS):
        length = size(drift)
        change = sign * arc / length
        row_of_arc = weights * drift * sign / length
        target = float(np.sum(row_of_arc * state.q)) + arc
        try:
            found = problem.on_path(state, Constraint(row_of_arc, 0.0, target), (change * drift, change))
            # The arc is the step's component along the tangent, so that this ratio is a cosine.
            if arc < STRAIGHT * size(found.q - state.q):
                raise NotConvergedError
            ahead = problem.drift(found)
        except NotConvergedError:
            arc *= CUT
            if arc < SMALLEST_STEP * longest:
                raise PathEndsError(f"no equilibrium was found beyond load factor {state.t:.6g}") from None
            continue
        # The direction of travel is kept by the step just made. The textbook takes the sign of det K. That one turns at
        # a branch too, where the path goes straight on.
        sign_found = float(np.sign(np.sum(weights * (found.q - state.q) * ahead)))
        heads = float(np.sign(np.sum(row * ahead))) * sign_found
        # Load or displacement turns: a limit point or a snap-back is passed by a short step.
        if (sign_found, heads) != (sign, heading) and arc > CLOSE * longest:
            arc *= CLOSER
            continue
        _check_branch(found, sign_found * first > 0)
        reached = float(np.sum(row * found.q))
        # A mark counts at the displacement's first passage only. After a snap-back the same value belongs to another
        # state.
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
        drift, sign, heading = ahead, sign_found, heads
        # Unlike a load step an arc is also cut after a slow step that converged. The cut is milder than after a
        # failure.
        arc = min(longest, arc * GROWTH**0.5) if found.iterations <= EASY else arc * CUT**0.5
    raise PathEndsError(f"the path did not reach a displacement of {end:.6g} in {MOST_STEPS} steps")
