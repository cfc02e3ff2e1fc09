"""A case of the non-linear theory on one mesh: its path from rest, and the states that are kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problem import Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS, Value
from shellbench.problems.shell.variants.edit import between
from shellbench.solvers.fem.linear.equilibrium import Equilibrium, check_balance
from shellbench.solvers.fem.mechanics.loads import Loading
from shellbench.solvers.fem.mechanics.solution import FemSolution, mean_rigid_motion
from shellbench.solvers.fem.mesh.basis import COMPONENTS, CUBIC, KINDS, Derivative
from shellbench.solvers.fem.mesh.bubbles import interpolation_coefficients
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from shellbench.solvers.fem.path.buckling import following_steps
from shellbench.solvers.fem.path.contact_at_finite_strain import nearest_pressure
from shellbench.solvers.fem.path.continuation import (
    STEP_SHARE,
    Station,
    arc_length_steps,
    displacement_steps,
    dof_row,
    load_steps,
)
from shellbench.solvers.fem.path.finite_state import FiniteState
from shellbench.solvers.fem.path.newton import equilibrium
from shellbench.solvers.fem.path.problem import FiniteProblem
from shellbench.solvers.stepping.control import NotConvergedError, PathEndsError, equal_marks, number_of_state
from shellbench.solvers.stepping.paths import follow_edit

Array = NDArray[np.float64]

# Of the distance from one state of a trail to the next: the shortest step in between.
SHORTEST = 1e-2
# Component of a rotation among the loose rigid motions that is rounding: others are of order one.
RIGID = 1e-6


class PathEndedError(SolveFailure):
    """A path that ended early; `equilibrium` is its partial solution."""

    def __init__(self, reason: str, equilibrium: Equilibrium) -> None:
        last = equilibrium.solution.history[-1].at
        super().__init__(f"{reason}; the last converged load factor is {last:.6g}", equilibrium.solution)
        self.equilibrium = equilibrium


def why_declined(case: Case) -> str | None:
    """Return the property of a case of the non-linear theory that fem can't take, as a clause, or None."""
    for support in case.supports:
        if support.clamped and isinstance(support.motion, Value):
            return f"it can't move the clamped support '{support.name}' by a formula at finite strain"
    moved = next((support for support in case.supports if support.motion is not None), None)
    if case.path.quantity is not None and moved is not None:
        return f"it can't move support '{moved.name}' on a path with control = '{case.path.control}'"
    if case.obstacles and (case.path.quantity is not None or case.path.after_buckling == "follow"):
        return "it touches obstacles at finite strain by load steps before buckling only"
    loose = free_motions(case)
    if case.following and (case.path.quantity is not None or case.path.after_buckling == "follow"):
        return "it follows a pressure along the deformed normal by load steps before buckling only"
    if case.following and loose.size:
        return "it needs supports against all rigid motions where a pressure follows the shell"
    if case.path.quantity is not None and loose.size:
        return f"it needs supports against all rigid motions on a path with control = '{case.path.control}'"
    if loose.size and np.abs(loose[3:]).max() > RIGID:
        name = RIGID_MOTIONS[3 + int(np.argmax(np.abs(loose[3:]).max(axis=1)))]
        return f"it needs supports against {name} at finite strain"
    return None


def solve(
    case: Case,
    mesh: TensorMesh,
    quadrature_order: int,
    steps: tuple[float, float],
    trail: FemSolution | None = None,
    tell: Callable[[float], None] | None = None,
    share: float = STEP_SHARE,
) -> tuple[Equilibrium, FemSolution]:
    """Follow the path of a case on a mesh.

    Parameters
    ----------
    case, mesh, quadrature_order
        The case, its mesh, and the degree to which a cell's Gauss rule is exact.
    steps
        The load step to begin with, and the shortest one, as parts of the path.
    trail
        All states of the path on another mesh. Under load control they are corrected one by one; under arc length they
        guide the steps. Or the states of an earlier shell, of which the case is an edit: the asked states then start
        from these.
    tell
        Called with the load factor of each new state.
    share
        Part of the path by which a step of displacement control or of arc length moves the displacement.

    Returns
    -------
    tuple
        The answer at the case's marks, and all states of the path.

    Raises
    ------
    InputError
        If supports contradict each other.
    PathEndedError
        If the path ends early.
    SolveFailure
        If no state beyond rest converged.
    """
    # 1. Check that loads do no work on free rigid motions.
    # 2. Follow the path; keep the data of each state that are needed later, and drop its factorisation.
    # 3. Record displacements in the history without free rigid motions.
    # 4. Keep the states at the marks and the critical ones, and the converged ones if the path ends early.
    began = time.perf_counter()
    problem = FiniteProblem.on_mesh(case, mesh, Quadrature.of_order(mesh, quadrature_order))
    loose = free_motions(case)
    for t in () if not loose.size else case.states if case.path.quantity is None else (1.0,):
        check_balance(Loading.on_mesh(case, mesh, problem.quadrature, (t,)), loose)
    quantities = {q.name: dof_row(problem, q) for q in case.quantities if isinstance(q, DisplacementQuantity)}
    controlled = quantities.get(case.path.quantity or "")
    states: list[FiniteState] = []
    seconds: list[float] = []
    reason: str | None = None
    try:
        for state in _path(problem, controlled, steps, share, trail):
            # Without its factorisation and deformations a state is small: whole paths stay in memory.
            states.append(state.without_step_data)
            seconds.append(time.perf_counter() - began)
            if tell:
                tell(state.t)
    except PathEndsError as error:
        reason = str(error)
    except NotConvergedError:
        reason = "the tangent stiffness is singular"
    if not states:
        raise SolveFailure(f"{reason}: no state beyond rest converged")
    # A mark is a value of the controlled quantity: the load factor or a displacement.
    marks = [state.t if controlled is None else float(np.sum(controlled * state.q)) for state in states]
    history = tuple(
        Step(
            iteration=number,
            seconds=after,
            energy=problem.potential(state),
            unknowns=_unknown_count(problem),
            at=state.t,
            quantities={name: float(np.sum(row * q)) for name, row in quantities.items()},
            phase="critical" if state.critical else "path",
            iterations=state.iterations,
        )
        for number, (state, after, q) in enumerate(zip(states, seconds, _without_motions(problem, states), strict=True))
    )
    kept = _states_to_keep(case, marks, complete=reason is None)
    kept = sorted({*kept, *(k for k, state in enumerate(states) if state.critical)})
    solution = _solution(problem, quadrature_order, [states[k] for k in kept], [marks[k] for k in kept], history)
    if reason is not None:
        raise PathEndedError(reason, Equilibrium(solution, problem.potential(states[-1]), states[-1].residuals[-1]))
    last = states[-1]
    if problem.points is not None:
        states, marks = [states[k] for k in kept], [marks[k] for k in kept]
    equilibrium = Equilibrium(solution, problem.potential(last), last.residuals[-1])
    return equilibrium, _solution(problem, quadrature_order, states, marks, history)


def interpolate_prescribed(case: Case, mesh: TensorMesh, quadrature_order: int) -> Equilibrium:
    """Return the interpolant of a displacement that the case prescribes everywhere, at its marks.

    The support carries the loads; its further forces, which keep the shell in shape, have no resultant.
    """
    # Nothing is solved for: coefficients are derivatives of the motion at the nodes, and bubbles fit the remainder.
    support, place = next(case.supported_places())

    def moved(points: Array, t: float) -> Mapping[Derivative, Array]:
        return case.motion(support, place, mesh.domain.wrap(points), t, order=2)

    coefficients = np.stack([interpolation_coefficients(mesh, partial(moved, t=t)) for t in case.states], axis=-1)
    quadrature = Quadrature.of_order(mesh, quadrature_order)
    if case.linear or mesh.degree > CUBIC:
        carried = Loading.on_mesh(case, mesh, quadrature, case.states).nodal.reshape(coefficients.shape)
    else:
        problem = FiniteProblem.on_mesh(case, mesh, quadrature)
        nodal = (coefficients * mesh.node_scales[:, None, :, None]).reshape(mesh.node_count, -1, len(case.states))
        loads = [problem.forces(nodal[..., k], t) for k, t in enumerate(case.states)]
        carried = np.stack(loads, axis=-1).reshape(coefficients.shape)
    solution = FemSolution(
        case=case,
        mesh=mesh,
        coefficients=coefficients,
        states=case.states,
        support_nodes=np.arange(mesh.node_count),
        support_forces=-(carried * mesh.node_scales[:, None, :, None])[None],
        quadrature_order=quadrature_order,
        parameters=0,
    )
    return Equilibrium(solution, sum(solution.energies()), 0.0)


def _path(
    problem: FiniteProblem,
    controlled: Array | None,
    steps: tuple[float, float],
    share: float,
    trail: FemSolution | None,
) -> Iterator[FiniteState]:
    case = problem.case
    lengths = steps[0] * case.path.until, steps[1] * case.path.until
    match case.path.control:
        # Each control has its own parameter: t itself, a displacement, or the arc. Only under load control is t given,
        # so that states of a coarser mesh can be corrected one by one.
        case "load":
            if case.buckles:
                yield from following_steps(problem, case.path_marks, *lengths)
            elif trail is None:
                yield from load_steps(problem, case.states, *lengths)
            elif trail.case != case:
                yield from _over_edit(problem, trail, lengths)
            else:
                yield from _correct_trail(problem, trail)
        case "displacement":
            assert controlled is not None
            yield from displacement_steps(problem, controlled, case.states, case.path.until, share)
        case "arc_length":
            assert controlled is not None
            stations = _stations_on_mesh(problem.mesh, trail) if trail else ()
            yield from arc_length_steps(problem, controlled, case.states, case.path.until, share, stations)


def _correct_trail(problem: FiniteProblem, trail: FemSolution) -> Iterator[FiniteState]:
    """Yield the states at the load factors of a trail, each from its own displacement there."""
    # Nested iteration: the coarser mesh's state at the same t is the initial guess of Newton's method. It may lie on a
    # branch that this mesh does not have. Then load steps reach t from the state before.
    before: FiniteState | None = None
    for t in trail.states:
        near = before or problem.undeformed_state()
        guess = problem.state_at(t, _interpolated(problem.mesh, trail, t), near)
        if problem.points is not None:
            guess = replace(guess, pressure=nearest_pressure(problem.points, trail.touch(t)))
        try:
            state = equilibrium(problem, guess, t, frugal=True)
        except NotConvergedError:
            state = guess
        if state is guess or not state.stable:
            for state in load_steps(problem, (t,), t - near.t, SHORTEST * (t - near.t), before):  # noqa: B007
                pass
        before = state
        yield state


def _over_edit(problem: FiniteProblem, earlier: FemSolution, lengths: tuple[float, float]) -> Iterator[FiniteState]:
    """Yield the asked states, starting from those of an earlier shell, or from rest if that fails."""
    case, mesh, rest = problem.case, problem.mesh, problem.undeformed_state()

    def found_at(t: float, q: Array, share: float) -> tuple[FiniteState, Array]:
        part = problem
        if share < 1.0:
            part = FiniteProblem.on_mesh(between(earlier.case, case, share), mesh, problem.quadrature)
        found = equilibrium(part, part.state_at(t, q, rest), t)
        return found, found.q

    states: list[FiniteState] = []
    try:
        for t in case.states:
            q = _interpolated(mesh, earlier, earlier.states[number_of_state(earlier.states, t)])
            found, iterations = follow_edit(partial(found_at, t), q)
            states.append(replace(found, iterations=iterations))
    except PathEndsError:
        yield from load_steps(problem, case.states, *lengths)
        return
    yield from states


def _stations_on_mesh(mesh: TensorMesh, trail: FemSolution) -> Iterator[Station]:
    """Yield all states of a path on another mesh, interpolated on this one."""
    for number, (value, step) in enumerate(zip(trail.states, trail.history, strict=True)):
        # by number: on a path that turns, several states have the same displacement
        alone = replace(trail, coefficients=trail.coefficients[..., number : number + 1], states=(1.0,))
        yield Station(_interpolated(mesh, alone, 1.0), step.at, value)


def _interpolated(mesh: TensorMesh, solution: FemSolution, at: float) -> Array:
    points = mesh.domain.wrap(mesh.node_points)
    nodal = np.stack([solution.partial(points, kind, at) for kind in KINDS], axis=-1)
    return np.asarray((nodal * mesh.node_scales[:, None, :]).reshape(mesh.node_count, -1))


def _states_to_keep(case: Case, marks: Sequence[float], complete: bool) -> list[int]:
    """Return the numbers of the states at the case's marks that the path reached, and of its last one."""
    kept = []
    for mark in case.states:
        # The path lands on marks up to rounding. On a path that turns, the first passage counts.
        there = [k for k, value in enumerate(marks) if equal_marks(value, mark)]
        kept += there[:1]
    if not complete and len(marks) - 1 not in kept:
        kept.append(len(marks) - 1)
    return kept


def _unknown_count(problem: FiniteProblem) -> int:
    return int(np.count_nonzero(problem.ties(problem.case.path.until).free))


def _without_motions(problem: FiniteProblem, states: Sequence[FiniteState]) -> list[Array]:
    """Return the displacements (nodes, 12) of states without free rigid motions."""
    loose, scales = free_motions(problem.case), problem.mesh.node_scales[:, None, :, None]
    if not loose.size:
        return [state.q for state in states]
    # Pins hold single displacements at arbitrary places. An answer instead has no rigid motion in the mean over the
    # area.
    stacked = np.stack([state.q for state in states], axis=-1)
    fields = stacked.reshape(-1, COMPONENTS, len(KINDS), len(states)) / scales
    fields = fields - mean_rigid_motion(problem.case, problem.mesh, problem.quadrature, fields, loose)
    return list(np.moveaxis((fields * scales).reshape(stacked.shape), -1, 0))


def _solution(
    problem: FiniteProblem,
    quadrature_order: int,
    states: Sequence[FiniteState],
    marks: Sequence[float],
    history: tuple[Step, ...],
) -> FemSolution:
    case, mesh, points = problem.case, problem.mesh, problem.points
    shape = (COMPONENTS, len(KINDS), len(states))
    scales = mesh.node_scales[:, None, :, None]
    coefficients = np.stack([state.q for state in states], axis=-1).reshape(-1, *shape) / scales
    ties = [problem.ties(state.t) for state in states]
    nodes = ties[0].nodes
    shares = [
        tie.sharing.shares(problem.reactions(state)[nodes][..., None]) for tie, state in zip(ties, states, strict=True)
    ]
    forces = np.concatenate(shares, axis=-1).reshape(len(case.supports), len(nodes), *shape)
    loose = free_motions(case)
    if loose.size:
        coefficients = coefficients - mean_rigid_motion(case, mesh, problem.quadrature, coefficients, loose)
    return FemSolution(
        case=case,
        mesh=mesh,
        coefficients=coefficients,
        states=tuple(marks),
        support_nodes=nodes,
        support_forces=forces * scales[nodes],
        quadrature_order=quadrature_order,
        parameters=_unknown_count(problem),
        history=history,
        touching=tuple(points.touch(s.touch) for s in states if points is not None and s.touch is not None),
    )
