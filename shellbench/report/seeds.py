"""The section on seeds: how far apart the answers of one solver are that differ in nothing but their random numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report import cells
from shellbench.report.digits import percent, rounded
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.notation import TEXT, Notation
from shellbench.report.palette import inks, style
from shellbench.report.seed_figure import seed_figure
from shellbench.report.solutions import grouped, same_but_for_seed, solution_name
from shellbench.report.studies import studies_of
from shellbench.report.suites import rows_at_home, suite_title
from shellbench.report.table import Column, Line, Note, Table
from shellbench.report.yardstick import Yardstick, known_yardstick


@dataclass(frozen=True)
class SeedSpread:
    """The headline values of runs that differ in their seed alone.

    Attributes
    ----------
    values
        Of the runs that ended well, in the order of `seeds`.
    studied
        Whether it is part of a study alone, rather than of a comparison of solvers.
    asked
        How many runs there are, failed ones counted.
    known
        The known value that errors are relative to, or None.
    """

    case: str
    title: str
    solver: str
    solution: str
    unit: str
    studied: bool
    with_defaults: bool
    seeds: tuple[int, ...]
    values: tuple[float, ...]
    asked: int
    known: Yardstick | None
    run_ids: tuple[str, ...]

    @property
    def mean(self) -> float:
        """Mean of the values, in `unit`."""
        return float(np.mean(self.values))

    @property
    def deviation(self) -> float:
        """Sample standard deviation (of n - 1), in `unit`."""
        return float(np.std(self.values, ddof=1))

    @property
    def scale(self) -> float:
        """What differences are relative to, positive: that of the known value, or the mean where there is none."""
        return self.known.scale if self.known is not None else abs(self.mean)

    @property
    def reference(self) -> float | None:
        """The known value."""
        return None if self.known is None else self.known.value

    @property
    def floor(self) -> float:
        """Relative uncertainty of the known value."""
        return 0.0 if self.known is None else self.known.floor

    @property
    def largest_from_mean(self) -> float:
        """Largest distance of a value from the mean, relative."""
        return float(np.max(np.abs(np.asarray(self.values) - self.mean))) / self.scale

    @property
    def errors(self) -> tuple[float, ...]:
        """Signed relative errors; from the mean where no value is known."""
        centre = self.mean if self.reference is None else self.reference
        return tuple((value - centre) / self.scale for value in self.values)

    @property
    def worst(self) -> int:
        """Seed of the largest error."""
        return self.seeds[int(np.argmax(np.abs(self.errors)))]


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no solver answered a case with two seeds."""
    found = seed_spreads(evidence.records, evidence.rows)
    if not found:
        return None
    colours = inks(row.solver for row in evidence.rows)
    shown: dict[str, list[SeedSpread]] = {}
    homes = rows_at_home([row for row in evidence.rows if row.primary])
    home = {row.run_id: suite for suite, rows in homes.items() for row in rows}
    for spread in found:
        if spread.with_defaults:
            shown.setdefault(home.get(spread.run_ids[0], ""), []).append(spread)
    with style():
        exhibits = tuple(
            Exhibit(
                name=f"seeds_{suite}" if suite else "seeds",
                title=f"{suite_title(suite)}: seeds" if suite else "Seeds",
                caption="Relative error of the headline quantity for each seed, default settings; a mark is a run."
                " Shaded: the uncertainty of the known value, below which errors can't be told apart. Where no value is"
                " known (marked with a dagger) the distance from the mean of the seeds.",
                description="; ".join(
                    f"{spread.title}, {spread.solution}: largest {TEXT.number(percent(max(spread.errors, key=abs)))} %"
                    for spread in of_suite
                ),
                figure=seed_figure(of_suite, colours),
                run_ids=tuple(run_id for spread in of_suite for run_id in spread.run_ids),
                drawing=True,
            )
            for suite, of_suite in shown.items()
        )
    return Section(
        name="seeds",
        title="Spread over seeds",
        words=(
            "A field starts from random numbers. These are the answers of runs that differ in nothing else: if they"
            " lie apart, no single one is the solver's answer, and the worst seed is what a user may get.",
        ),
        tables=_tables(found, studied=False),
        exhibits=exhibits,
        details=_tables(found, studied=True),
    )


def _tables(found: Sequence[SeedSpread], studied: bool) -> tuple[Table, ...]:
    """Return the table of the spreads in studies, or of the others, if there are any."""
    kind = [spread for spread in found if spread.studied is studied]
    return (seed_table(kind, studied),) if kind else ()


def seed_spreads(records: Mapping[str, Record], rows: Sequence[Row]) -> list[SeedSpread]:
    """Return the spread of each case and solver of which two seeds or more ended well."""
    found = []
    headline = [row for row in rows if row.primary and row.seed is not None]
    for alike in grouped(headline, lambda row: (row.case, row.own_case, same_but_for_seed(row))).values():
        runs = list({row.run_id or f"{i}": row for i, row in enumerate(alike)}.values())
        good = [row for row in runs if row.status == "ok" and row.value is not None and math.isfinite(row.value)]
        if len(good) < 2 or not np.mean([row.value for row in good]):
            continue
        first = good[0]
        found.append(
            SeedSpread(
                case=first.case,
                title=first.case_title or first.case,
                solver=first.solver,
                solution=solution_name(first),
                unit=first.unit,
                studied=not first.default_settings and bool(studies_of(first)),
                with_defaults=first.default_settings and not first.own_case,
                seeds=tuple(row.seed or 0 for row in good),
                values=tuple(row.value or 0.0 for row in good),
                asked=len(runs),
                known=known_yardstick(records, good),
                run_ids=tuple(row.run_id or "" for row in good),
            )
        )
    order = list(dict.fromkeys(spread.case for spread in found))
    return sorted(
        found,
        key=lambda spread: (order.index(spread.case), spread.studied, naturally(spread.solution)),
    )


def naturally(words: str) -> list[tuple[int, str]]:
    """Return a key that sorts words with numbers in them by the numbers."""
    parts = re.split(r"(\d+)", words)
    return [(int(part), "") if part.isdigit() else (0, part) for part in parts]


def seed_table(found: Sequence[SeedSpread], studied: bool = False) -> Table:
    """Return the table of spreads of runs that compare solvers, or of those that are `studied` at many sizes."""
    lines: list[dict[str, Any]] = [
        {
            "block": f"{spread.title} ({spread.unit})" if spread.unit else spread.title,
            "case": spread.case,
            "solution": spread.solution,
            "seeds": " ".join(map(str, spread.seeds)),
            "answered": len(spread.values),
            "asked": spread.asked,
            "mean": spread.mean,
            "standard_deviation": spread.deviation,
            "relative_standard_deviation": spread.deviation / spread.scale,
            "largest_from_mean": spread.largest_from_mean,
            "mean_error": float(np.mean(spread.errors)) if spread.reference is not None else None,
            "largest_error": max(spread.errors, key=abs) if spread.reference is not None else None,
            "worst_seed": spread.worst,
            "reference": spread.reference,
            "run_ids": " ".join(spread.run_ids),
        }
        for spread in found
    ]
    lost = [spread for spread in found if len(spread.values) < spread.asked]
    return Table(
        name="seeds_studied" if studied else "seeds",
        title="Spread over seeds in studies" if studied else "Spread over seeds",
        caption="Mean and sample standard deviation of the headline quantity over seeds; the standard deviation and"
        " the largest distance from the mean relative to the known value, or to the mean where none is known; mean and"
        " largest error against the known value, and the seed that has the largest. Those of a position are relative to"
        " the extent of the shell. Runs that failed are not in these"
        " figures.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solution", cells.solution, right=False),
            Column("Seeds", _seeds),
            Column("Mean", _mean),
            Column("Standard deviation", cells.share("relative_standard_deviation")),
            Column("Largest from mean", cells.share("largest_from_mean")),
            Column("Mean error", cells.error("mean_error")),
            Column("Largest error", cells.error("largest_error")),
            Column("Worst seed", lambda line, notation: str(line["worst_seed"])),
        ),
        notes=tuple(
            Note(f"{spread.title}, {spread.solution}", f"{spread.asked - len(spread.values)} of {spread.asked} failed.")
            for spread in lost
        ),
    )


def _seeds(line: Line, notation: Notation) -> str:
    answered, asked = int(line["answered"]), int(line["asked"])
    return str(asked) if answered == asked else notation.strong(f"{answered} of {asked}")


def _mean(line: Line, notation: Notation) -> str:
    return notation.number(rounded(line["mean"], line["standard_deviation"] or None))
