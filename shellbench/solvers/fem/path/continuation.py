"""Following the path of equilibrium from rest: load steps, displacement control, and arc length.

Load steps grow as long as Newton's method converges, and are cut if it does not. Under displacement control and arc
length the load factor is an unknown. The additional equation prescribes the path's displacement, or keeps the step in
the plane normal to the path's tangent (Riks 1979), so that limit points and snap-backs are passed. The path always
lands on marks (`Case.states`), by load or by displacement.

Riks (1979), An incremental approach to the solution of snapping and buckling problems, IJSS 15.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.quantities.measure import unit
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.problems.shell.question.places import Point
from shellbench.problems.shell.records.path_end import branch_passed
from shellbench.solvers.fem.mesh.basis import COMPONENTS, KINDS, kind_scales, tabulate
from shellbench.solvers.fem.path.finite_state import Constraint, FiniteState
from shellbench.solvers.fem.path.newton import equilibrium, state_on_path
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping import paths
from shellbench.solvers.stepping.control import (
    ARC_CUT,
    ARC_GROWTH,
    CLOSE,
    CUT,
    EASY,
    LONGEST_ARC,
    SAME,
    SMALLEST_STEP,
    STRAIGHT,
    NotConvergedError,
    PathEndsError,
    checked_rate,
    equal_marks,
)
from shellbench.solvers.stepping.paths import Marks

Array = NDArray[np.float64]

VERY_EASY, SPEEDING = 2, 3.0  # iterations after which an arc may be longer by far, and by how much
EASY_IN_CONTACT = 20  # iterations of an easy load step where points come into contact, a few in each of them
STEP_SHARE = 1 / 24  # of the path: the longest step by displacement, and the first one by arc length
MOST_ARCS = 2000  # of a path that is followed by arc length
CROWDED = 1 / 12  # of `CLOSE` is the distance of the states before and behind a turning point
NEAR = 4  # times as long may one be where stations lead: their tangents may tell late that they are over it


@dataclass(frozen=True)
class Station:
    """A state of the path from another mesh.

    Attributes
    ----------
    q, t
        Displacement (nodes, 12) on this mesh, and load factor.
    value
        The path's displacement on the other mesh.
    """

    q: Array
    t: float
    value: float


@dataclass(frozen=True)
class DisplacementControl:
    """A problem whose path is controlled by the displacement row . q."""

    problem: FiniteProblem
    row: Array

    def rate(self, state: FiniteState) -> float:
        """Return the rate of the displacement in the load factor."""
        return float(np.sum(self.row * self.problem.path_rate(state)))

    def first_rate(self, drift: Array) -> float:
        """Return the rate of the displacement at rest by dq/dt; PathEndsError if the loads don't move it."""
        return checked_rate(float(np.sum(self.row * drift)), float(np.linalg.norm(self.row) * np.linalg.norm(drift)))

    def to_displacement(self, state: FiniteState, value: float, target: float) -> FiniteState:
        """Return the state at a displacement, predicted along the tangent at another."""
        drift = self.problem.path_rate(state)
        rate = float(np.sum(self.row * drift))
        if rate == 0.0:
            raise NotConvergedError
        change = (target - value) / rate
        return state_on_path(self.problem, state, Constraint(self.row, 0.0, target), (change * drift, change))

    def check_branch(self, found: FiniteState, rises: bool) -> None:
        """Check that only limit points were passed: they change the tangent's inertia by one, and the load's sense."""
        # At a limit point one eigenvalue changes its sign, and so does dt along the path. At a branch dt does not.
        # Therefore the load rises if the number of negative eigenvalues is even. Two branches in one step are not
        # detected.
        if found.factor is not None and (found.factor.negative_count % 2 == 0) != rises:
            raise PathEndsError(branch_passed(self.problem.case, found.t))


def load_steps(
    problem: FiniteProblem, marks: Sequence[float], first: float, shortest: float, start: FiniteState | None = None
) -> Iterator[FiniteState]:
    """Yield the states of equilibrium under load from rest, or from `start`; see `stepping.paths.load_steps`."""
    easy = EASY if problem.points is None else EASY_IN_CONTACT
    yield from paths.load_steps(partial(equilibrium, problem), start or problem.at_rest(), marks, first, shortest, easy)


def dof_row(problem: FiniteProblem, quantity: DisplacementQuantity) -> Array:
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
    """Yield the states at increasing values of the displacement row . q; see `stepping.paths.displacement_steps`."""
    path, rest = DisplacementControl(problem, row), problem.at_rest()
    first = path.first_rate(problem.path_rate(rest))
    yield from paths.displacement_steps(path, rest, first, marks, end, share)


def arc_length_steps(
    problem: FiniteProblem,
    row: Array,
    marks: Sequence[float],
    end: float,
    share: float = STEP_SHARE,
    stations: Iterable[Station] = (),
) -> Iterator[FiniteState]:
    """Yield the states along the path by arc length, until the displacement row . q first reaches `end`.

    The first step moves the displacement by this share of the path, and none is much longer. The path lands on marks at
    the displacement's first passage. If another mesh has followed the path, its states guide the steps.

    Raises
    ------
    PathEndsError
        If the loads do not move the displacement, a step can't be cut further, or the path has passed a branch or does
        not get there.
    """
    # Arc length after Riks, each step in five:
    # 1. Predict by an arc along the tangent of the path, in the direction of travel. With stations, predict the next
    #    station, shifted by the difference of this mesh's state from the station before.
    # 2. Correct in the plane normal to the tangent: row_of_arc . q = its value at the state + arc.
    # 3. Refuse a step that turns away from the tangent, and check for branches.
    # 4. If load or displacement turns, refuse the step too, since it locates the turning point. Go there and beyond in
    #    short steps that crowd at the turning point, because a curve is drawn through the states. Stations already
    #    crowd there.
    # 5. Land on the marks that were passed, by displacement control, and go on from the state of the step.
    # Riks includes t in the arc, with an arbitrary weight. Here only displacements count, as Crisfield proposed.
    # Crisfield's cylinder has two roots to choose from, a plane has one.
    weights = np.zeros(row.shape)
    weights[:, :: len(KINDS)] = 1.0 / len(row)  # the mean square of the nodes' displacements

    def size(change: Array) -> float:
        return float(np.sqrt(np.sum(weights * change**2)))

    def ways(start: FiniteState, found: FiniteState) -> tuple[Array, float, Array]:
        """Return dq/dt at a state, the sign of dt along the path, and the rates of load and displacement in the arc."""
        # The last step determines the direction of travel. The textbook takes the sign of det K, which changes at a
        # branch too, where the path continues straight.
        drift = problem.path_rate(found)
        sign = float(np.sign(np.sum(weights * (found.q - start.q) * drift)))
        return drift, sign, sign / size(drift) * np.array([1.0, np.sum(row * drift)])

    state, value, path = problem.at_rest(), 0.0, DisplacementControl(problem, row)
    landings = Marks(path, marks, end)
    drift = problem.path_rate(state)
    first = path.first_rate(drift)
    sign = float(np.sign(first))
    rates = sign / size(drift) * np.array([1.0, first])
    arc = end * share / abs(first) * size(drift)
    longest = LONGEST_ARC * arc
    short = CLOSE * longest
    planned: list[float] = []  # arcs to a turning point and beyond; stations are not used meanwhile
    landing = False  # True if they end exactly there
    leading, astray, behind = deque(stations), np.zeros_like(row), 0.0
    for _ in range(MOST_ARCS):
        row_of_arc = weights * drift * sign / size(drift)
        along = float(np.sum(row_of_arc * state.q))
        while leading and not planned and np.sum(row_of_arc * (leading[0].q + astray)) <= along:
            leading.popleft()
        station = leading[0] if leading and not planned else None
        on_mark = station is not None and equal_marks(station.value, landings.waiting[0])
        if station is None:
            arc = planned[0] if planned else arc
            change = sign * arc / size(drift)
            start, guess = state, (change * drift, change)
        else:
            start = problem.state_at(station.t + behind, station.q + astray, state)
            arc = float(np.sum(row_of_arc * start.q)) - along
            guess = np.zeros_like(row), 0.0
        constraint = Constraint(row, 0.0, landings.waiting[0]) if on_mark else Constraint(row_of_arc, 0.0, along + arc)
        try:
            found = state_on_path(problem, start, constraint, guess, state.factor if station and arc <= short else None)
            arc = float(np.sum(row_of_arc * found.q)) - along
            # The arc is the step's component along the tangent, so that this ratio is a cosine.
            if arc < STRAIGHT * size(found.q - state.q):
                raise NotConvergedError
            drift_found, sign_found, rates_found = ways(state, found)
            # An old tangent does not show where the path turns.
            if station is None and np.any(rates * (2 * rates_found - rates) <= 0):
                found = problem.with_own_tangent(found)
                drift_found, sign_found, rates_found = ways(state, found)
        except NotConvergedError:
            arc = CUT * min(arc, longest)
            planned, landing = [arc] if leading else [], False
            if arc < SMALLEST_STEP * longest:
                raise PathEndsError(f"no equilibrium was found beyond load factor {state.t:.6g}") from None
            continue
        turns = rates * rates_found < 0
        if np.any(turns) and not landing and (station is None or arc > NEAR * short):
            there = arc * float(np.min((rates / (rates - rates_found))[turns]))  # rates are nearly linear in the arc
            landing = arc <= short * (1 + SAME)
            planned = (
                _arcs_around(there, short * CROWDED) if landing else [min(max(there - short, short), CUT * arc), short]
            )
            continue
        path.check_branch(found, sign_found * first > 0)
        reached = landings.waiting[0] if on_mark else float(np.sum(row * found.q))
        yield from landings.states_passed(state, value, found, reached)
        if not landings.waiting:
            return
        if station is not None:
            astray, behind = found.q - station.q, found.t - station.t
            leading.popleft()
        planned = planned[1:]
        landing = landing and bool(planned)
        state, value = found, reached
        drift, sign, rates = drift_found, sign_found, rates_found
        # Unlike a load step, an arc is also cut after a slow step that converged. The cut is milder than after a
        # failure.
        growth = ARC_GROWTH if found.iterations <= EASY else ARC_CUT
        growth = SPEEDING if found.iterations <= VERY_EASY else growth
        arc = min(longest, arc * growth)
    raise PathEndsError(f"the path did not reach a displacement of {end:.6g} in {MOST_ARCS} steps")


def _arcs_around(there: float, close: float) -> list[float]:
    """Return arcs to a turning point and beyond, shorter the closer they are to it."""
    places = [place for place in (there - 3 * close, there - close) if place > close / 2]
    return [float(arc) for arc in np.diff([0.0, *places, there, there + close])]
