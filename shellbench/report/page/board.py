"""The page of a board: submissions beside each other, by case, and by what an answer of equal error took."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any

from shellbench import __version__
from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.board import Entry, board_as_json
from shellbench.bench.judge.classes import grades
from shellbench.bench.judge.row import Row
from shellbench.errors import InputError
from shellbench.report.data import document
from shellbench.report.data.columns import code, column, frame, present, seconds, words
from shellbench.report.data.notation import HTML
from shellbench.report.data.runs import compared, grouped, same_but_for_seed
from shellbench.report.data.section import Section, given
from shellbench.report.data.solutions import overall
from shellbench.report.data.table import Table
from shellbench.report.page.leaves import WHOLE, Leaf, render_page
from shellbench.report.page.view import page_scripts
from shellbench.report.sections.results import class_words
from shellbench.report.sections.tables import displacement_tables

SITE = "shellbench board"
LEVELS = (1e-2, 1e-3, 1e-4, 1e-5)  # relative errors at which costs are compared
BY_CASE = (
    "Default settings, headline figures, the smallest error first. An error is held against today's known value;"
    " verdicts are those of frozen tolerances, or of class 1e-2 for solvers that have none.",
    "Re-measured: whoever keeps this board has made the runs again, with the same code and settings, and none is"
    " worse by more than 1e-5 of the known value. Differs: one is.",
)
BY_COST = (
    "The least wall time of a submitted run, whatever its settings, whose error is within the given one for every"
    " seed, the uncertainty of the known value added. A dash: no run is.",
    "Seconds compare within one environment only; its number is that of the list below. Between machines they say"
    " little.",
)


def write_board(entries: Sequence[Entry], out: Path) -> Path:
    """Write the page of a board, and `board.json` with all that it shows.

    Returns
    -------
    Path
        The page, ``index.html``.

    Raises
    ------
    InputError
        If the folder can't be written.
    """
    rows = [row for entry in entries for row in entry.rows]
    records = {run_id: record for entry in entries for run_id, record in entry.records.items()}
    makings, environments = document.makings(records, rows)
    numbers = {making.record.run_id: making.environment for making in makings}
    sections = (
        Section("submissions", "Submissions", tables=(submissions_table(entries),)),
        Section("cases", "By case", BY_CASE, tables=tuple(case_tables(entries))),
        Section("cost", "By cost at equal error", BY_COST, tables=given(cost_table(rows, numbers))),
    )
    leaf = Leaf(WHOLE, "", [], [section for section in sections if section.shows])
    facts: dict[str, Any] = {
        "version": __version__,
        "site": SITE,
        "whole": WHOLE,
        "leaves": (),
        "entries": entries,
        "environments": environments,
        "bibliography": document.read_bibliography(catalog.data_folder("references") / document.BIBLIOGRAPHY),
    } | page_scripts({})
    try:
        out.mkdir(parents=True, exist_ok=True)
        document.write(out / "index.html", render_page("board.html.j2", HTML, leaf, facts))
        document.write(out / "board.json", board_as_json(entries))
    except OSError as error:
        raise InputError(f"{out}: the board can't be written ({error.strerror})") from None
    return out / "index.html"


def submissions_table(entries: Sequence[Entry]) -> Table:
    """Return the table of submissions: what each holds, and how much of it was made again."""
    lines = []
    for entry in entries:
        mine = [row for row in entry.rows if row.default_settings]
        unchecked = {entry.name: entry.pack.unchecked}
        (grade,) = grades([row for row in mine if row.reference is not None], [entry.name], unchecked)
        marks = [entry.mark([row.run_id or ""], row.quantity) for row in entry.rows if row.value is not None]
        verdict, cases = overall(mine), {row.case for row in entry.rows}
        asked = cases.union(*({case.name for case in catalog.cases_of(row.suite)} for row in entry.rows if row.suite))
        lines.append(
            {
                "block": "",
                "solver": entry.name,
                "cases": f"{len(cases)} of {len(asked)}",
                "runs": len(entry.records),
                "held": f"{verdict.held} of {verdict.gated}",
                "class": "not checked" if grade.unchecked else f"{class_words(grade.held)}{grade.on}",
                "remeasured": f"{marks.count('yes')} of {len(marks)}"
                + (f", {marks.count('differs')} differ" if "differs" in marks else ""),
                "checksum": entry.pack.manifest.checksum[:12],
            }
        )
    return Table(
        name="submissions",
        title="Submissions",
        caption="Answered cases, of all cases of their suites; gated values that pass, of all that are gated; the"
        " tightest class of relative errors (1e-4, 1e-3, 1e-2) that all judged values at default settings hold; values"
        " that were made again.",
        data=frame(lines),
        columns=(
            "solver",
            column("cases", "Cases", words, right=True),
            "runs",
            column("held", "Gated values", words, right=True),
            column("class", "Class", words, right=True),
            column("remeasured", "Re-measured", words, right=True),
            column("checksum", "Checksum", code),
        ),
    )


def case_tables(entries: Sequence[Entry]) -> list[Table]:
    """Return a table of headline figures for each suite, the best answer of a case first, with marks."""
    rows = [row for entry in entries for row in entry.rows if row.default_settings]
    ordered = sorted(compared(rows), key=_distance(rows))
    by_name = {entry.name: entry for entry in entries}
    tables = []
    for table in displacement_tables(sorted(ordered, key=lambda row: row.case)):
        data = table.data.copy()
        data["remeasured"] = [
            by_name[str(line["solution"])].mark(str(line["run_ids"]).split(), line["quantity"])
            if line["kind"] == "solver" and line["solution"] in by_name
            else ""
            for line in data.to_dict("records")
        ]
        at = table.columns.index("parameters")  # beside the verdict, before what it cost
        columns = (*table.columns[:at], column("remeasured", "Re-measured", words), *table.columns[at:])
        tables.append(replace(table, data=data, columns=columns, heading=""))
    return tables


def _distance(rows: Sequence[Row]) -> Any:
    """Return a key by which rows are ordered: the worst error of the line that they belong to."""
    worst: dict[tuple[object, ...], float] = {}
    for row in rows:
        error = row.judged_error
        size = abs(error) if error is not None and row.status == "ok" else float("inf")
        worst[_line(row)] = max(worst.get(_line(row), 0.0), size)
    return lambda row: worst[_line(row)]


def _line(row: Row) -> tuple[object, ...]:
    return row.case, row.quantity, row.at, same_but_for_seed(row)


def cost_table(rows: Sequence[Row], environments: Mapping[str, int]) -> Table | None:
    """Return the table of what each submission took to be within each of `LEVELS`; None without known values."""
    judged = [row for row in rows if row.primary and row.reference is not None and row.relative_error is not None]
    lines: list[dict[str, Any]] = []
    for title, of_case in sorted(grouped(judged, lambda row: row.case_title or row.case).items()):
        of_solvers = grouped(of_case, lambda row: row.solver)
        found = [_costs(title, name, mine, environments) for name, mine in of_solvers.items()]
        lines += sorted(found, key=lambda line: [line[f"to_{level:g}"] or float("inf") for level in reversed(LEVELS)])
    if not lines:
        return None
    return Table(
        name="cost",
        title="Seconds at equal error",
        caption="Wall time of the solve, s, of the headline figure; the mean over seeds.",
        data=frame(lines),
        columns=(
            "solver",
            *(column(f"to_{level:g}", f"{100 * level:g} %", seconds) for level in LEVELS),
            column("environment", "Environment", words, right=True),
        ),
    )


def _costs(title: str, name: str, rows: Sequence[Row], environments: Mapping[str, int]) -> dict[str, Any]:
    """Return a line: the least seconds of runs that differ in their seed alone, at each level."""
    line: dict[str, Any] = {"block": title, "solver": name}
    used: set[int] = set()
    for level in LEVELS:
        ways = []
        for runs in grouped(rows, same_but_for_seed).values():
            good = all(row.status == "ok" and _within(row, level) and present(row.seconds) for row in runs)
            if good:
                ways.append((fmean(row.seconds or 0.0 for row in runs), runs))
        least, runs = min(ways, key=lambda way: way[0], default=(None, []))
        line[f"to_{level:g}"] = least
        used |= {environments[name] for row in runs if (name := row.run_id or "") in environments}
    return line | {"environment": ", ".join(map(str, sorted(used)))}


def _within(row: Row, level: float) -> bool:
    doubt = (row.reference_uncertainty or 0.0) / abs(row.reference or 1.0)
    return abs(row.relative_error or 0.0) + doubt <= level
