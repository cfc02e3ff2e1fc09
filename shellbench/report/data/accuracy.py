"""Cost of accuracy: errors of a case's runs against unknowns, seconds and memory, grouped in families of one sweep."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, geometric_mean
from typing import Literal

import numpy as np
import pandas as pd

from shellbench.bench.judge.row import Row
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.notation import TEXT, percent
from shellbench.report.data.rates import SURFACE_DIMENSION, Course, Rate, Yardstick, courses, fitted_rate, yardstick_of
from shellbench.report.data.runs import grouped, headlines, seed_words
from shellbench.report.data.table import Note

Measure = Literal["unknowns", "seconds", "memory", "storage"]
SMALLEST = 1e-16  # relative error of an answer that agrees to the last digit, for a logarithmic axis
APART = 1.2  # ratio of unknowns from which sizes count one by one in a fit: meshes of 16x16 and 16x17 are one size
SPAN = 2.0  # ratio of costs that a fit must cover: a time that hardly grows has no exponent
STALLED = -0.25  # slope against unknowns above which errors fall no more: half of a first-order method's on a surface
MESH = "cells"  # the setting that says how many cells a mesh has, wherever it changes the unknowns


@dataclass(frozen=True)
class Point:
    """Runs of one size, which differ in their seed alone.

    Attributes
    ----------
    seconds
        Wall time of the solve, the mean of the seeds.
    memory
        Largest peak memory less what the process held before the solve, bytes.
    errors
        Magnitude of the relative error of each run.
    sound
        Whether all of them ended well.
    run_ids
        Of those that answered.
    rows
        Of all.
    storage
        Bytes that keep the solution.
    label
        The suite's word for the size; empty with default settings.
    """

    unknowns: int
    seconds: float
    memory: float | None
    errors: tuple[float, ...]
    sound: bool
    run_ids: tuple[str, ...]
    rows: tuple[Row, ...]
    storage: float | None = None
    label: str = ""

    @property
    def error(self) -> float:
        """Geometric mean of the errors."""
        return geometric_mean(self.errors)

    def cost(self, measure: Measure) -> float | None:
        """Return the cost in one measure: unknowns, seconds or bytes of memory; None if it was not measured."""
        return float(self.unknowns) if measure == "unknowns" else getattr(self, measure)


@dataclass(frozen=True)
class Family:
    """Runs of one solver that a sweep over one setting made, ordered by unknowns.

    Attributes
    ----------
    swept
        Name of the setting; empty for the default run. Two sweeps of one solver over different settings are two
        families.
    variant
        Settings that depart from the defaults, in words, where one solver has several lines.
    """

    solver: str
    swept: str
    points: tuple[Point, ...]
    variant: str = ""

    @property
    def name(self) -> str:
        """The solver and its settings, as a line of a table."""
        return f"{self.solver}, {self.variant}" if self.variant else self.solver

    @property
    def alone(self) -> bool:
        """True if the family has one size only, so that no second size can confirm it."""
        return len(self.points) == 1

    @property
    def finest(self) -> Point | None:
        """The finest size whose runs ended well; None if there is none."""
        return next((point for point in reversed(self.points) if point.sound), None)

    def mean(self, name: str) -> float | None:
        """Return a number of the finest size's rows, the mean of its seeds; None if one of them states none."""
        values = [getattr(row, name) for row in self.finest.rows] if self.finest else []
        return fmean(values) if values and None not in values else None

    @property
    def is_mesh(self) -> bool:
        """True if the sweep refines a mesh, so that errors have an order in the mesh width."""
        return self.swept == MESH and len({point.unknowns for point in self.points}) > 1

    def rate(self, measure: Measure, floor: float) -> Rate | None:
        """Fit a power law to the finest runs that ended well and still improved on all coarser ones.

        Sizes less than `APART` apart count once. None also where the cost grew by less than `SPAN`, and in time and
        memory where the unknowns are not those of meshes: small fields take the time of their libraries.
        """
        if measure != "unknowns" and not self.is_mesh:
            return None
        kept: list[Point] = []
        for point in reversed([point for point in self.points if point.sound and point.cost(measure) is not None]):
            if not kept or APART * point.unknowns <= kept[-1].unknowns:
                kept.append(point)
        falling = kept[kept.index(last) :] if (last := last_improvement(kept[::-1])) is not None else kept
        costs, errors = [point.cost(measure) or 0.0 for point in falling], [point.error for point in falling]
        rate = fitted_rate(costs, errors, floor)
        return rate if rate is not None and rate.last >= SPAN * rate.first else None

    def order(self, floor: float) -> float | None:
        """Return the order in the mesh width h, of which unknowns are as h**-2; None without meshes."""
        rate = self.rate("unknowns", floor) if self.is_mesh else None
        return None if rate is None else -SURFACE_DIMENSION * rate.slope

    def cheapest(self, level: float, floor: float, measure: Measure) -> tuple[float, Point] | None:
        """Return the least that it took to be within `level` of the truth, there and in all finer runs.

        Every seed must be, the uncertainty of what errors are relative to counted against it; a failed run is not.
        """
        lasting: list[Point] = []
        for point in reversed(self.points):
            if not point.sound or max(point.errors) + floor > level:
                break
            lasting.append(point)
        costs = [(cost, point) for point in lasting if (cost := point.cost(measure)) is not None]
        return min(costs, key=lambda pair: pair[0], default=None)


def last_improvement(points: Sequence[Point]) -> Point | None:
    """Return the last of points of growing size that improved on the best before it by more than a stalled slope."""
    last = best = points[0] if points else None
    for point in points[1:]:
        if best is not None and point.error < best.error * (point.unknowns / best.unknowns) ** STALLED:
            last = best = point
    return last


def down_to(points: Iterable[Point]) -> str:
    """Say how small the error got, of sizes whose runs ended well."""
    errors = [point.error for point in points if point.sound]
    return f"down to {TEXT.number(percent(min(errors), signed=False))} %" if errors else "failed"


@dataclass(frozen=True)
class AnsweredCase:
    """One case with all who answered it.

    Attributes
    ----------
    first
        One of its rows, which carries its words and the known value.
    failed
        By solver, in a clause each, the runs that did not end well.
    """

    first: Row
    yardstick: Yardstick
    families: tuple[Family, ...]
    failed: Mapping[str, Sequence[str]]

    @property
    def case(self) -> str:
        """Its name."""
        return self.first.case

    @property
    def title(self) -> str:
        """Title of the case; its name if it has none."""
        return self.first.case_title or self.first.case

    @property
    def run_ids(self) -> tuple[str, ...]:
        """The runs that answered."""
        return tuple(dict.fromkeys(run for one in self.families for point in one.points for run in point.run_ids))

    def failures(self, consequence: str = "") -> Iterator[Note]:
        """Yield a remark on each solver some of whose runs did not end well."""
        for solver, clauses in self.failed.items():
            several = len(clauses) > 1
            count, first = (f"{len(clauses)} runs", "; the first") if several else ("one run", "")
            yield Note(f"{self.title}, {solver}", f"{count} failed{consequence}{first}, {clauses[0]}")


@dataclass(frozen=True)
class CaseAccuracy(AnsweredCase):
    """All that is known of a case's accuracy and its cost.

    Attributes
    ----------
    refinements
        Histories of solvers that refine by themselves.
    """

    refinements: tuple[Course, ...]

    @property
    def quantity(self) -> str:
        """Description of the headline quantity; its name in words if it has none."""
        return self.first.description or self.first.quantity.replace("_", " ")

    @property
    def solvers(self) -> list[str]:
        """Return the solvers that answered, by name."""
        return sorted({family.solver for family in self.families})

    def of(self, solver: str) -> list[Family]:
        """Return the families of a solver, the one of most sizes first."""
        return sorted((f for f in self.families if f.solver == solver), key=lambda family: -len(family.points))


def accuracies(evidence: Evidence) -> list[CaseAccuracy]:
    """Return the accuracy of each case whose resolution is studied, from runs of the study and with defaults."""
    runs, studied = headlines(evidence.runs), headlines(evidence.runs, "resolution")
    cases = studied.loc[~studied["default_settings"], "case"]
    shown = runs[runs["case"].isin(cases) & (runs["default_settings"] | runs.index.isin(studied.index))]
    found = (_accuracy(of_case, evidence) for _, of_case in shown.groupby("case", sort=False))
    return [accuracy for accuracy in found if accuracy is not None]


def _accuracy(runs: pd.DataFrame, evidence: Evidence) -> CaseAccuracy | None:
    rows = list(runs["row"])
    yardstick = yardstick_of(evidence.records, rows)
    families = grouped(sizes(runs, yardstick), lambda point: (point.rows[0].solver, swept_setting(point.rows[0])))
    if yardstick is None or not families:
        return None
    histories = courses(evidence.records, [row for row in rows if row.default_settings])
    return CaseAccuracy(
        first=rows[0],
        yardstick=yardstick,
        families=tuple(family(*key, points) for key, points in sorted(families.items())),
        failed=failed_runs(rows),
        refinements=tuple(course for course in histories if course.refines and not course.is_field),
    )


def family(solver: str, swept: str, points: Sequence[Point], variant: str = "") -> Family:
    """Return a sweep with its sizes in order."""
    return Family(solver, swept, tuple(sorted(points, key=lambda point: (point.unknowns, point.seconds))), variant)


def swept_setting(row: Row) -> str:
    """Return the setting over which a suite's line swept to make a run: the last one that its label names.

    A run whose label names none is put with those of its solver that depart from the defaults in the same settings.
    """
    named = row.label.rpartition(", ")[2].partition(" ")[0]
    return named if named in row.overrides else " ".join(sorted(row.overrides))


def sizes(runs: pd.DataFrame, yardstick: Yardstick | None) -> list[Point]:
    """Return one point for each group of a case's runs that differ only in their seed.

    Groups without a finite value are omitted, and so is the run that serves as the yardstick.
    """
    found = []
    for _, alike in runs.groupby("alike", sort=False):
        answered = alike[np.isfinite(alike["value"]) & (alike["unknowns"] > 0)]
        if yardstick is None or (answered := answered[answered["run_id"] != yardstick.run_id]).empty:
            continue
        memory, storage = answered["solve_memory_bytes"].max(), answered["storage_bytes"].max()
        found.append(
            Point(
                unknowns=int(answered["unknowns"].max()),
                seconds=fmean(answered["seconds"].fillna(0.0)),
                memory=None if np.isnan(memory) else float(memory),
                errors=tuple(max(SMALLEST, abs(yardstick.error(value))) for value in answered["value"]),
                sound=bool(alike["sound"].all()),
                run_ids=tuple(answered["run_id"]),
                rows=tuple(alike["row"]),
                storage=None if np.isnan(storage) else float(storage),
                label=alike["row"].iloc[0].label,
            )
        )
    return found


def failed_runs(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Return, by solver and in a clause each, the runs that did not end well."""
    found: dict[str, list[str]] = {}
    for row in rows:
        if row.status != "ok":
            words = row.label if row.overrides and row.label else "default settings"
            found.setdefault(row.solver, []).append(f"{words}{seed_words(row.seed)}: {row.reason or row.status}")
    return found
