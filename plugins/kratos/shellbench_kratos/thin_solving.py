"""Solving a case on one mesh of Kratos' thin quadrilaterals: its states, one after the other."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from threadpoolctl import ThreadpoolController

from shellbench.errors import InputError
from shellbench.problem import ProgressCallback
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.records.history import Log, displacements, with_answer_first
from shellbench.problems.shell.symmetry.symmetry import Part, part_of, whole_of
from shellbench_kratos.engine import failing_with_kratos
from shellbench_kratos.thin_elements import ELEMENT
from shellbench_kratos.thin_mesh import FEWEST_AROUND
from shellbench_kratos.thin_solution import Gauge, ThinSolution, mesh_on
from shellbench_kratos.thin_solver import KratosThinSettings
from shellbench_kratos.thin_static import ThinProblem, ThinState, follow_path, solve_linear

CELLS, CELLS_AROUND = 128, 256  # of the whole shell, unless settings say otherwise: 64 x 64 of an eighth of a cylinder
CELLS_ON_A_PATH = 32  # of the part: a path takes tens of solves
LONGEST_CELL, FEWEST_CELLS = 2.0, 4  # sides' ratio of usual cells, as far as so many stay across
SAMPLES = 33  # points a side at which the sides of a part are measured
MOST_CELLS = 512  # along a coordinate: 1.6 million unknowns, more than a direct solver takes


def usual_cells(part: Part) -> tuple[int, int]:
    """Return cells for a part if none are asked for, fewer across and more along where it is long and narrow.

    A linear case has as many on the whole shell whatever part of it is solved, so that the answer does not depend on
    where the shell is in space, and its planes of symmetry are seen or not. On a path the part has 32 x 32.
    """
    case, domain = part.whole, part.whole.surface.domain
    first, second = (np.linspace(low, high, SAMPLES) for low, high in zip(part.lower, part.upper, strict=True))
    x = case.surface.position(np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1))
    lengths = [np.linalg.norm(np.diff(x, axis=a), axis=-1).sum(axis=a).max() for a in (0, 1)]
    cells = [CELLS_ON_A_PATH] * 2
    if case.linear:
        shares = np.subtract(part.upper, part.lower) / domain.size
        cells = [
            round((CELLS_AROUND if turns else CELLS) * s) for turns, s in zip(domain.periodic, shares, strict=True)
        ]
    long, short = (0, 1) if lengths[0] / cells[0] >= lengths[1] / cells[1] else (1, 0)
    while lengths[long] / cells[long] > LONGEST_CELL * lengths[short] / cells[short] and cells[short] > FEWEST_CELLS:
        cells[long], cells[short] = 2 * cells[long], cells[short] // 2
    return cells[0], cells[1]


@dataclass
class _Course:
    """State of a running solve."""

    problem: ThinProblem
    log: Log
    states: list[ThinState] = field(default_factory=list)

    @cached_property
    def gauge(self) -> Gauge:
        """The gauge of the strain energy of a path's states."""
        return Gauge(self.problem)

    def solution(self) -> ThinSolution:
        """Return the solution up to the current state."""
        problem = self.problem
        figures = {
            "element": ELEMENT,
            "cells": list(problem.mesh.cells),
            "copies": problem.part.copies,
            "field": "bilinear between nodes",
            "residual": max(state.residual for state in self.states),
        }
        if not problem.part.whole.linear:
            figures["stability_checked"] = False  # Newton's method may jump over a limit point to another state
        marks = np.array([state.at for state in self.states])
        frames = np.stack([state.values for state in self.states], axis=-1)
        return ThinSolution(
            problem, marks, frames, len(problem.free), history=tuple(self.log.steps), diagnostics=figures
        )

    def partial(self) -> ThinSolution | None:
        """Return the solution up to now, or None before the first state."""
        return self.solution() if self.states else None

    def add(self, state: ThinState) -> None:
        """Keep a state, with the displacements that are asked for."""
        self.states.append(state)
        part = self.problem.part
        strain = state.inner_work / 2 if part.whole.linear else part.copies * sum(self.gauge.energies(state.values))
        numbers = state.at, strain - state.work, len(self.problem.free), state.iterations
        self.log.add_state(*numbers, lambda: displacements(self.solution(), state.at))


def solve(case: Case, settings: KratosThinSettings, progress: ProgressCallback) -> ThinSolution:
    """Solve a case; see `shellbench_kratos.thin_solver.KratosThinSolver`."""
    log = Log(case, progress)
    part = part_of(case) if settings.symmetry else whole_of(case)
    course = _Course(problem_of(part, settings), log)
    limited = ThreadpoolController().select(internal_api="openblas").limit(limits=1)  # the matrices are small
    with limited, failing_with_kratos(course.partial, "the mesh"):
        return _solve(course, settings)


def problem_of(part: Part, settings: KratosThinSettings) -> ThinProblem:
    """Return the mesh that settings ask for, with all that acts on it; InputError if it can't be."""
    cells = settings.cells or usual_cells(part)
    if min(cells) < 1 or max(cells) > MOST_CELLS:
        raise InputError(f"field 'cells': found {list(cells)}, both must be from 1 to {MOST_CELLS}")
    mesh = mesh_on(part, cells)
    if any(turns and n < FEWEST_AROUND for turns, n in zip(mesh.closed, cells, strict=True)):
        raise InputError(f"field 'cells': found {list(cells)}, but a closed shell needs {FEWEST_AROUND} around it")
    problem = ThinProblem(part, mesh)
    if not len(problem.free):
        raise InputError(f"field 'cells': found {list(cells)}, which leaves nothing free to move")
    return problem


def _solve(course: _Course, settings: KratosThinSettings) -> ThinSolution:
    case = course.problem.part.whole
    if case.linear:
        for state in solve_linear(course.problem, case.states):
            course.add(state)
    else:
        follow_path(course.problem, case.states, settings.steps, settings.tolerance, course.add)
    return with_answer_first(course.solution(), course.log.began)
