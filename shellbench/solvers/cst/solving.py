"""Solving a case on one mesh of triangles: its states or frames, one after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from shellbench.errors import InputError
from shellbench.problem import ProgressCallback
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.history import Log, displacements, failing_with, with_answer_first
from shellbench.problems.shell.places import Point
from shellbench.solvers.cst import motion, static
from shellbench.solvers.cst.mesh import FEWEST_PERIODIC, TriangleMesh
from shellbench.solvers.cst.problem import Problem
from shellbench.solvers.cst.solution import CstSolution
from shellbench.solvers.cst.solver import CstSettings

LONGER_SIDE = 32  # cells, unless settings say otherwise
MOST_CELLS = 5000  # along a coordinate: 150 million unknowns, more than any direct solve takes
TIME_STEP = 1 / 240  # s: four steps a frame of 60 Hz


def usual_cells(case: Case) -> tuple[int, int]:
    """Return 32 cells on the longer side and as many on the other as make them square, or a few more.

    Named points lie on vertices where some number up to twice as large allows it.
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
class _Course:
    """What is known of a solve so far."""

    problem: Problem
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
        """Return what was reached."""
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
        """Return what was reached, or None before the first state."""
        return self.solution() if self.log.steps else None

    def add_state(self, state: static.State) -> None:
        """Keep a state of a static case, with the displacements that are asked for."""
        self.marks.append(state.at)
        self.frames.append(state.displacement)
        self.figures["residual"] = max(self.figures.get("residual", 0.0), state.residual)
        numbers = state.at, state.energy, self.unknowns, state.iterations
        self.log.add_state(*numbers, lambda: displacements(self.solution(), state.at))

    def add_frame(self, frame: motion.Frame, steps: int) -> None:
        """Keep a frame of a motion."""
        self.marks.append(frame.at)
        self.frames.append(frame.displacement)
        self.log.add_frame(frame.at, frame.energy, self.unknowns, frame.iterations, steps)


def solve(case: Case, chosen: CstSettings, progress: ProgressCallback) -> CstSolution:
    """Solve a case; see `shellbench.solvers.cst.solver.CstSolver`."""
    with ThreadpoolController().select(internal_api="openblas").limit(limits=1):  # the matrices are small
        course: _Course | None = None
        log = Log(case, progress)
        with failing_with(lambda: course.partial() if course else None, "the mesh"):
            course = _Course(Problem.of(case, mesh_of(case, chosen)), chosen, log)
            return _solve(course)


def mesh_of(case: Case, settings: CstSettings) -> TriangleMesh:
    """Return the mesh that settings ask for; InputError if it can't be."""
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


def _solve(course: _Course) -> CstSolution:
    case, problem, settings = course.problem.case, course.problem, course.settings
    if case.dynamics is not None:
        steps = motion.step_count(case.dynamics.until, settings.time_step or TIME_STEP)
        course.figures["time_step"] = case.dynamics.until / steps
        course.marks.append(0.0)
        course.frames.append(np.zeros_like(problem.elastic.rest))
        motion.march(
            problem, case.dynamics.until, steps, settings.tolerance, lambda frame: course.add_frame(frame, steps)
        )
        return course.solution()
    if case.linear:
        for state in static.solve_linear(problem, case.states):
            course.add_state(state)
    else:
        static.follow_path(problem, case.states, settings.tolerance, course.add_state)
    return with_answer_first(course.solution(), course.log.began)
