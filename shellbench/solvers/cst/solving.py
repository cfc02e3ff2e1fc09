"""Solving a case on one mesh of triangles: its states or frames, one after the other.

Static cases: one linear solve, or Newton's method along a path of load factors; or modes (`modes`).

Motion by backward Euler, as in cloth simulators (Baraff & Witkin 1998; ARCSim).

Each step minimises W(u) - f.u + m/(2 dt^2) |u - u_n - dt v_n|^2 with lumped masses; then v = (u - u_n)/dt. The method
is of first order, and damps oscillations with periods of a few steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import ProgressCallback
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.places import Point
from shellbench.problems.shell.records.history import Log, displacements, failing_with, with_answer_first
from shellbench.solvers.cst.mesh import FEWEST_PERIODIC, TriangleMesh
from shellbench.solvers.cst.modes import find_modes
from shellbench.solvers.cst.problem import TriangleProblem, factorise, minimise
from shellbench.solvers.cst.settings import CstSettings
from shellbench.solvers.cst.solution import CstSolution

LONGER_SIDE = 32  # cells, unless settings say otherwise
MOST_CELLS = 5000  # along a coordinate: 150 million unknowns, more than any direct solve takes
TIME_STEP = 1 / 240  # s: four steps a frame of 60 Hz


def usual_cells(case: Case) -> tuple[int, int]:
    """Return 32 cells on the longer side, and a number on the other that makes them square, or a few more.

    Named points lie on vertices, if a number of cells up to twice as large allows it.
    """
    domain = case.surface.domain
    x = case.surface.position(domain.grid(LONGER_SIDE + 1, LONGER_SIDE + 1))
    lengths = [np.linalg.norm(np.diff(x, axis=a), axis=-1).sum(axis=a).max() for a in (0, 1)]
    named = np.array([p.xi for p in case.places.values() if isinstance(p, Point)]).reshape(-1, 2)
    cells = []
    for axis in (0, 1):
        places = (named[:, axis] - domain.lower[axis]) / domain.size[axis]
        fewest = max(FEWEST_PERIODIC, math.ceil(LONGER_SIDE * lengths[axis] / max(lengths) - 1e-6))
        tries = range(fewest, 2 * fewest + 1)
        fitting = (n for n in tries if np.all(np.abs(places * n - np.rint(places * n)) < 1e-9))
        cells.append(next(fitting, fewest))
    return cells[0], cells[1]


@dataclass
class _SolveState:
    """State of a solve so far: marks, frames, diagnostics and log."""

    problem: TriangleProblem
    settings: CstSettings
    log: Log
    marks: list[float] = field(default_factory=list)
    frames: list[Any] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def unknowns(self) -> int:
        """Number of degrees of freedom that are solved for."""
        return len(self.problem.pattern.free)

    def solution(self) -> CstSolution:
        """Return the solution up to the last state."""
        mesh = self.problem.mesh
        figures = {"cells": list(mesh.cells), "diagonal": mesh.diagonal, **self.figures}
        frames = np.stack(self.frames, axis=-1)
        return CstSolution(
            self.problem.case,
            mesh,
            np.array(self.marks),
            frames,
            self.unknowns,
            history=tuple(self.log.steps),
            diagnostics=figures,
        )

    def partial(self) -> CstSolution | None:
        """Return the solution up to the last state, or None before the first one."""
        return self.solution() if self.log.steps else None

    def add_state(self, state: TriangleState) -> None:
        """Keep a state of a static case, with the displacements that are asked for."""
        self.marks.append(state.at)
        self.frames.append(state.displacement)
        self.figures["residual"] = max(self.figures.get("residual", 0.0), state.residual)
        numbers = state.at, state.energy, self.unknowns, state.iterations
        self.log.add_state(*numbers, lambda: displacements(self.solution(), state.at))

    def add_frame(self, frame: Frame, steps: int) -> None:
        """Keep a frame of a motion."""
        self.marks.append(frame.at)
        self.frames.append(frame.displacement)
        self.log.add_frame(frame.at, frame.energy, self.unknowns, frame.iterations, steps)


def solve(case: Case, chosen: CstSettings, progress: ProgressCallback) -> CstSolution:
    """Solve a case; see `shellbench.solvers.cst.solver.CstSolver`."""
    with ThreadpoolController().select(internal_api="openblas").limit(limits=1):  # the matrices are small
        course: _SolveState | None = None
        log = Log(case, progress)
        with failing_with(lambda: course.partial() if course else None, "the mesh"):
            course = _SolveState(TriangleProblem.from_case(case, mesh_of_settings(case, chosen)), chosen, log)
            return _solve(course)


def mesh_of_settings(case: Case, settings: CstSettings) -> TriangleMesh:
    """Return the mesh of the settings; InputError if it is impossible."""
    cells = settings.cells or usual_cells(case)
    if min(cells) < 1 or max(cells) > MOST_CELLS:
        raise InputError(f"field 'cells': found {list(cells)}, both must be from 1 to {MOST_CELLS}")
    closed = [n for n, turns in zip(cells, case.surface.domain.periodic, strict=True) if turns]
    if settings.diagonal == "alternating" and any(n % 2 for n in closed):
        raise InputError(f"field 'cells': found {list(cells)}, but around a closed shell an even number alternates")
    try:
        return TriangleMesh(case.surface.domain, cells, settings.diagonal)
    except ValueError as error:
        raise InputError(f"field 'cells': {error}") from None


def _solve(course: _SolveState) -> CstSolution:
    case, problem, settings = course.problem.case, course.problem, course.settings
    if case.dynamics is not None:
        steps = step_count(case.dynamics.until, settings.time_step or TIME_STEP)
        course.figures["time_step"] = case.dynamics.until / steps
        course.marks.append(0.0)
        course.frames.append(np.zeros_like(problem.elastic.rest))
        march(problem, case.dynamics.until, steps, settings.tolerance, lambda frame: course.add_frame(frame, steps))
        return course.solution()
    if case.modal:
        return _solve_modes(course)
    if case.linear:
        for state in solve_linear(problem, case.states):
            course.add_state(state)
    else:
        follow_path(problem, case.states, settings.tolerance, course.add_state)
    return with_answer_first(course.solution(), course.log.began)


def _solve_modes(course: _SolveState) -> CstSolution:
    case, problem = course.problem.case, course.problem
    vibrates = case.quantities[0].kind == "frequency"
    loaded = None if vibrates else solve_linear(problem, (1.0,))[0].displacement
    values, shapes = find_modes(problem, loaded, int(max(case.states)))
    for mark in case.states:
        number = int(mark) - 1
        course.add_state(TriangleState(mark, shapes[number], float(values[number]), 1, 0.0))
    known = {int(mark): float(values[int(mark) - 1]) for mark in case.states}
    return with_answer_first(replace(course.solution(), mode_values=known), course.log.began)


Array = NDArray[np.float64]

BALANCE = 1e-6  # of all loads: a larger force of a pin means that loads are not in balance
REFINEMENTS = 2  # of a linear solve, by its residual
MOST_STEPS = 60  # Newton steps to one state
SHORTEST = 2.0**-8  # of the way to the next state: the smallest increment of the load factor


@dataclass(frozen=True)
class TriangleState:
    """One state of equilibrium.

    Attributes
    ----------
    at
        Load factor.
    displacement
        (v, 3).
    energy
        Potential energy, J.
    iterations
        Newton steps since the state before.
    residual
        Largest force that is not in balance, relative to the largest force of all.
    """

    at: float
    displacement: Array
    energy: float
    iterations: int
    residual: float


def solve_linear(problem: TriangleProblem, states: tuple[float, ...]) -> list[TriangleState]:
    """Solve a linear case at each load factor.

    Raises
    ------
    SolveFailure
        If the stiffness matrix is singular, or loads on a shell without supports are not in balance.
    """
    free = problem.pattern.free
    rest = np.zeros_like(problem.elastic.rest)
    solve = factorise(
        problem.pattern.matrix(problem.elastic.tangent_values(rest), problem.loading.springs.ravel()[free])
    )
    found = []
    for t in states:
        force, u = problem.loading.forces(t), problem.supports.prescribe(rest, t)
        for _ in range(1 + REFINEMENTS):
            u.ravel()[free] += solve((force - problem.internal_forces(u)).ravel()[free])
        found.append(_state(problem, t, u, force, 1))
    return found


def follow_path(
    problem: TriangleProblem, states: tuple[float, ...], tolerance: float, tell: Callable[[TriangleState], None]
) -> None:
    """Find the equilibrium at each load factor, from the one before it.

    Parameters
    ----------
    problem
        Case and mesh.
    states
        Load factors, increasing.
    tolerance
        Newton's last step, relative to the shell's size.
    tell
        Called with each state as it is found.

    Raises
    ------
    SolveFailure
        If Newton's method does not converge even for small increments of the load factor.
    """
    still = np.zeros(problem.mesh.vertex_count)
    u, t = np.zeros_like(problem.elastic.rest), 0.0
    size = float(np.ptp(problem.elastic.rest, axis=0).max())
    for mark in states:
        increment, iterations = mark - t, 0
        while t < mark:
            goal = mark if t + 1.001 * increment >= mark else t + increment
            force = problem.loading.forces(goal)
            try:
                start = problem.supports.prescribe(u, goal)
                found = minimise(problem, start, force, still, start, tolerance * size, MOST_STEPS)
            except SolveFailure as failure:
                increment /= 2
                if increment < SHORTEST * mark:
                    raise SolveFailure(f"{failure} beyond load factor {t:.4g}") from None
                continue
            u, t, iterations = found.displacement, goal, iterations + found.iterations
        tell(_state(problem, t, u, force, iterations))


def _state(problem: TriangleProblem, t: float, u: Array, force: Array, iterations: int) -> TriangleState:
    internal = problem.internal_forces(u)
    gap = (internal - force).ravel()
    acting = float(np.abs(force).sum())
    moved = problem.loading.case.material.membrane_stiffness * float(np.abs(u).max(initial=0.0))
    scale = max(acting if acting else moved, np.finfo(float).tiny)
    if np.abs(gap[problem.loose.pins]).max(initial=0.0) > BALANCE * scale:
        raise SolveFailure("the loads are not in balance, and nothing holds the shell")
    if len(problem.loose.pins):
        u = problem.loose.without_motions(u, problem.loading.areas)
    energy = problem.strain_energy(u) - float(np.sum(force * u))
    return TriangleState(t, u, energy, iterations, float(np.abs(gap[problem.pattern.free]).max(initial=0.0)) / scale)


MOST_INSTANTS = 100_000  # steps in time: their frames are kept
MOST_TIME_STEPS = 60  # Newton steps in one step in time


@dataclass(frozen=True)
class Frame:
    """The state at one time.

    Attributes
    ----------
    at
        s.
    displacement
        (v, 3).
    energy
        Kinetic and strain energy less the work done by loads and supports, J.
    iterations
        Newton steps.
    """

    at: float
    displacement: Array
    energy: float
    iterations: int


def step_count(until: float, time_step: float) -> int:
    """Return the number of equal steps of at most `time_step`; InputError if they are too many."""
    steps = until / time_step * (1 - 1e-12)
    if not steps <= MOST_INSTANTS:
        raise InputError(f"field 'time_step': {time_step:g} s makes more than {MOST_INSTANTS} steps in {until:g} s")
    return max(1, math.ceil(steps))


def march(problem: TriangleProblem, until: float, steps: int, tolerance: float, tell: Callable[[Frame], None]) -> None:
    """Follow the motion from rest by equal steps in time.

    Parameters
    ----------
    problem
        Case and mesh.
    until
        Final time, s.
    steps
        Number of steps.
    tolerance
        Newton's last correction, relative to the shell's size.
    tell
        Called with each frame as it is found.

    Raises
    ------
    SolveFailure
        If Newton's method finds no minimum.
    """
    # 1. Predict by the velocity, and move the held vertices.
    # 2. Minimise the incremental potential of backward Euler.
    # 3. Add the work of loads and of supports; update the velocity.
    dt, mass = until / steps, problem.loading.mass
    size = float(np.ptp(problem.elastic.rest, axis=0).max())
    u = np.zeros_like(problem.elastic.rest)
    v, held = np.zeros_like(u), problem.supports.held
    work, inertia = 0.0, mass / dt**2
    steady = problem.loading.forces(0.0) if problem.case.steady else None
    for number in range(1, steps + 1):
        t = until * number / steps
        force = problem.loading.forces(t) if steady is None else steady
        target = u + dt * v
        start, pressing = problem.supports.prescribe(target, t), problem.obstacles_at(t, dt)
        try:
            found = minimise(problem, start, force, inertia, target, tolerance * size, MOST_TIME_STEPS, pressing)
        except SolveFailure as failure:
            raise SolveFailure(f"{failure} at {t:.4g} s") from None
        moved = found.displacement - u
        if pressing:
            force = force + pressing.forces(found.displacement)
        reaction = (
            problem.internal_forces(found.displacement) - force + inertia[:, None] * (found.displacement - target)
        )
        work += float(np.sum(force * moved) + np.sum((reaction * moved)[held]))
        u, v = found.displacement, moved / dt
        energy = problem.strain_energy(u) + float(np.sum(mass[:, None] * v**2)) / 2 - work
        tell(Frame(t, u, energy, found.iterations))
