"""Solving a case on one NURBS patch of Kratos' shell: its states, one after the other."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import PointLoad
from shellbench.problems.shell.history import displacements, with_answer_first
from shellbench.problems.shell.places import Point
from shellbench.problems.shell.symmetry import Part, part_of, whole_of
from shellbench.solvers.kratos import iga_path
from shellbench.solvers.kratos.engine import failing_with_kratos
from shellbench.solvers.kratos.iga_model import IgaModel
from shellbench.solvers.kratos.iga_solution import IgaSolution, Lines
from shellbench.solvers.kratos.iga_solver import KratosIgaSettings
from shellbench.solvers.kratos.iga_supports import conditions_of, end_of
from shellbench.solvers.kratos.nurbs import Midsurface, midsurface_of


@dataclass
class _Course:
    """What is known of a solve so far."""

    part: Part
    settings: KratosIgaSettings
    progress: ProgressCallback
    midsurface: Midsurface
    began: float
    unknowns: int = 0
    kept: list[iga_path.State] = field(default_factory=list)
    history: list[Step] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)

    def solution(self, states: list[iga_path.State]) -> IgaSolution:
        """Return a solution with some of the states."""
        return IgaSolution(
            self.part,
            self.midsurface,
            np.stack([state.displacements for state in states], axis=-1),
            tuple(state.mark for state in states),
            tuple(state.factor for state in states),
            self.unknowns,
            history=tuple(self.history),
            diagnostics=dict(self.figures),
        )

    def add(self, state: iga_path.State) -> None:
        """Note a state, and keep it if the case asks for it."""
        case = self.part.whole
        if state.kept:
            self.kept.append(state)
        self.figures["residual"] = max(self.figures.get("residual", 0.0), state.residual)
        if state.rounding is not None:
            self.figures["rounding"] = max(self.figures.get("rounding", 0.0), state.rounding)
        seconds = time.perf_counter() - self.began
        step = Step(len(self.history), seconds, state.energy, self.unknowns, state.factor, iterations=state.iterations)
        if not case.linear:
            quantities = displacements(self.solution([state]), state.mark)
            step = replace(step, phase="path", quantities=quantities)
            self.progress(Progress(len(self.history), None, f"load factor {state.factor:.4g}"))
        self.history.append(step)

    def partial(self) -> IgaSolution | None:
        """Return what was reached, or None before the first state that is kept."""
        return self.solution(self.kept) if self.kept else None


def solve(case: Case, settings: KratosIgaSettings, progress: ProgressCallback) -> IgaSolution:
    """Solve a case; see `shellbench.solvers.kratos.iga_solver.KratosIgaSolver`."""
    began = time.perf_counter()
    part = part_of(case) if settings.symmetry else whole_of(case)
    lines, angles = knot_lines(part, settings), case.surface.domain.angle
    midsurface = midsurface_of(case.surface, lines, settings.degree, angles)
    course = _Course(part, settings, progress, midsurface, began=began)
    # what overflows does not balance, and is refused for that
    with failing_with_kratos(course.partial, "the patch"), np.errstate(all="ignore"):
        return _solve(course)


def knot_lines(part: Part, settings: KratosIgaSettings) -> Lines:
    """Return the knot lines of the part, closer together toward the end of a coordinate where a point load acts."""
    names = [name for load in part.whole.loads if isinstance(load, PointLoad) for name in load.on]
    marked = [part.seen(part.whole.places[name]) for name in (*names, *part.whole.focus)]
    lines = []
    for axis in (0, 1):
        unit = np.linspace(0.0, 1.0, settings.cells[axis] + 1)
        ends = {end_of(part.case, place.xi, axis) for place in marked if isinstance(place, Point)}
        if ends == {0}:
            unit = unit**settings.grading
        elif ends == {-1}:
            unit = 1 - (1 - unit) ** settings.grading
        low, high = part.lower[axis], part.upper[axis]
        inner = (low + (high - low) * unit[1:-1]).tolist()
        lines.append((float(low), *inner, float(high)))
    return lines[0], lines[1]


def _solve(course: _Course) -> IgaSolution:
    part, case = course.part, course.part.whole
    surface = course.midsurface
    conditions = conditions_of(part.case, surface.patch.shape)
    course.unknowns = conditions.free
    course.figures |= {
        "engine": course.settings.engine,
        "copies": part.copies,
        "geometry_error": surface.error,
        "spans": list(course.settings.cells),
    }
    if not case.linear:
        course.figures["stability_checked"] = False  # and a symmetric part hides what buckles out of symmetry
    model = IgaModel.of(surface, conditions, case.material, case.linear)
    for state in iga_path.states(model, part, course.settings.load_steps, course.settings.rounding):
        course.add(state)
    return with_answer_first(course.solution(course.kept), course.began)
