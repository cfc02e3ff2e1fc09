"""From records to load-displacement curves: what each run left of its path, and what is known of it.

A case asks for the same displacement at several loads by several quantities; they are one series, and one panel of
the figure. Loads are in the unit in which the case's own load quantities give them, or are the load factor t.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.record import Record
from shellbench.bench.reference import KnownValue, KnownValues, Role
from shellbench.bench.row import Row
from shellbench.portrait import PathSeries, Portrait
from shellbench.problems.load_curve import Curve
from shellbench.report.solutions import theory_words

Array = NDArray[np.float64]


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


def readable(name: str) -> str:
    """Return the name of a series for an axis: letters with an index as such, all else as words."""
    if found := re.fullmatch(r"([A-Za-z])_(\w)", name):
        return f"${found[1]}_{{{found[2]}}}$"
    return name.replace("_", " ")


def path_run(record: Record, case: Portrait, name: str) -> PathRun | None:
    """Return the path that a run left; None if it left none."""
    series = {one.name: {quantity.name for quantity in one.quantities} for one in case.paths}
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


def known_paths(case: Portrait, known: KnownValues, series: PathSeries) -> list[KnownPath]:
    """Return what is known of a series: the values that judge, those of the literature, and tabulated curves."""
    return [*_points(case, known, series), *_curves(known, series)]


def limit_loads(case: Portrait, known: KnownValues) -> list[float]:
    """Return the load factors of turning points whose load is known and judges, but not their displacement."""
    pairs = _turning_pairs(case, known, "judge")
    return [load for load, displacement in pairs if load is not None and displacement is None]


def _points(case: Portrait, known: KnownValues, series: PathSeries) -> Iterator[KnownPath]:
    found: dict[tuple[str, bool], list[tuple[float, float]]] = {}
    roles: tuple[Role, Role] = ("judge", "literature")
    controlling = case.controlled_by in {quantity.name for quantity in series.quantities}
    for role in roles:
        judges = role == "judge"
        for quantity in series.quantities:
            for value in known.of(quantity.name, role):
                if judges and value.theory != case.theory:
                    continue
                factor = quantity.at if case.controlled_by is None else _load_at(case, known, quantity.at)
                if factor is not None and not _tabulated(value, factor, known):
                    label = "known value" if judges else words_of(value.label, value.source, value.theory)
                    found.setdefault((label, judges), []).append((value.value, factor))
        if controlling:
            for load in case.loads:
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


def _curves(known: KnownValues, series: PathSeries) -> Iterator[KnownPath]:
    names = {quantity.name for quantity in series.quantities}
    for curve in known.curves:
        if curve.quantity in names:
            label = words_of(curve.label, curve.source, curve.theory)
            yield KnownPath(label, False, np.asarray(curve.values, dtype=float), np.asarray(curve.loads, dtype=float))


def _load_at(case: Portrait, known: KnownValues, mark: float) -> float | None:
    """Return the known load factor at a mark of a path that no load factor marks."""
    for load in case.loads:
        if load.at == mark and (judge := known.judge(load.name, case.theory)) is not None:
            return judge.value / load.scale
    return None


def _turning_pairs(case: Portrait, known: KnownValues, role: Role) -> list[tuple[float | None, float | None]]:
    """Return load factor and displacement of each known turning point, as far as they are known."""
    pairs: dict[tuple[str, int], dict[str, float]] = {}
    for turning in case.turnings:
        for value in known.of(turning.name, role):
            if value.theory == case.theory:
                scale = turning.scale if turning.gives == "load" else 1.0
                pairs.setdefault((turning.of, turning.number), {})[turning.gives] = value.value / scale
    return [(pair.get("load"), pair.get("displacement")) for pair in pairs.values()]


def words_of(label: str, source: str, theory: str) -> str:
    """Return what a legend calls a figure from elsewhere."""
    return f"{label or source}, {theory_words(theory)}"


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
