"""Series: a case's quantities all along the path or motion, not only at the asked marks.

A case asks for the same thing at several times by several quantities, `corner_x_200ms` and `corner_x_300ms`; they are
one series. For a motion the energies are kept too, whether or not the case asks for them.

Snapshots: a solution at one time that remembers its answers, for many quantities ask for the same field.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.posed.course import is_constant
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.quantities.quantities import EnergyQuantity, MotionEnergy, QuantityModel
from shellbench.protocol.history import Series, finite_or_none

Array = NDArray[np.float64]


def snapshot_of(solution: DisplacementField, mark: float) -> DisplacementField:
    """Return a view of the solution at a mark: it answers for that mark only, and computes each answer once."""
    return cast(DisplacementField, _Snapshot(solution, mark))


class _Snapshot:
    """A solution at one mark that remembers the answers to measurements; it passes on all other attributes."""

    def __init__(self, solution: DisplacementField, mark: float) -> None:
        self._solution = solution
        self._mark = mark
        self._answers: dict[object, Any] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solution, name)

    def displacement(self, points: ArrayLike, at: float | None = None, material: object = None) -> Any:
        return self._field(self._solution.displacement, points)

    def velocity(self, points: ArrayLike, at: float | None = None) -> Any:
        return self._field(self._solution.velocity, points)

    def energies(self, at: float | None = None) -> Any:
        return self._ask_once(("energies",), lambda: self._solution.energies(self._mark))

    def reaction(self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None) -> Any:
        about = np.asarray(centre, dtype=float)
        key = ("reaction", support, about.tobytes())
        return self._ask_once(key, lambda: self._solution.reaction(support, about, at=self._mark))

    def _field(self, ask: Callable[..., Array], points: ArrayLike) -> Any:
        xi = np.asarray(points, dtype=float)
        return self._ask_once((ask.__name__, xi.shape, xi.tobytes()), lambda: ask(xi, at=self._mark))

    def _ask_once(self, key: object, ask: Callable[[], Any]) -> Any:
        if key not in self._answers:
            self._answers[key] = ask()
        return self._answers[key]


CURVE_TIMES = 101  # times, rest among them: hundredths of the whole time, for curves of some ten swings
FRAMES = 21  # times at which the field is kept, rest among them: every twentieth of the whole time
MARK = re.compile(r"_\d+[a-z]*$")  # ending of a quantity's name with a time, such as corner_x_200ms
APART = {"name", "description", "unit", "primary", "at", "tolerance", "absolute", "open_finding"}
TOTAL = MotionEnergy(name="total_energy", kind="total_energy")
ENERGIES: tuple[QuantityModel, ...] = (
    MotionEnergy(name="kinetic_energy", kind="kinetic_energy"),
    EnergyQuantity(name="membrane_energy", kind="membrane_energy"),
    EnergyQuantity(name="bending_energy", kind="bending_energy"),
)
REFUSED = (InputError, ValueError)  # errors by which a solution and its measurement state that a time was not reached


@dataclass(frozen=True)
class Asked:
    """One measured value of a case, at all its marks.

    Attributes
    ----------
    name
        Of its quantities, without their mark.
    quantities
        Those that measure it, by name; none for an energy that the case does not ask for.
    """

    name: str
    quantity: QuantityModel
    quantities: tuple[str, ...]


def asked_series(case: Shell) -> tuple[Asked, ...]:
    """Return the series of a case, in its order: all quantities of a motion; forces and torques of a path."""
    moving = case.dynamics is not None
    followed = {"motion", "path"} if moving else {"path"} if _by_load(case) else set()
    wanted = [q for q in case.quantities if q.series in followed]
    alike: dict[str, list[QuantityModel]] = {}
    for quantity in wanted:
        alike.setdefault(_meaning(quantity), []).append(quantity)
    for quantity in (*ENERGIES, *((TOTAL,) if _keeps_energy(case) else ())) if moving else ():
        alike.setdefault(_meaning(quantity), [])
    energies = {_meaning(quantity): quantity for quantity in (*ENERGIES, TOTAL)}
    found: dict[str, Asked] = {}
    for meaning, quantities in alike.items():
        first = quantities[0] if quantities else energies[meaning]
        short = MARK.sub("", first.name)
        name = short if short not in found else first.name
        found[name] = Asked(name, first, tuple(quantity.name for quantity in quantities))
    return tuple(found.values())


def _by_load(case: Shell) -> bool:
    return not case.linear and case.path.quantity is None


def _meaning(quantity: QuantityModel) -> str:
    """Return a text that is the same for two quantities that measure the same thing."""
    return quantity.model_dump_json(exclude=APART)


def _keeps_energy(case: Shell) -> bool:
    """Return True if a case may ask for its total energy."""
    try:
        TOTAL.check_motion(case, is_constant(case))
    except ValueError:
        return False
    return True


def mark_reached(solution: DisplacementField, case: Shell) -> float:
    """Return the time, s, or load factor up to which a solution goes."""
    until = case.path.until if case.dynamics is None else case.dynamics.until
    steps = [step.at for step in solution.history if step.phase in {"time", "path"} and math.isfinite(step.energy)]
    return min(until, steps[-1]) if steps else until


def frames(solution: DisplacementField, case: Shell) -> tuple[float, ...]:
    """Return the marks at which the field is kept: those asked for, and in motion times all along the way.

    A motion that ended early is kept at its last time too.
    """
    if case.dynamics is None:
        return case.states
    end = mark_reached(solution, case)
    uniform = np.linspace(0.0, case.dynamics.until, FRAMES)[1:].tolist()
    return _distinct_marks([mark for mark in (*uniform, *case.states) if mark < end] + [end])


def _distinct_marks(marks: list[float]) -> tuple[float, ...]:
    """Return the marks in order; of marks that differ by rounding only the last one is kept."""
    kept: dict[str, float] = {f"{mark:.9g}": mark for mark in marks}
    return tuple(sorted(kept.values()))


def series_of(solution: DisplacementField, case: Shell) -> tuple[Series, ...]:
    """Measure a solution all along its path or motion; refused and non-finite values are left out."""
    asked = asked_series(case)
    points: dict[str, dict[float, float]] = {one.name: {} for one in asked}
    for mark in _marks(solution, case) if asked else ():
        snapshot = snapshot_of(solution, mark)
        known = _quantities_in_history(solution, mark)
        for one in asked:
            value = next((known[name] for name in one.quantities if name in known), None)
            if value is None:
                with contextlib.suppress(*REFUSED):
                    value = measure(snapshot, one.quantity.model_copy(update={"at": mark}))
            if (figure := finite_or_none(value)) is not None:
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


def _marks(solution: DisplacementField, case: Shell) -> Iterator[float]:
    if case.dynamics is not None:
        end = mark_reached(solution, case)
        uniform = [t for t in np.linspace(0.0, case.dynamics.until, CURVE_TIMES).tolist() if t < end]
        yield from _distinct_marks([*uniform, end])
        return
    steps = [step.at for step in solution.history if step.phase in {"path", "critical"}]
    yield from _distinct_marks([*steps, *case.states])


def _quantities_in_history(solution: DisplacementField, mark: float) -> Mapping[str, float]:
    """Return the quantities that the history holds for the state of a path at a mark."""
    found: dict[str, float] = {}
    for step in solution.history:
        if step.phase in {"path", "critical"} and step.at == mark:
            found |= step.quantities
    return found
