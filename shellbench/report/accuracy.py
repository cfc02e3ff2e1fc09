"""What accuracy took: the errors of a case's runs against unknowns, seconds and memory, in families of one sweep."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, geometric_mean
from typing import Literal

from shellbench.bench.row import Row
from shellbench.report.courses import SURFACE_DIMENSION, Course, courses
from shellbench.report.evidence import Evidence
from shellbench.report.rates import Rate, fitted_rate
from shellbench.report.runs import headlines
from shellbench.report.solutions import grouped, same_but_for_seed
from shellbench.report.yardstick import Yardstick, yardstick_of

Measure = Literal["unknowns", "seconds", "memory"]
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
    """

    unknowns: int
    seconds: float
    memory: float | None
    errors: tuple[float, ...]
    sound: bool
    run_ids: tuple[str, ...]

    @property
    def error(self) -> float:
        """Geometric mean of the errors."""
        return geometric_mean(self.errors)

    def cost(self, measure: Measure) -> float | None:
        """Return what it took."""
        return float(self.unknowns) if measure == "unknowns" else getattr(self, measure)


@dataclass(frozen=True)
class Family:
    """Runs of one solver that a sweep over one setting made, ordered by unknowns.

    Attributes
    ----------
    swept
        Name of the setting; empty for the default run. Two sweeps of one solver over different settings are two
        families.
    """

    solver: str
    swept: str
    points: tuple[Point, ...]

    @property
    def is_mesh(self) -> bool:
        """Whether its unknowns belong to meshes of so many cells, and errors have an order in the mesh width."""
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


@dataclass(frozen=True)
class CaseAccuracy:
    """All that is known of a case's accuracy and its cost.

    Attributes
    ----------
    failed
        By solver, in a clause each, the runs that did not end well.
    refinements
        Histories of solvers that refine by themselves.
    """

    case: str
    title: str
    quantity: str
    yardstick: Yardstick
    families: tuple[Family, ...]
    failed: Mapping[str, Sequence[str]]
    refinements: tuple[Course, ...]

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
    found = (_accuracy(list(of_case["row"]), evidence) for _, of_case in shown.groupby("case", sort=False))
    return [accuracy for accuracy in found if accuracy is not None]


def _accuracy(rows: Sequence[Row], evidence: Evidence) -> CaseAccuracy | None:
    first, yardstick = rows[0], yardstick_of(evidence.records, rows)
    if yardstick is None:
        return None
    families: dict[tuple[str, str], list[Point]] = {}
    for alike in grouped(rows, same_but_for_seed).values():
        point = point_of(alike, yardstick)
        if point is not None:
            families.setdefault((alike[0].solver, swept_setting(alike[0])), []).append(point)
    if not families:
        return None
    histories = courses(evidence.records, [row for row in rows if row.default_settings])
    return CaseAccuracy(
        case=first.case,
        title=first.case_title or first.case,
        quantity=first.description or first.quantity.replace("_", " "),
        yardstick=yardstick,
        families=tuple(
            Family(solver, swept, tuple(sorted(points, key=lambda point: (point.unknowns, point.seconds))))
            for (solver, swept), points in sorted(families.items())
        ),
        failed=failed_runs(rows),
        refinements=tuple(course for course in histories if course.refines and not course.is_field),
    )


def swept_setting(row: Row) -> str:
    """Return the setting over which a suite's line swept to make a run: the last one that its label names.

    A run whose label names none is put with those of its solver that depart from the defaults in the same settings.
    """
    named = row.label.rpartition(", ")[2].partition(" ")[0]
    return named if named in row.overrides else " ".join(sorted(row.overrides))


def point_of(alike: Sequence[Row], yardstick: Yardstick) -> Point | None:
    """Return what runs that differ in their seed alone come to; None if none answered."""
    answered = [
        row
        for row in alike
        if row.value is not None and math.isfinite(row.value) and row.parameters and row.run_id != yardstick.run_id
    ]
    if not answered:
        return None
    memory = [
        float(row.peak_memory_bytes - row.idle_memory_bytes)
        for row in answered
        if row.peak_memory_bytes and row.idle_memory_bytes and row.peak_memory_bytes > row.idle_memory_bytes
    ]
    return Point(
        unknowns=max(row.parameters or 0 for row in answered),
        seconds=fmean(row.seconds or 0.0 for row in answered),
        memory=max(memory, default=None),
        errors=tuple(max(SMALLEST, abs(yardstick.error(row.value or 0.0))) for row in answered),
        sound=all(row.status == "ok" for row in alike),
        run_ids=tuple(row.run_id or "" for row in answered),
    )


def failed_runs(rows: Sequence[Row]) -> dict[str, list[str]]:
    """Return, by solver and in a clause each, the runs that did not end well."""
    found: dict[str, list[str]] = {}
    for row in rows:
        if row.status != "ok":
            seed = "" if row.seed is None else f", seed {row.seed}"
            words = row.label if row.overrides and row.label else "default settings"
            found.setdefault(row.solver, []).append(f"{words}{seed}: {row.reason or row.status}")
    return found
