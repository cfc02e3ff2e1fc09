"""Uncertainty from the history of a solution, and the partial results of a solve that fails."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure, measure_all
from shellbench.problems.shell.quantities.quantities import (
    CentreOfMass,
    DisplacementQuantity,
    MotionEnergy,
    PositionQuantity,
    QuantityModel,
    ReactionQuantity,
)
from shellbench.problems.shell.solution import S, ShellSolution


@dataclass
class Log:
    """The history of a solve so far, and its progress reports.

    Attributes
    ----------
    case, progress
        The case, and the callback of progress.
    began
        Time of `time.perf_counter` when the solve began.
    steps
        One a state.
    """

    case: Case
    progress: ProgressCallback
    began: float = field(default_factory=time.perf_counter)
    steps: list[Step] = field(default_factory=list)

    def add_state(
        self, at: float, energy: float, unknowns: int, iterations: int, quantities: Callable[[], Mapping[str, float]]
    ) -> None:
        """Add a state of equilibrium at a load factor; a state of a path with the quantities asked there."""
        step = Step(len(self.steps), time.perf_counter() - self.began, energy, unknowns, at, iterations=iterations)
        if not self.case.linear:
            step = replace(step, phase="path", quantities=quantities())
        self.steps.append(step)
        self.progress(Progress(len(self.steps), None, f"load factor {at:.4g}"))

    def add_frame(self, at: float, energy: float, unknowns: int, iterations: int | None, count: int) -> None:
        """Add a frame of a motion at a time, one of so many."""
        seconds = time.perf_counter() - self.began
        self.steps.append(Step(len(self.steps), seconds, energy, unknowns, at, phase="time", iterations=iterations))
        self.progress(Progress(len(self.steps), count, f"{at:.4g} s"))


def displacements(solution: ShellSolution, at: float) -> Mapping[str, float]:
    """Return the displacement quantities of the case at a state of a path, whatever their own states."""
    asked = [q for q in solution.case.quantities if isinstance(q, DisplacementQuantity)]
    return {q.name: measure(solution, q.model_copy(update={"at": at})) for q in asked}


def with_answer_first(solution: S, began: float) -> S:
    """Return a solution whose history begins with the whole answer; states of a path follow, static ones are dropped.

    `began` is the time of `time.perf_counter` when the solve began.

    Raises
    ------
    SolveFailure
        If the path lacks the state of a quantity.
    """
    try:
        quantities = measure_all(solution)
    except ValueError as error:
        raise SolveFailure(str(error)) from None
    last, seconds = solution.history[-1], time.perf_counter() - began
    whole = replace(last, iteration=0, seconds=seconds, quantities=quantities, phase="solve", iterations=None)
    path = () if solution.case.linear else tuple(replace(s, iteration=s.iteration + 1) for s in solution.history)
    return replace(solution, history=(whole, *path))


@contextmanager
def failing_with(partial: Callable[[], Solution | None], too_large: str) -> Iterator[None]:
    """Attach the partial solution to a failure; `too_large` names the object that exceeds memory: "the mesh"."""
    try:
        yield
    except SolveFailure as failure:
        raise SolveFailure(str(failure), partial=partial()) from None
    except MemoryError:
        raise SolveFailure(f"{too_large} does not fit into memory", partial=partial()) from None


def settled(levels: Iterable[tuple[S, float]], count: int, progress: ProgressCallback) -> S:
    """Return the last of ever finer solutions with the history of all, and its last change as the uncertainty.

    Parameters
    ----------
    levels
        Solutions from coarse to fine, each with its potential energy, J.
    count
        How many there will be.

    Raises
    ------
    SolveFailure
        If an energy is not finite.
    """
    began = time.perf_counter()
    steps: list[Step] = []
    for solution, energy in levels:
        if not math.isfinite(energy):
            raise SolveFailure(f"the answer with {solution.parameters} unknowns is not finite")
        step = Step(len(steps), time.perf_counter() - began, energy, solution.parameters)
        steps.append(replace(step, quantities=measure_all(replace(solution, history=(step,)))))
        progress(Progress(len(steps), count, f"{solution.parameters} unknowns"))
    last = steps[-1].quantities
    changes = {name: abs(last[name] - steps[-2].quantities[name]) for name in last} if len(steps) > 1 else {}
    return replace(solution, history=tuple(steps), uncertainty=changes)


COMPONENT = 0.5  # of the largest component of a vector: in a plane, one direction in three sees less of it


def moving_uncertainty(case: Case, values: Mapping[str, float], apart: Mapping[str, float]) -> dict[str, float]:
    """Return the uncertainty of a motion's quantities, from that of each quantity by itself.

    Two facts enlarge it. The error of a place is a vector, which turns as the shell moves: one component may change
    little by chance. And a motion from rest keeps a total energy of zero, so that any other value is an error.

    Parameters
    ----------
    values
        Values of the quantities.
    apart
        Uncertainty of each of them, from its own changes.
    """
    known = {q.name: q for q in case.quantities if q.name in apart}
    sure = dict(apart)
    for name, quantity in known.items():
        place = _place(quantity)
        if place is not None:
            beside = max(apart[other] for other, q in known.items() if _place(q) == place)
            sure[name] = max(apart[name], COMPONENT * beside)
        if isinstance(quantity, MotionEnergy) and quantity.kind == "total_energy":
            sure[name] = max(apart[name], abs(values[name]))
    return sure


def _place(quantity: QuantityModel) -> tuple[object, ...] | None:
    """Return the vector of which a quantity is a component: its kind, place and time; None if it is no component."""
    match quantity:
        case DisplacementQuantity() | PositionQuantity():
            return ("place", quantity.points, quantity.at)
        case CentreOfMass():
            return (quantity.kind, quantity.at)
        case ReactionQuantity():
            return (quantity.kind, quantity.support, quantity.at)
    return None
