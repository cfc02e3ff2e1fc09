"""Solving a case on one NURBS patch of Kratos' shell: linear solves, or Newton's method by load steps from rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import SolveFailure
from shellbench.problem import ProgressCallback
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.question.places import Point
from shellbench.problems.shell.records.history import Log, displacements, with_answer_first
from shellbench.problems.shell.symmetry.symmetry import Part, part_of, whole_of
from shellbench_kratos.engine import failing_with_kratos
from shellbench_kratos.iga_conditions import conditions_of, control_forces, end_of
from shellbench_kratos.iga_model import IgaModel
from shellbench_kratos.iga_solution import IgaSolution, Lines, integrals
from shellbench_kratos.iga_solver import KratosIgaSettings, controlled
from shellbench_kratos.nurbs import Midsurface, midsurface_of

Array = NDArray[np.float64]

SHORTEST_STEP = 1.0 / 4096  # of the first one: Newton's method has failed for good then
GROWTH = 2.0  # of the next step after one that converged
BALANCED = 1e-6  # of the largest force on a control point: what may be left of it in equilibrium
SINGULAR = 1e-3  # of the loads' work: no answer is given where rounding still changes more
MOST_SOLVES = 4  # corrections gain many digits each, or the matrix is singular to rounding


@dataclass(frozen=True)
class IgaState:
    """A state of equilibrium.

    Attributes
    ----------
    mark, factor
        Mark of the path (see `shellbench.problems.shell.question.path.Path`), and load factor.
    displacements
        (n1, n2, 3) of the control points, m.
    energy
        Strain energy of the whole shell less the loads' work, J; the loads as if they had always been this large.
    residual
        Largest force that is out of balance, relative to the largest force on a control point.
    iterations
        Newton's; of a linear case, solves.
    kept
        True if the case asks for it.
    rounding
        Relative error of the loads' work by rounding; None where it is not known.
    """

    mark: float
    factor: float
    displacements: Array
    energy: float
    residual: float
    iterations: int
    kept: bool
    rounding: float | None = None


def equilibrium(
    model: IgaModel, part: Part, mark: float, factor: float, displacements: Array, kept: bool, iterations: int
) -> IgaState:
    """Return a state with its energy, after a check of the balance of forces.

    Raises
    ------
    SolveFailure
        If forces are not in balance.
    """
    surface = model.midsurface
    inner = integrals(part.case, surface.patch, surface.control_points, displacements)
    outer = control_forces(part.case, surface.patch, factor)
    left = np.abs(model.conditions.balanced(inner.forces - outer)).max()
    largest = max(float(np.abs(inner.forces).max()), float(np.abs(outer).max()))
    residual = float(left / largest) if largest > 0 else 0.0
    if not residual <= BALANCED:
        raise SolveFailure(
            f"forces are out of balance by {residual:.1e} of the largest one at a load factor of {factor:.4g}"
        )
    work = _work(outer, displacements)
    energy = part.copies * (float(inner.energies.sum()) - work)
    return IgaState(mark, factor, displacements, energy, residual, iterations, kept)


def states(model: IgaModel, part: Part, load_steps: int, rounding: float) -> Iterator[IgaState]:
    """Yield the states of a case's path in order; for a linear case those that it asks for.

    `rounding` is the relative change of the loads' work by rounding above which a linear answer is corrected.

    Raises
    ------
    SolveFailure
        If Newton's method fails however short its steps, or forces are not in balance.
    """
    case = part.whole
    if case.linear:
        for mark in case.states:
            forces = control_forces(part.case, model.midsurface.patch, mark)
            displacements, solves, gap = _linear(model, part, forces, rounding)
            yield replace(equilibrium(model, part, mark, mark, displacements, True, solves), rounding=gap)
    elif case.path.control == "displacement":
        yield from _by_displacement(model, part, load_steps)
    else:
        patch = model.midsurface.patch
        step = case.path.until / load_steps
        for mark, kept, iterations in _marks(model, case.states, step, lambda t: control_forces(part.case, patch, t)):
            yield equilibrium(model, part, mark, mark, model.displacements(), kept, iterations)


def _linear(model: IgaModel, part: Part, forces: Array, rounding: float) -> tuple[Array, int, float]:
    """Solve a linear case, and solve again for the residual while rounding changes the answer by too much.

    The work of the residual forces is the error, by rounding, of the work of the loads: f . e = u . K e.

    Returns
    -------
    displacements, solves, gap
        (n1, n2, 3); how many solves it took; that error, relative to the work of the loads.
    """
    surface = model.midsurface
    total, left, gap, solves = np.zeros_like(surface.control_points), forces, np.inf, 0
    while solves < MOST_SOLVES and not gap <= rounding:
        model.start_from(np.zeros_like(total))
        if not model.solve(left):
            raise SolveFailure("the system of equations has no finite solution")
        solves += 1
        total = total + model.displacements()
        left = forces - integrals(part.case, surface.patch, surface.control_points, total).forces
        work = abs(_work(forces, total))
        gap = abs(_work(model.conditions.balanced(left), total)) / work if work > 0 else 0.0
    if not gap <= SINGULAR:
        raise SolveFailure(
            f"rounding changes the work of the loads by {gap:.1e}: the system of equations is singular to it"
        )
    return total, solves, gap


def _work(forces: Array, displacements: Array) -> float:
    return float(np.sum(np.moveaxis(forces, 0, -1) * displacements))


def _marks(
    model: IgaModel, wanted: tuple[float, ...], longest: float, forces: Callable[[float], Array]
) -> Iterator[tuple[float, bool, int]]:
    """Go from 0 through the wanted marks, by steps that are halved where Newton's method fails.

    Each step starts from the last two states, extrapolated.
    """
    reached, step = 0.0, longest
    last, before = model.displacements(), (0.0, model.displacements())
    for mark in wanted:
        while reached < mark:
            pieces = max(1, int(np.ceil((mark - reached) / step - SHORTEST_STEP)))
            target = mark if pieces == 1 else reached + (mark - reached) / pieces
            ahead = (target - reached) / (reached - before[0]) if reached > before[0] else 0.0
            model.start_from(last + ahead * (last - before[1]))
            if model.solve(forces(target)):
                before, last, reached = (reached, last), model.displacements(), target
                yield reached, target == mark, model.iterations
                step = min(longest, GROWTH * step)
                continue
            step /= 2
            if step < SHORTEST_STEP * longest:
                raise SolveFailure(f"Newton's method does not converge beyond {reached:.4g} of the path")


def _by_displacement(model: IgaModel, part: Part, load_steps: int) -> Iterator[IgaState]:
    """Displace the corner under the only load; the load follows from the balance of forces there."""
    found = controlled(part)
    assert found is not None  # else the case is declined
    component, point, sign = found
    patch, surface = model.midsurface.patch, model.midsurface
    unit = model.conditions.balanced(control_forces(part.case, patch, 1.0))[component][point]
    none = np.zeros((3, *patch.shape))

    def prescribe(mark: float) -> Array:
        model.prescribe(component, point, sign * mark)
        return none

    for mark, kept, iterations in _marks(model, part.whole.states, part.whole.path.until / load_steps, prescribe):
        u = model.displacements()
        inner = integrals(part.case, patch, surface.control_points, u)
        factor = float(model.conditions.balanced(inner.forces)[component][point] / unit)
        yield equilibrium(model, part, mark, factor, u, kept, iterations)


@dataclass
class _Course:
    """State of a running solve."""

    part: Part
    settings: KratosIgaSettings
    log: Log
    midsurface: Midsurface
    unknowns: int = 0
    kept: list[IgaState] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)

    def solution(self, states: list[IgaState]) -> IgaSolution:
        """Return a solution with some of the states."""
        return IgaSolution(
            self.part,
            self.midsurface,
            np.stack([state.displacements for state in states], axis=-1),
            tuple(state.mark for state in states),
            tuple(state.factor for state in states),
            self.unknowns,
            history=tuple(self.log.steps),
            diagnostics=dict(self.figures),
        )

    def add(self, state: IgaState) -> None:
        """Note a state, and keep it if the case asks for it."""
        if state.kept:
            self.kept.append(state)
        self.figures["residual"] = max(self.figures.get("residual", 0.0), state.residual)
        if state.rounding is not None:
            self.figures["rounding"] = max(self.figures.get("rounding", 0.0), state.rounding)
        numbers = state.factor, state.energy, self.unknowns, state.iterations
        self.log.add_state(*numbers, lambda: displacements(self.solution([state]), state.mark))

    def partial(self) -> IgaSolution | None:
        """Return the solution up to now, or None before the first kept state."""
        return self.solution(self.kept) if self.kept else None


def solve(case: Case, settings: KratosIgaSettings, progress: ProgressCallback) -> IgaSolution:
    """Solve a case; see `shellbench_kratos.iga_solver.KratosIgaSolver`."""
    log = Log(case, progress)
    part = part_of(case) if settings.symmetry else whole_of(case)
    lines, angles = knot_lines(part, settings), case.surface.domain.angle
    midsurface = midsurface_of(case.surface, lines, settings.degree, angles)
    course = _Course(part, settings, log, midsurface)
    # what overflows does not balance, and is refused for that
    with failing_with_kratos(course.partial, "the patch"), np.errstate(all="ignore"):
        return _solve(course)


def knot_lines(part: Part, settings: KratosIgaSettings) -> Lines:
    """Return the knot lines of the part, closer together toward the ends of a coordinate where point loads act."""
    names = [name for load in part.whole.loads if isinstance(load, PointLoad) for name in load.on]
    marked = [part.place_on_part(part.whole.places[name]) for name in (*names, *part.whole.focus)]
    lines = []
    for axis in (0, 1):
        unit = np.linspace(0.0, 1.0, settings.cells[axis] + 1)
        ends = {end_of(part.case, place.xi, axis) for place in marked if isinstance(place, Point)}
        if ends == {0}:
            unit = unit**settings.grading
        elif ends == {-1}:
            unit = 1 - (1 - unit) ** settings.grading
        elif ends >= {0, -1}:
            near = np.minimum(unit, 1 - unit)
            graded = (2 * near) ** settings.grading / 2
            unit = np.where(unit < 0.5, graded, 1 - graded)
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
    model = IgaModel.from_midsurface(surface, conditions, case.isotropic, case.linear)
    for state in states(model, part, course.settings.load_steps, course.settings.rounding):
        course.add(state)
    return with_answer_first(course.solution(course.kept), course.log.began)
