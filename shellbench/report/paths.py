"""From records to load-displacement curves: what each run left of its path, and what is known of it.

A case asks for the same displacement at several loads by several quantities; they are one series, and one panel of
the figure. Loads are in the unit in which the case's own load quantities give them, or are the load factor t.
"""

from __future__ import annotations

import contextlib
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from shellbench.bench.record import Record
from shellbench.bench.reference import KnownValue, KnownValues, Role
from shellbench.bench.row import Row
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.load_curve import Curve
from shellbench.problems.shell.quantities import DisplacementQuantity, LimitPoint, LoadQuantity
from shellbench.report.solutions import theory_words

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Series:
    """One displacement along the path: all quantities of a case with the same points and directions.

    Attributes
    ----------
    name
        What their names have in common.
    description
        What their descriptions have in common, but for the mark.
    """

    name: str
    unit: str
    description: str
    quantities: tuple[DisplacementQuantity, ...]


@dataclass(frozen=True)
class LoadAxis:
    """How loads are shown: the load factor times `scale`."""

    scale: float
    label: str


@dataclass(frozen=True)
class PathRun:
    """The path of one run.

    Attributes
    ----------
    name
        What the legend calls it.
    reason
        Why the run failed; None if it didn't.
    factors
        (n,) load factors of the computed states, the state of rest first.
    displacements
        By name of series: (n,), in the series' unit.
    """

    name: str
    seed: int | None
    run_id: str
    reason: str | None
    factors: Array
    displacements: Mapping[str, Array]

    def limit_points(self, series: str) -> list[tuple[float, float]]:
        """Return load factor and displacement at each extremum of the load."""
        path = np.stack([self.factors, self.displacements[series]], axis=1)
        moved = np.concatenate([[True], np.any(np.diff(path, axis=0) != 0, axis=1)])
        curve = Curve(*path[moved].T)
        points: list[tuple[float, float]] = []
        with contextlib.suppress(ValueError):  # there are no more, or too few states for a curve
            for number in range(1, len(self.factors)):
                points.append(curve.turning("load", number))
        return points


@dataclass(frozen=True)
class KnownPath:
    """What is known of one series.

    Attributes
    ----------
    label
        What the legend calls it: source and theory.
    judges
        Whether it decides on solvers.
    displacements, factors
        (n,) of points; a load without a displacement has NaN there.
    """

    label: str
    judges: bool
    displacements: Array
    factors: Array


def series_of(case: Case) -> tuple[Series, ...]:
    """Return the distinct displacements that a case asks for, in its order."""
    alike: dict[tuple[object, ...], list[DisplacementQuantity]] = {}
    for quantity in case.quantities:
        if isinstance(quantity, DisplacementQuantity):
            alike.setdefault((quantity.points, quantity.directions), []).append(quantity)
    found: dict[str, Series] = {}
    for quantities in alike.values():
        last = max(quantities, key=lambda quantity: quantity.at)
        parts = zip(*(quantity.name.split("_") for quantity in quantities), strict=False)
        common = "_".join(part[0] for part in itertools.takewhile(lambda part: len(set(part)) == 1, parts))
        name = common if common and common not in found else last.name
        found[name] = Series(name, last.unit, _description(quantities), tuple(quantities))
    return tuple(found.values())


def _description(quantities: Sequence[DisplacementQuantity]) -> str:
    """Return what the descriptions have in common, up to the words on the mark."""
    words = zip(*(quantity.description.split() for quantity in quantities), strict=False)
    common = " ".join(word[0] for word in itertools.takewhile(lambda word: len(set(word)) == 1, words))
    return common if len(quantities) == 1 else f"{common} ".partition(" at ")[0].strip()


def load_axis(case: Case) -> LoadAxis:
    """Return how the loads of a case are shown."""
    for quantity in case.quantities:
        if isinstance(quantity, LoadQuantity) or (isinstance(quantity, LimitPoint) and quantity.gives == "load"):
            return LoadAxis(quantity.scale, f"load ({quantity.unit})")
    return LoadAxis(1.0, "load factor t")


def readable(name: str) -> str:
    """Return the name of a series for an axis: letters with an index as such, all else as words."""
    if found := re.fullmatch(r"([A-Za-z])_(\w)", name):
        return f"${found[1]}_{{{found[2]}}}$"
    return name.replace("_", " ")


def path_run(record: Record, case: Case, name: str) -> PathRun | None:
    """Return the path that a run left; None if it left none."""
    series = {one.name: {quantity.name for quantity in one.quantities} for one in series_of(case)}
    steps = [step for step in record.history if step.phase == "path"]
    found = {
        one: np.array(
            [0.0, *(next((step.quantities[q] for q in names if q in step.quantities), np.nan) for step in steps)]
        )
        for one, names in series.items()
    }
    found = {one: values for one, values in found.items() if np.any(np.isfinite(values[1:]))}
    if not found:
        return None
    factors = np.array([0.0, *(step.at for step in steps)])
    reason = None if record.status == "ok" else record.reason or record.status
    return PathRun(name, record.identity.seed, record.run_id, reason, factors, found)


def known_paths(case: Case, known: KnownValues, series: Series) -> list[KnownPath]:
    """Return what is known of a series: the values that judge, those of the literature, and tabulated curves."""
    return [*_points(case, known, series), *_curves(known, series)]


def limit_loads(case: Case, known: KnownValues) -> list[float]:
    """Return the load factors of turning points whose load is known and judges, but not their displacement."""
    pairs = _turning_pairs(case, known, "judge")
    return [load for load, displacement in pairs if load is not None and displacement is None]


def _points(case: Case, known: KnownValues, series: Series) -> Iterator[KnownPath]:
    found: dict[tuple[str, bool], list[tuple[float, float]]] = {}
    roles: tuple[Role, Role] = ("judge", "literature")
    controlling = case.path.quantity in {quantity.name for quantity in series.quantities}
    for role in roles:
        judges = role == "judge"
        for quantity in series.quantities:
            for value in known.of(quantity.name, role):
                if judges and value.theory != case.theory:
                    continue
                factor = quantity.at if case.path.quantity is None else _load_at(case, known, quantity.at)
                if factor is not None and not _tabulated(value, factor, known):
                    label = "known value" if judges else words_of(value.label, value.source, value.theory)
                    found.setdefault((label, judges), []).append((value.value, factor))
        if controlling:
            for load in (q for q in case.quantities if isinstance(q, LoadQuantity)):
                for value in known.of(load.name, role):
                    if judges and value.theory != case.theory:
                        continue
                    label = "known value" if judges else words_of(value.label, value.source, value.theory)
                    found.setdefault((label, judges), []).append((load.at, value.value / load.scale))
    if controlling:
        turning = [pair for pair in _turning_pairs(case, known, "judge") if None not in pair]
        found.setdefault(("known value", True), []).extend(
            (d, f) for f, d in turning if d is not None and f is not None
        )
    for (label, judges), points in found.items():
        if points:
            displacements, factors = np.array(points).T
            yield KnownPath(label, judges, displacements, factors)


def _tabulated(value: KnownValue, factor: float, known: KnownValues) -> bool:
    """Tell whether a value is a point of a curve of the same source, which is drawn anyway."""
    return value.role != "judge" and any(
        (curve.quantity, curve.source) == (value.quantity, value.source)
        and (factor, value.value) in zip(curve.loads, curve.values, strict=True)
        for curve in known.curves
    )


def _curves(known: KnownValues, series: Series) -> Iterator[KnownPath]:
    names = {quantity.name for quantity in series.quantities}
    for curve in known.curves:
        if curve.quantity in names:
            label = words_of(curve.label, curve.source, curve.theory)
            yield KnownPath(label, False, np.asarray(curve.values, dtype=float), np.asarray(curve.loads, dtype=float))


def _load_at(case: Case, known: KnownValues, mark: float) -> float | None:
    """Return the known load factor at a mark of a path that no load factor marks."""
    for quantity in case.quantities:
        if isinstance(quantity, LoadQuantity) and quantity.at == mark:
            judge = known.judge(quantity.name, case.theory)
            if judge is not None:
                return judge.value / quantity.scale
    return None


def _turning_pairs(case: Case, known: KnownValues, role: Role) -> list[tuple[float | None, float | None]]:
    """Return load factor and displacement of each known turning point, as far as they are known."""
    pairs: dict[tuple[str, int], dict[str, float]] = {}
    for quantity in case.quantities:
        if isinstance(quantity, LimitPoint):
            for value in known.of(quantity.name, role):
                if value.theory == case.theory:
                    scale = quantity.scale if quantity.gives == "load" else 1.0
                    pairs.setdefault((quantity.turning, quantity.number), {})[quantity.gives] = value.value / scale
    return [(pair.get("load"), pair.get("displacement")) for pair in pairs.values()]


def words_of(label: str, source: str, theory: str) -> str:
    """Return what a legend calls a figure from elsewhere."""
    return f"{label or source}, {theory_words(theory)}"


def case_of(record: Record) -> Case | None:
    """Return the case of a record; None if it can't be read any more."""
    try:
        return Case.model_validate(record.case)
    except ValidationError:
        return None


def runs_by_case(
    records: Mapping[str, Record], rows: Sequence[Row]
) -> dict[tuple[str, bool], list[tuple[Row, Record]]]:
    """Return the runs of rows by case (and whether it is a user's own), each run once."""
    found: dict[tuple[str, bool], dict[str, tuple[Row, Record]]] = {}
    for row in rows:
        record = records.get(row.run_id or "")
        if record is not None:
            found.setdefault((row.case, row.own_case), {}).setdefault(record.run_id, (row, record))
    return {case: list(runs.values()) for case, runs in found.items()}
