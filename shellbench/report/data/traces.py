"""From records to traces: what each run's quantities were over time, or along a path, and what is known of them.

Loads of a path are load factors; a figure shows them in the unit in which the case's own load quantities give them.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from shellbench.bench.catalogue.reference import KnownValue, KnownValues, Role
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record, portrait_of
from shellbench.protocol.history import HistoryStep
from shellbench.protocol.load_curve import Curve
from shellbench.protocol.picture import Along, PathSeries, Portrait
from shellbench.report.data.fields import Fields, areas, read_fields
from shellbench.report.data.runs import seed_words
from shellbench.report.data.solutions import theory_words

Array = NDArray[np.float64]
Point = tuple[float, float]
Phase = Literal["path", "time"]
Key = tuple[str, bool]  # what a legend calls known points, and whether they judge

CURVE, STATES = "curve_", "states_"  # how names of figures begin
MOTION, ENERGY, APART = "motion_", "energy_", "apart_"
BUCKLING, FRAMES, FILM = "buckling_", "frames_", "film_"
CLOTH = (MOTION, ENERGY, APART, BUCKLING, FRAMES, FILM)
BALANCE = "energy_balance"  # a trace of the solver's own: see `shellbench.problem.Step.energy` of a step in time
JUDGE: Key = ("known value", True)
CRITICAL = "known critical state"
SAME = 1e-6  # relative difference of marks of one frame


@dataclass(frozen=True)
class Trace:
    """Values of one series at its marks, both (n,)."""

    marks: Array
    values: Array

    def at(self, mark: float) -> float | None:
        """Return the value at a mark, between known ones by a straight line; None beyond the last."""
        rounding = 1e-9 * max(1.0, abs(mark))
        if not len(self.marks) or not self.marks[0] - rounding <= mark <= self.marks[-1] + rounding:
            return None
        return float(np.interp(mark, self.marks, self.values))

    def limit_points(self) -> list[Point]:
        """Return load factor and displacement at each extremum of the load."""
        path = np.stack([self.marks, self.values], axis=1)
        moved = np.concatenate([[True], np.any(np.diff(path, axis=0) != 0, axis=1)])
        curve = Curve(*path[moved].T)
        points: list[Point] = []
        with contextlib.suppress(ValueError):  # there are no more, or too few states for a curve
            for number in range(1, len(self.marks)):
                points.append(curve.turning_point("load", number))
        return points


@dataclass(frozen=True)
class TracedRun:
    """The series of one run.

    Attributes
    ----------
    name
        What the legend calls it.
    reason
        Why the run failed; None if it didn't.
    traces
        By name of series.
    special
        By name of series: marks and values of the states that a diamond marks.
    """

    name: str
    seed: int | None
    run_id: str
    reason: str | None
    traces: Mapping[str, Trace]
    special: Mapping[str, Sequence[Point]] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """Name of the run for captions, with its seed."""
        return f"{self.name}{seed_words(self.seed)}"


@dataclass(frozen=True)
class KnownPoints:
    """Known values of one series: values (n,) at marks (n,) and their uncertainties, NaN where not known.

    Attributes
    ----------
    label
        What the legend calls them: source and theory.
    judges
        Whether they decide on solvers.
    """

    label: str
    judges: bool
    marks: Array
    values: Array
    uncertainties: Array


def steps_of(record: Record, phase: Phase) -> list[HistoryStep]:
    """Return the steps of a run along its path, or in time."""
    return [step for step in record.history if step.phase == phase]


def portrayed(made: pd.DataFrame) -> Iterator[tuple[Portrait, pd.DataFrame]]:
    """Yield the portrait of each case that has one, with its runs."""
    for _, runs in made.groupby(["case", "own_case"], sort=False):
        if (case := portrait_of(runs["record"].iloc[0])) is not None:
            yield case, runs


def readable(name: str) -> str:
    """Return the name of a series for an axis: letters with an index as such, all else as words."""
    if found := re.fullmatch(r"([A-Za-z])_(\w)", name):
        return f"${found[1]}_{{{found[2]}}}$"
    return name.replace("_", " ")


def words_of(label: str, source: str, theory: str) -> str:
    """Return the legend's name of a value from another source."""
    return f"{label or source}, {theory_words(theory)}"


def traced(record: Record, case: Portrait, name: str) -> TracedRun | None:
    """Return the traces that a run left; None if it left none."""
    traces = {one.name: Trace(np.array(one.marks), np.array(one.values)) for one in record.series}
    if not traces:
        return None
    if steps := steps_of(record, "time"):
        traces[BALANCE] = _from_rest([step.at for step in steps], [step.energy for step in steps])
    if case.ends is None:  # a path starts at rest, where there is no force
        traces = {key: _from_rest(one.marks, one.values) for key, one in traces.items()}
    critical = next((step.at for step in record.history if step.phase == "critical"), None)
    there = {key: (critical, one.at(critical)) for key, one in traces.items() if critical is not None}
    special = {key: [(mark, value)] for key, (mark, value) in there.items() if value is not None}
    return TracedRun(name, record.identity.seed, record.run_id, reason(record), traces, special)


def path_run(record: Record, case: Portrait, name: str) -> TracedRun | None:
    """Return the displacements along the path that a run left, by load factor; None if it left none."""
    steps = steps_of(record, "path")
    traces = {}
    for one in case.paths:
        names = {quantity.name for quantity in one.quantities}
        values = [next((step.quantities[q] for q in names if q in step.quantities), np.nan) for step in steps]
        if np.any(np.isfinite(values)):
            traces[one.name] = _from_rest([step.at for step in steps], values)
    turning = {key: one.limit_points() for key, one in traces.items()} if case.controlled_by is not None else {}
    run = TracedRun(name, record.identity.seed, record.run_id, reason(record), traces, turning)
    return run if traces else None


def _from_rest(marks: Sequence[float] | Array, values: Sequence[float] | Array) -> Trace:
    return Trace(np.array([0.0, *marks]), np.array([0.0, *values]))


def reason(record: Record) -> str | None:
    """Return the reason why a run failed; None if it did not fail."""
    return None if record.status == "ok" else record.reason or record.status


def known_points(case: Portrait, known: KnownValues, series: Along) -> list[KnownPoints]:
    """Return the known values of a series: first those that judge, then those of other origins."""
    found = [
        (_key(value), (case.quantity(name).at, value))
        for name in series.quantities
        for value in _values(case, known, name, "judge", "origin", "literature", "published")
    ]
    for there in (one for one in case.criticals if one.gives in series.quantities):
        for mark in (one for one in case.criticals if one.gives == "load"):
            at, value = known.judge(mark.name, case.theory), known.judge(there.name, case.theory)
            if at is not None and value is not None:
                found.append(((CRITICAL, True), (at.value / mark.scale, value)))
    return _grouped([(key, (mark, value.value, value.uncertainty)) for key, (mark, value) in found])


def known_paths(case: Portrait, known: KnownValues, series: PathSeries) -> list[KnownPoints]:
    """Return the known values of a series: those that judge, those of the literature, and tabulated curves.

    If the states of the path are given by a displacement, the known loads are points of its series.
    """
    found: list[tuple[Key, tuple[float, float, float | None]]] = []
    names = {quantity.name for quantity in series.quantities}
    for quantity in series.quantities:
        factor = quantity.at if case.controlled_by is None else _load_at(case, known, quantity.at)
        for value in _values(case, known, quantity.name, "judge", "literature"):
            if factor is not None and not _tabulated(value, factor, known):
                found.append((_key(value), (factor, value.value, None)))
    if case.controlled_by in names:
        for load in case.loads:
            for value in _values(case, known, load.name, "judge", "literature"):
                found.append((_key(value), (value.value / load.scale, load.at, None)))
        whole = (one for one in _turnings(case, known) if len(one) > 1)
        found += [(JUDGE, (one["load"], one["displacement"], None)) for one in whole]
    tables = [
        ((words_of(curve.label, curve.source, curve.theory), False), (factor, value, None))
        for curve in known.curves
        if curve.quantity in names
        for factor, value in zip(curve.loads, curve.values, strict=True)
    ]
    return _grouped([*found, *tables])


def limit_loads(case: Portrait, known: KnownValues) -> list[float]:
    """Return the load factors of turning points whose load is known and judges, but not their displacement."""
    return [one["load"] for one in _turnings(case, known) if "displacement" not in one]


def _values(case: Portrait, known: KnownValues, name: str, *roles: Role) -> list[KnownValue]:
    """Return the known values of a quantity in given roles; values that judge only if they are of the case's theory."""
    return [value for value in known.of(name, *roles) if value.role != "judge" or value.theory == case.theory]


def _key(value: KnownValue) -> Key:
    """Return the legend's name of a known value, and a flag that is True if the value judges."""
    if value.role == "judge":
        return JUDGE
    return ("second origin" if value.role == "origin" else words_of(value.label, value.source, value.theory)), False


def _grouped(found: Sequence[tuple[Key, tuple[float, float, float | None]]]) -> list[KnownPoints]:
    """Return marks, values and uncertainties by what a legend calls them, what judges first."""
    groups: dict[Key, list[tuple[float, ...]]] = {}
    for key, (mark, value, doubt) in found:
        groups.setdefault(key, []).append((mark, value, np.nan if doubt is None else doubt))
    points = [KnownPoints(*key, *np.array(group).T) for key, group in groups.items()]
    return sorted(points, key=lambda one: not one.judges)


def _tabulated(value: KnownValue, factor: float, known: KnownValues) -> bool:
    """Tell whether a value is a point of a curve of the same source, which is drawn anyway."""
    return value.role != "judge" and any(
        (curve.quantity, curve.source) == (value.quantity, value.source)
        and (factor, value.value) in zip(curve.loads, curve.values, strict=True)
        for curve in known.curves
    )


def _load_at(case: Portrait, known: KnownValues, mark: float) -> float | None:
    """Return the known load factor at a mark of a path that no load factor marks."""
    judges = ((load, known.judge(load.name, case.theory)) for load in case.loads if load.at == mark)
    return next((judge.value / load.scale for load, judge in judges if judge is not None), None)


def _turnings(case: Portrait, known: KnownValues) -> list[dict[str, float]]:
    """Return "load" factor and "displacement" of each turning point, as far as they are known and judge."""
    points: dict[tuple[str, int], dict[str, float]] = {}
    for turning in case.turnings:
        if (value := known.judge(turning.name, case.theory)) is not None:
            scale = turning.scale if turning.gives == "load" else 1.0
            points.setdefault((turning.of, turning.number), {})[turning.gives] = value.value / scale
    return list(points.values())


@dataclass(frozen=True)
class Apart:
    """The difference of a run's motion from the one that it is compared with.

    Attributes
    ----------
    against
        Solver of the latter.
    rms
        Root of the mean square of the difference over the surface at each frame that both kept, m; zero at rest.
    """

    against: str
    rms: Trace

    @property
    def largest(self) -> Point:
        """When it is largest, and how large."""
        place = int(np.argmax(self.rms.values))
        return float(self.rms.marks[place]), float(self.rms.values[place])


def yardstick(rows: Sequence[Row]) -> Row | None:
    """Return the row of the run that others are compared with: the only good one without a seed, if there is one."""
    certain = {row.run_id: row for row in rows if row.seed is None and row.status == "ok"}
    return next(iter(certain.values())) if len(certain) == 1 else None


def apart(runs: pd.DataFrame, folder: Path) -> dict[str, Apart]:
    """Return, by run id, the distances of the runs of one case from the one that they are compared with."""
    standard = yardstick(list(runs["row"]))
    fields = {record.run_id: read_fields(record, folder) for record in runs["record"]} if standard is not None else {}
    theirs = fields.pop(standard.run_id or "") if standard is not None else None
    found: dict[str, Apart] = {}
    for run_id, ours in fields.items():
        if standard is not None and ours and theirs and ours.position.shape == theirs.position.shape:
            rms = rms_difference(ours, theirs)
            found |= {run_id: Apart(standard.solver, rms)} if len(rms.marks) > 1 else {}
    return found


def rms_difference(ours: Fields, theirs: Fields) -> Trace:
    """Return the root of the mean square of the difference over the reference surface, m, at marks of both."""
    weights = areas(theirs.position)
    frames = [(float(mark), i, frame_at(ours, float(mark))) for i, mark in enumerate(theirs.marks)]
    both = [(mark, i, j) for mark, i, j in frames if j is not None]
    squares = [np.sum((ours.displacements[j] - theirs.displacements[i]) ** 2, axis=-1) for _, i, j in both]
    means = [float(np.sqrt(np.sum(weights * square) / weights.sum())) for square in squares]
    return _from_rest([mark for mark, _, _ in both], means)


def frame_at(fields: Fields, mark: float) -> int | None:
    """Return the index of the stored frame at a mark; None if no frame is at it."""
    if not len(fields.marks):
        return None
    nearest = int(np.argmin(np.abs(fields.marks - mark)))
    return nearest if abs(fields.marks[nearest] - mark) <= SAME * max(abs(mark), SAME) else None


def shown_marks(case: Portrait, kept: Mapping[str, Fields], most: int) -> list[float]:
    """Return so many marks at most to show frames at: evenly spread over the time, or over the kept states."""
    rounded = {f"{mark:.6g}": float(mark) for fields in kept.values() for mark in fields.marks}
    marks = sorted(rounded.values())
    if case.ends is None or not marks:
        places = np.unique(np.round(np.linspace(0, len(marks) - 1, min(most, len(marks)))).astype(int))
        return [marks[place] for place in places]
    wanted = np.linspace(0.0, case.way, most + 1)[1:]
    return sorted({marks[int(np.argmin(np.abs(np.subtract(marks, t))))] for t in wanted})
