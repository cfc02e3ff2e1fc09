"""Clothing: how far skinned meshes are from the simulation, by method and by split, and where each is worst.

Of problems whose portrait says that their worst mesh is kept; their quantities are columns, whatever they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import portrait_of
from shellbench.report.data.columns import Column, Line, column, frame, present, significant
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit
from shellbench.report.data.fields import kept_arrays
from shellbench.report.data.notation import Notation, plain, rounded
from shellbench.report.data.runs import grouped, solution_name
from shellbench.report.data.section import Section, failures, given
from shellbench.report.data.table import Table
from shellbench.report.figures.shells import Camera, Shell, shapes_figure

WORST = "worst_"  # how names of figures begin
CAMERA = Camera(12.0, 60.0)  # from behind, where a cape is
IN_A_ROW = 5
FIGURES = 3  # digits of a value
MILLI = 1e3
SPREAD = "_spread"  # ends the name of a column with the standard deviation over seeds


def section(found: Evidence) -> Section | None:
    """Return the section of clothing; None if there is none."""
    kept = _kept(found)
    rows = [row for row in found.rows if row.case in kept]
    if not rows:
        return None
    suites = dict.fromkeys(row.suite for row in rows if row.suite in catalog.suite_names())
    words = tuple(words for suite in suites for words in catalog.find_suite(str(suite)).remarks)
    tables = given(by_split(rows), by_method(found, rows))
    return Section("clothing", "Clothing", words, tables, tuple(worst_exhibits(found, rows, kept)), place="its suites")


def _kept(found: Evidence) -> dict[str, tuple[str, str]]:
    """Return by case the names of the arrays of its worst mesh."""
    records = {row.case: found.records.get(row.run_id or "") for row in found.rows if row.run_id}
    portraits = {case: portrait_of(record) for case, record in records.items() if record is not None}
    return {case: one.worst for case, one in portraits.items() if one is not None and one.worst is not None}


def _mean_and_spread(rows: Sequence[Row]) -> tuple[float | None, float | None]:
    """Return mean and sample standard deviation of the values of runs that differ in their seed."""
    values = [row.value for row in rows if row.value is not None and row.status in ("ok", "not settled")]
    mean = float(np.mean(values)) if values else None
    return mean, float(np.std(values, ddof=1)) if len(values) > 1 else None


def _value(name: str, heading: str, unit: str, spreads: bool = True) -> Column:
    """Return a column of means, and the spread over seeds if wanted; metres are written as millimetres."""
    scale, shown_unit = (MILLI, "mm") if unit == "m" else (1.0, unit)

    def written(value: Any, line: Line, notation: Notation) -> str:
        shown = significant(FIGURES)(scale * value, line, notation)
        spread: Any = line.get(name + SPREAD)
        if not (spreads and present(spread)):
            return shown
        return f"{shown} ± {notation.number(rounded(scale * spread, scale * spread / 9 or None))}"

    return column(name, heading, written, unit=shown_unit)


def by_split(rows: Sequence[Row]) -> Table | None:
    """Return the headline figure of each method, the cases side by side; None of one case."""
    headline = [row for row in rows if row.primary]
    cases = {row.case: row.case_title or row.case for row in headline}
    lines = []
    for name, alike in grouped(headline, solution_name).items():
        line: dict[str, Any] = {"block": "", "case": next(iter(cases)), "solution": name}
        for case, of_case in grouped(alike, lambda row: row.case).items():
            line[case], line[case + SPREAD] = _mean_and_spread(of_case)
        lines.append(line)
    unit = headline[0].unit if headline else ""
    return None if len(cases) < 2 else Table(
        name="clothing_splits",
        title="Held-out figures, split by split",
        caption=f"{headline[0].description or headline[0].quantity}, and its standard deviation over seeds.",
        data=frame(lines),
        columns=("solution", *(_value(case, title, unit) for case, title in cases.items())),
        suite=headline[0].suite or "",
    )  # fmt: skip


def by_method(found: Evidence, rows: Sequence[Row]) -> Table:
    """Return all figures of each method, with what it cost."""
    quantities = {row.quantity: (row.quantity.replace("_", " "), row.unit) for row in rows}
    headline = {row.quantity for row in rows if row.primary}
    lines = []
    for (case, name), alike in grouped(rows, lambda row: (row.case, solution_name(row))).items():
        record = next((found.records[one] for row in alike if (one := row.run_id or "") in found.records), None)
        line: dict[str, Any] = {"block": alike[0].case_title or case, "case": case, "solution": name}
        line["seeds"] = len({row.run_id for row in alike if row.run_id})
        for quantity, of_quantity in grouped(alike, lambda row: row.quantity).items():
            line[quantity], line[quantity + SPREAD] = _mean_and_spread(of_quantity)
        if record is not None:
            line["seconds"] = record.history[-1].seconds if record.history else record.seconds
            line["parameters"] = record.parameters
        line["headline"] = next((line[row.quantity] for row in alike if row.primary), None)
        lines.append(line)
    lines.sort(key=lambda line: (line["case"], line["headline"] is None, line["headline"]))  # the best first
    return Table(
        name="clothing",
        title="Skinning by method",
        caption="Means over seeds, and the standard deviation of the first figure. Time is that of fitting"
        " or training, with the first seed; unknowns are all numbers that were fitted, modes among them.",
        data=frame(lines),
        columns=(
            "solution",
            "seeds",
            *(_value(name, *each, name in headline) for name, each in quantities.items()),
            "seconds",
            "parameters",
        ),
        notes=failures(found.runs[found.runs["case"].isin({row.case for row in rows})]),
    )


def worst_exhibits(found: Evidence, rows: Sequence[Row], kept: dict[str, tuple[str, str]]) -> Iterator[Exhibit]:
    """Yield for each case a picture of the worst frame of each method, by the lowest seed."""
    for case, of_case in grouped([row for row in rows if row.primary], lambda row: row.case).items():
        shells = []
        for name, alike in grouped(of_case, solution_name).items():
            row = min(alike, key=lambda row: row.seed or 0)
            record = found.records.get(row.run_id or "")
            meshes = None if record is None else kept_arrays(record, found.folder, *kept[case])
            if meshes is not None:
                truth, skinned = meshes
                title = row.case_title or case
                shells.append(Shell(case, title, name, truth, skinned - truth, 1.0, CAMERA, run_id=row.run_id or ""))
        if not shells:
            continue
        bands = [shells[first : first + IN_A_ROW] for first in range(0, len(shells), IN_A_ROW)]
        figure = shapes_figure(bands, [_in_lines(shell.solver) for shell in shells])
        figure.axes[-1].set_xlabel("distance from the simulation (m)", fontsize=7.5)
        yield Exhibit(
            name=f"{WORST}{case}",
            title=f"{shells[0].title}: worst frames",
            caption="The held-out frame on which each method is worst, from behind: its mesh, coloured by the distance"
            " of each vertex from the simulation, which is the light wire.",
            description="; ".join(f"{shell.solver}: up to {shell.coloured.max():.3g} m" for shell in shells),
            figure=figure,
            run_ids=tuple(shell.run_id for shell in shells),
            drawing=False,
        )


def _in_lines(name: str) -> str:
    return plain(name).replace(", ", "\n")
