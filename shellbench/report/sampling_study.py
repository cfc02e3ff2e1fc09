"""The section on sampling: from 5 to 25 points a side (after Kairanda et al., VII), and what too few of them do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report.columns import Column, Line, column, share
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit
from shellbench.report.notation import TEXT, Notation, percent
from shellbench.report.panel import ERROR_LABEL, SMALLEST, add_legend, draw, entry, failed_entry, finish, open_figure
from shellbench.report.runs import headlines, in_order_of_cases
from shellbench.report.shells import plain
from shellbench.report.table import Table

POINTS = "quadrature_points"  # a solver's own count of the points that it was solved on, if it says one
CELLS = "cells"  # or the setting for the grid of its samples, one in each cell
WIDTH, HEIGHT, MARGIN = 3.2, 1.9, 0.7  # inches of a panel, and of the legend


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no suite studied sampling."""
    runs = sampled_runs(evidence)
    if runs.empty:
        return None
    table = sampling_table(runs)
    lines = list(table.data.to_dict("records"))
    fixed = "; ".join(dict.fromkeys(f"{one['solver']}: {one['held_fixed']}" for one in lines if one["held_fixed"]))
    exhibit = Exhibit(
        name="sampling",
        title="Error and energy gap against points a side",
        caption="Error of the headline quantity, and difference of the energy between the points of the solve and a"
        " finer rule, against points a side. A mark is a run, the line the median of the seeds; open marks are runs"
        " that failed, refused for too large a gap if they ended. A gap of a solver that draws its points at"
        f" random measures the noise of its loss as well. Held fixed: {fixed}.",
        description="; ".join(map(_words, lines)),
        figure=sampling_figure(runs, evidence),
        run_ids=tuple(runs["run_id"]),
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
        tables=(table,),
        exhibits=(exhibit,),
    )


def sampled_runs(evidence: Evidence) -> pd.DataFrame:
    """Return the study's runs by case, solver and points, with the points in all and a side of a square."""
    runs = headlines(evidence.runs, "sampling")
    points = pd.Series([points_of(one.record, one.row) for one in runs.itertuples()], runs.index, dtype=float)
    runs = runs.assign(points=points, a_side=np.sqrt(points), error=runs["relative_error"].abs())
    runs = runs.replace({"error": {math.inf: math.nan}, "energy_gap": {math.inf: math.nan, -math.inf: math.nan}})
    return in_order_of_cases(runs[points.notna()], ["solver", "points"])


def points_of(record: Record | None, row: Row) -> int | None:
    """Return on how many points a run was solved; None if neither its record nor its settings say it."""
    counted = record.diagnostics.get(POINTS) if record is not None else None
    if isinstance(counted, int):
        return counted
    match row.settings.get(CELLS):
        case [int(first), int(second)]:
            return first * second
    return None


def sampling_table(runs: pd.DataFrame) -> Table:
    """Return the table of points, errors and gaps, a line for runs that differ in their seed alone."""
    groups = runs.groupby(["case", "solver", "points"], sort=False)
    data = groups.agg(
        block=("title", "first"),
        held_fixed=("label", lambda labels: labels.iloc[0].rpartition(", ")[0]),
        a_side=("a_side", "first"),
        runs=("sound", "size"),
        failed=("sound", lambda sound: int((~sound).sum())),
        least_error=("error", "min"),
        largest_error=("error", "max"),
        least_gap=("energy_gap", "min"),
        largest_gap=("energy_gap", "max"),
        seconds=("seconds", lambda seconds: seconds.fillna(0.0).mean()),
        run_ids=("run_id", " ".join),
    ).reset_index()
    data["points"] = data["points"].astype(int)
    order = ["block", "case", "solver", "held_fixed", "points"]
    return Table(
        name="sampling",
        title="Points, error and energy gap",
        caption="Magnitude of the headline quantity's error and of the energy gap between the points of the solve and a"
        " finer rule, least and largest of the seeds; how many runs failed; mean wall time of the solve.",
        data=data[[*order, *data.columns.difference(order, sort=False)]],
        columns=(
            "solver",
            Column("Held fixed", lambda line, notation: notation.escape(line["held_fixed"]), right=False),
            column("a_side", "Points a side", lambda points, line, notation: f"{points:.3g}"),
            column("least_error", "Least error", share),
            column("largest_error", way=share),
            column("least_gap", "Least gap", share),
            column("largest_gap", "Largest gap", share),
            Column("Failed", _failed),
            "seconds",
        ),
    )


def _failed(line: Line, notation: Notation) -> str:
    failed, runs = int(line["failed"]), int(line["runs"])
    return notation.strong(f"{failed} of {runs}") if failed else f"0 of {runs}"


def _words(line: dict[str, Any]) -> str:
    largest = line["largest_error"]
    error = f"error up to {TEXT.number(percent(largest, signed=False))} %" if largest == largest else "no value"
    failed = f", {line['failed']} of {line['runs']} failed" if line["failed"] else ""
    return f"{line['block']}, {line['solver']}, {line['a_side']:.3g} points a side: {error}{failed}"


def sampling_figure(runs: pd.DataFrame, evidence: Evidence) -> Figure:
    """Draw error above and gap below, a column for each case; all seeds, and failed runs among them."""
    cases = runs.groupby("case", sort=False)
    size = max(4.2, WIDTH * len(cases)), 2 * HEIGHT + MARGIN
    figure, panels = open_figure(size, 2, len(cases), sharey="row", sharex=True)
    for (_, of_case), pair in zip(cases, panels.T, strict=True):
        for axes, measure in zip(pair, ("error", "energy_gap"), strict=True):
            shown = of_case.assign(height=100 * of_case[measure].abs().clip(lower=SMALLEST)).dropna(subset="height")
            for solver, marks in shown.groupby("solver", sort=False):
                ink, middle = evidence.inks[solver], marks.groupby("a_side")["height"].median()
                axes.plot(middle.index, middle, color=ink.colour, linewidth=1.0, alpha=0.8)
                for sound, of_kind in marks.groupby("sound"):
                    draw(axes, of_kind["a_side"], of_kind["height"], ink, "none", hollow=not sound, zorder=3)
    finish(panels[0], y=ERROR_LABEL, floor=list(100 * cases["floor"].max()), log="y")
    finish(panels[1], y="energy gap (%)", log="y")
    for axes, title in zip(panels[0], cases["title"].first(), strict=True):
        axes.set_title(plain(title), loc="left")
    for axes in panels[1]:
        axes.set_xlabel("points a side")
        axes.set_xticks(sorted(set(runs["a_side"].round().astype(int))))
    entries = {solver: entry(evidence.inks[solver]) for solver in runs["solver"].unique()}
    add_legend(figure, entries | failed_entry(not runs["sound"].all()))
    return figure
