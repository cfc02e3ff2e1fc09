"""Series: what a case's quantities were along the way, not only where they are asked for.

What belongs to one series `shellbench.problems.shell.asked` says.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping

import numpy as np

from shellbench.bench.record import Series, finite
from shellbench.bench.snapshot import snapshot_of
from shellbench.errors import InputError
from shellbench.problem import Solution
from shellbench.problems.shell.asked import asked_series
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.measure import measure

SAMPLES = 101  # times, rest among them: hundredths of the whole time, for curves of some ten swings
FRAMES = 21  # times at which the field is kept, rest among them: every twentieth of the whole time
REFUSED = (InputError, ValueError)  # how a solution and its measuring say that a time was not reached


def reached(solution: Solution, case: Case) -> float:
    """Return the time, s, or load factor up to which a solution goes."""
    until = case.path.until if case.dynamics is None else case.dynamics.until
    steps = [step.at for step in solution.history if step.phase in {"time", "path"} and math.isfinite(step.energy)]
    return min(until, steps[-1]) if steps else until


def frames(solution: Solution, case: Case) -> tuple[float, ...]:
    """Return the marks at which the field is kept: those asked for, and in motion times all along the way.

    A motion that ended early is kept at its last time too.
    """
    if case.dynamics is None:
        return case.states
    end = reached(solution, case)
    uniform = np.linspace(0.0, case.dynamics.until, FRAMES)[1:].tolist()
    return _distinct([mark for mark in (*uniform, *case.states) if mark < end] + [end])


def _distinct(marks: list[float]) -> tuple[float, ...]:
    """Return the marks in order, those but once that differ by rounding; of these the one named last."""
    kept: dict[str, float] = {f"{mark:.9g}": mark for mark in marks}
    return tuple(sorted(kept.values()))


def series_of(solution: Solution, case: Case) -> tuple[Series, ...]:
    """Measure a solution all along the way, as far as it goes; what it refuses or is not finite is left out."""
    asked = asked_series(case)
    points: dict[str, dict[float, float]] = {one.name: {} for one in asked}
    for mark in _marks(solution, case) if asked else ():
        snapshot = snapshot_of(solution, mark)
        known = _known(solution, mark)
        for one in asked:
            value = next((known[name] for name in one.quantities if name in known), None)
            if value is None:
                with contextlib.suppress(*REFUSED):
                    value = measure(snapshot, one.quantity.model_copy(update={"at": mark}))
            if (figure := finite(value)) is not None:
                points[one.name][mark] = figure
    return tuple(
        Series(
            name=one.name,
            quantities=one.quantities,
            unit=one.quantity.unit,
            description=one.quantity.description,
            marks=tuple(points[one.name]),
            values=tuple(points[one.name].values()),
        )
        for one in asked
        if points[one.name]
    )


def _marks(solution: Solution, case: Case) -> Iterator[float]:
    if case.dynamics is not None:
        end = reached(solution, case)
        uniform = [t for t in np.linspace(0.0, case.dynamics.until, SAMPLES).tolist() if t < end]
        yield from _distinct([*uniform, end])
        return
    steps = [step.at for step in solution.history if step.phase in {"path", "critical"}]
    yield from _distinct([*steps, *case.states])


def _known(solution: Solution, mark: float) -> Mapping[str, float]:
    """Return the quantities that the history has at the state of a path at a mark."""
    found: dict[str, float] = {}
    for step in solution.history:
        if step.phase in {"path", "critical"} and step.at == mark:
            found |= step.quantities
    return found
