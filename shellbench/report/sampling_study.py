"""The section on sampling: from 5 to 25 points a side (after Kairanda et al., VII), and what too few of them do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report import cells
from shellbench.report.digits import duration, percent
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.notation import TEXT, Notation
from shellbench.report.palette import inks, style
from shellbench.report.sampling_figure import sampling_figure
from shellbench.report.solutions import grouped
from shellbench.report.studies import rows_of_study
from shellbench.report.table import Column, Line, Table

POINTS = "quadrature_points"  # a solver's own count of the points that it was solved on, if it says one
CELLS = "cells"  # or the setting for the grid of its samples, one in each cell


@dataclass(frozen=True)
class Sampled:
    """Runs on one number of points, which differ in their seed alone.

    Attributes
    ----------
    points
        In all; `a_side` is its square root.
    words
        What was held fixed.
    marks
        Of each run the signed relative error, the energy gap (relative, between the points of the solve and a finer
        rule), and whether it ended well; None for what was not measured.
    """

    case: str
    title: str
    solver: str
    words: str
    points: int
    marks: tuple[tuple[float | None, float | None, bool], ...]
    seconds: float
    floor: float
    run_ids: tuple[str, ...]

    @property
    def a_side(self) -> float:
        """Points a side of a square."""
        return math.sqrt(self.points)

    @property
    def errors(self) -> list[float]:
        """Magnitudes of the errors."""
        return [abs(error) for error, _, _ in self.marks if error is not None]

    @property
    def gaps(self) -> list[float]:
        """The energy gaps."""
        return [gap for _, gap, _ in self.marks if gap is not None]

    @property
    def failed(self) -> int:
        """How many of the runs failed."""
        return sum(not sound for _, _, sound in self.marks)


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite studied sampling."""
    found = samplings(evidence.records, evidence.rows)
    if not found:
        return None
    colours = inks(row.solver for row in evidence.rows)
    cases = list(dict.fromkeys(one.case for one in found))
    fixed = "; ".join(dict.fromkeys(f"{one.solver}: {one.words}" for one in found if one.words))
    with style():
        exhibit = Exhibit(
            name="sampling",
            title="Error and energy gap against points a side",
            caption="Error of the headline quantity, and difference of the energy between the points of the solve and a"
            " finer rule, against points a side. A mark is a run, the line the median of the seeds; open marks are runs"
            " that failed, refused for too large a gap if they ended. A gap of a solver that draws its points at"
            f" random measures the noise of its loss as well. Held fixed: {fixed}.",
            description="; ".join(_words(one) for one in found),
            figure=sampling_figure([[one for one in found if one.case == case] for case in cases], colours),
            run_ids=tuple(run_id for one in found for run_id in one.run_ids),
            drawing=True,
        )
    return Section(
        name="sampling",
        title="Sampling",
        words=(
            "How many points a field needs. An optimiser that sees the energy at few points lowers it there and lets"
            " the field go wild between them. Two remedies are compared: to draw the points anew at every iteration,"
            " and to hold the energy against a finer rule at the end and refuse what differs.",
            "A run with too large a gap is refused; it is shown with the value and the gap that it was refused with.",
        ),
        tables=(sampling_table(found),),
        exhibits=(exhibit,),
    )


def samplings(records: Mapping[str, Record], rows: Sequence[Row]) -> list[Sampled]:
    """Return the study's runs by case, solver and points."""
    groups: dict[tuple[str, str, int], list[Row]] = {}
    headline = [row for row in rows_of_study(rows, "sampling") if row.primary and not row.own_case]
    for (case, solver), of_solver in grouped(headline, lambda row: (row.case, row.solver)).items():
        for row in of_solver:
            points = points_of(records.get(row.run_id or ""), row)
            if points is not None:
                groups.setdefault((case, solver, points), []).append(row)
    found = [_sampled(points, alike) for (_, _, points), alike in groups.items()]
    cases = list(dict.fromkeys(one.case for one in found))
    return sorted(found, key=lambda one: (cases.index(one.case), one.solver, one.points))


def points_of(record: Record | None, row: Row) -> int | None:
    """Return on how many points a run was solved; None if neither its record nor its settings say it."""
    counted = record.diagnostics.get(POINTS) if record is not None else None
    if isinstance(counted, int):
        return counted
    match row.settings.get(CELLS):
        case [int(first), int(second)]:
            return first * second
    return None


def _sampled(points: int, alike: Sequence[Row]) -> Sampled:
    first = alike[0]
    return Sampled(
        case=first.case,
        title=first.case_title or first.case,
        solver=first.solver,
        words=first.label.rpartition(", ")[0],
        points=points,
        marks=tuple((_finite(row.relative_error), _finite(row.energy_gap), row.status == "ok") for row in alike),
        seconds=sum(row.seconds or 0.0 for row in alike) / len(alike),
        floor=(first.reference_uncertainty or 0.0) / abs(first.reference) if first.reference else 0.0,
        run_ids=tuple(row.run_id or "" for row in alike),
    )


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def sampling_table(found: Sequence[Sampled]) -> Table:
    """Return the table of points, errors and gaps."""
    lines: list[dict[str, Any]] = [
        {
            "block": one.title,
            "case": one.case,
            "solver": one.solver,
            "held_fixed": one.words,
            "points": one.points,
            "a_side": one.a_side,
            "runs": len(one.marks),
            "failed": one.failed,
            "least_error": min(one.errors, default=None),
            "largest_error": max(one.errors, default=None),
            "least_gap": min(one.gaps, default=None),
            "largest_gap": max(one.gaps, default=None),
            "seconds": one.seconds,
            "run_ids": " ".join(one.run_ids),
        }
        for one in found
    ]
    return Table(
        name="sampling",
        title="Points, error and energy gap",
        caption="Magnitude of the headline quantity's error and of the energy gap between the points of the solve and a"
        " finer rule, least and largest of the seeds; how many runs failed; mean wall time of the solve.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solver", lambda line, notation: notation.code(line["solver"]), right=False),
            Column("Held fixed", lambda line, notation: notation.escape(line["held_fixed"]), right=False),
            Column("Points a side", lambda line, notation: f"{line['a_side']:.3g}"),
            Column("Least error", cells.share("least_error")),
            Column("Largest error", cells.share("largest_error")),
            Column("Least gap", cells.share("least_gap")),
            Column("Largest gap", cells.share("largest_gap")),
            Column("Failed", _failed),
            Column("Time (s)", lambda line, notation: notation.escape(duration(line["seconds"]))),
        ),
    )


def _failed(line: Line, notation: Notation) -> str:
    failed, runs = int(line["failed"]), int(line["runs"])
    return notation.strong(f"{failed} of {runs}") if failed else f"0 of {runs}"


def _words(one: Sampled) -> str:
    error = f"error up to {TEXT.number(percent(max(one.errors), signed=False))} %" if one.errors else "no value"
    failed = f", {one.failed} of {len(one.marks)} failed" if one.failed else ""
    return f"{one.title}, {one.solver}, {one.a_side:.3g} points a side: {error}{failed}"
