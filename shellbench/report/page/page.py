"""The report: a folder with a page for each suite and a start page, the same in Markdown, tables and figures."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from shellbench import __version__
from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.compare import missing_runs
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import Say, Store, silent
from shellbench.errors import InputError
from shellbench.report.data import document
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import Exhibit, save_all
from shellbench.report.data.notation import HTML, MARKDOWN
from shellbench.report.data.runs import Known, is_graded
from shellbench.report.data.section import Section, all_tables
from shellbench.report.data.solutions import overall
from shellbench.report.data.table import Table
from shellbench.report.figures.pictures import PICTURE
from shellbench.report.page.leaves import WHOLE, Leaf, leaves_of, render_page
from shellbench.report.page.sections import gather
from shellbench.report.page.view import LIBRARY, View, library, page_scripts, views
from shellbench.report.sections.results import unchecked
from shellbench.report.sections.tables import DISPLACEMENTS, QUANTITIES, render, tables_as_csv

REPORT_COMMAND = "shellbench report"
SITE = "shellbench report"  # what its pages are titled
TOGETHER = (DISPLACEMENTS, QUANTITIES)  # tables with the same columns, in one CSV


def write_report(
    store: Store,
    rows: Sequence[Row],
    out: Path,
    known: Known = catalog.known_values,
    for_print: bool = True,
    say: Say = silent,
    whole: bool = False,
) -> Path:
    """Write the report.

    Parameters
    ----------
    store
        Holds the records that the rows refer to, and their files.
    rows
        From `shellbench.bench.judge.compare`; missing runs may be among them.
    out
        Folder to write; made if need be, files of an older report are replaced.
    known
        Known values by name of case.
    for_print
        Whether figures are written as PDF too.
    say
        Takes a sentence for each file of a run that is damaged.
    whole
        Whether each suite is shown whole, as it was asked for by name; else each run is shown once.

    Returns
    -------
    Path
        The start page, ``index.html``.

    Raises
    ------
    InputError
        If the store can't be read, or `out` is a file or can't be written.
    """
    found, stored, sections = gather(store, rows, known, whole, say)
    shown, drawn = found.compared, [exhibit for section in sections for exhibit in section.all_exhibits]
    turned = views(found, pictured_runs(drawn))
    leaves = leaves_of(shown, sections)
    try:
        figures = out / "figures"
        document.remove_older(out)
        figures.mkdir(parents=True, exist_ok=True)
        uris = save_all(drawn, figures, for_print)
        facts = _facts(stored, found, sections) | {
            "uris": uris,
            "for_print": for_print,
            "beyond": "" if whole else missing_runs(found.rows),
            "leaves": leaves,
            "unchecked": unchecked(store, found),
        }
        facts["made_by"] = _made_by(facts["makings"], drawn, turned)
        for leaf in leaves:
            on_page = {one.name.removeprefix(PICTURE) for one in leaf.exhibits if one.name.startswith(PICTURE)}
            viewed = page_scripts({case: one for case, one in turned.items() if case in on_page})
            of_leaf = {"solvers": _labels(leaf.rows)} | viewed
            document.write(out / leaf.file, render_page("leaf.html.j2", HTML, leaf, facts | of_leaf))
        report = Leaf(WHOLE, "", shown, sections)
        document.write(out / "index.html", render_page("index.html.j2", HTML, report, facts | page_scripts({})))
        document.write(out / "report.md", render_page("report.md.j2", MARKDOWN, report, facts))
        if turned:
            document.write(out / LIBRARY, library())
        tables = all_tables(sections)
        document.write(out / "table.csv", tables_as_csv([one for one in tables if one.name.startswith(TOGETHER)]))
        printed = [one for one in tables if not one.name.startswith(QUANTITIES)]
        document.write(out / "table.tex", "\n".join(table.write("latex") for table in printed))
        document.write(out / "table.json", render(found.rows, "json"))
        for table in _separate_tables(sections):
            document.write(out / f"{table.name}.csv", table.write("csv"))
        if facts["bibliography"]:
            shutil.copyfile(catalog.data_folder("references") / document.BIBLIOGRAPHY, out / document.BIBLIOGRAPHY)
        files = [figures / f"{exhibit.name}.{suffix}" for exhibit in drawn for suffix in ("pdf", "png", "svg", "gif")]
        pages = ["index.html", LIBRARY, *(leaf.file for leaf in leaves)]
        document.list_own(out, [*(out / name for name in (*pages, *facts["downloads"])), *files])
    except OSError as error:
        raise InputError(f"{out}: the report can't be written ({error.strerror})") from None
    return out / "index.html"


def _separate_tables(sections: Sequence[Section]) -> list[Table]:
    """Return the tables with columns of their own, each a file of its own."""
    details = [table for section in sections for table in section.details]
    return [*(table for table in all_tables(sections) if not table.name.startswith(TOGETHER)), *details]


def pictured_runs(drawn: Sequence[Exhibit]) -> dict[str, str]:
    """Return the run that the still picture of each case shows."""
    pictures = (exhibit for exhibit in drawn if exhibit.name.startswith(PICTURE))
    return {exhibit.name.removeprefix(PICTURE): exhibit.run_ids[0] for exhibit in pictures if exhibit.run_ids}


def _facts(records: Mapping[str, Record], found: Evidence, sections: Sequence[Section]) -> dict[str, Any]:
    made, environments = document.makings(records, found.rows)
    sources = document.read_bibliography(catalog.data_folder("references") / document.BIBLIOGRAPHY)
    return {
        "version": __version__,
        "site": SITE,
        "whole": WHOLE,
        "verdict": overall([row for row in found.compared if not is_graded(row)]),
        "report_command": REPORT_COMMAND,
        "solvers": _labels(found.rows),
        "makings": made,
        "environments": environments,
        "exam": document.exam_words(),
        "newest": _newest(records.values()),
        "bibliography": sources,
        "downloads": ["report.md", "table.csv", "table.tex", "table.json"]
        + [f"{table.name}.csv" for table in _separate_tables(sections)]
        + ([document.BIBLIOGRAPHY] if sources else []),
    }


def _labels(rows: Sequence[Row]) -> dict[str, str]:
    return {row.solver: row.solver_label for row in rows if row.solver_label}


def _newest(records: Collection[Record]) -> str:
    """Say to the minute when the newest record was made; nothing if there is none."""
    if not records:
        return ""
    newest = datetime.fromisoformat(max(records, key=lambda record: record.order).created)
    return newest.astimezone(UTC).strftime("%Y-%m-%d %H:%M UTC")


def _made_by(
    made: Sequence[document.Making], drawn: Sequence[Exhibit], turned: Mapping[str, View]
) -> dict[str, list[document.Making]]:
    """Return the makings of the runs of each figure, including the runs of the view that may replace it."""
    by_run = {making.record.run_id: making for making in made}
    seen = {f"{PICTURE}{case}": one.run_ids for case, one in turned.items()}
    shown = {exhibit.name: dict.fromkeys([*exhibit.run_ids, *seen.get(exhibit.name, ())]) for exhibit in drawn}
    return {name: [by_run[run_id] for run_id in run_ids if run_id in by_run] for name, run_ids in shown.items()}
