"""The report: a folder with a page for each suite and a start page, the same in Markdown, tables and figures."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jinja2

from shellbench import __version__
from shellbench.bench import catalog
from shellbench.bench.compare import beyond
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.bench.store import Say, Store, silent
from shellbench.errors import InputError
from shellbench.report.bibliography import Source, read_bibliography
from shellbench.report.contents import Tables, tables_of
from shellbench.report.derivation import DERIVATION
from shellbench.report.derivation import TITLE as NEWTON_TITLE
from shellbench.report.evidence import Evidence, Section
from shellbench.report.exhibit import Exhibit, data_uri, save_all
from shellbench.report.exhibits import PICTURE, exhibits
from shellbench.report.leaves import Leaf, leaves_of
from shellbench.report.motion_exhibits import CLOTH
from shellbench.report.notation import HTML, MARKDOWN, Notation, anchor
from shellbench.report.own_files import list_own, remove_older
from shellbench.report.path_exhibits import CURVE, STATES
from shellbench.report.provenance import Making, environment_words, makings
from shellbench.report.sections import sections as evidence_sections
from shellbench.report.solutions import Known
from shellbench.report.strains import findings
from shellbench.report.suites import compared, rows_at_home, told_apart
from shellbench.report.summary import matrix, overall, shortfalls
from shellbench.report.table import Table
from shellbench.report.tables import render, tables_as_csv
from shellbench.report.view import View, led_by, views
from shellbench.report.view_data import palettes_json, view_json
from shellbench.report.view_page import LIBRARY, scripts

BIBLIOGRAPHY = "bibliography.bib"
REPORT_COMMAND = "shellbench report"
WHOLE = "report"  # name of what is no page of a suite


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
        From `shellbench.bench.compare`; missing runs may be among them.
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
    stored = store.records_of({row.run_id for row in rows}, say)
    rows, by_id = told_apart(rows, stored)
    rows = [row for of_suite in rows_at_home(rows).values() for row in of_suite]
    shown = compared(rows)
    found = Evidence(by_id, rows, store.folder, known)
    sections = evidence_sections(found)
    tables = tables_of(found, sections, whole=whole)
    drawn = exhibits(by_id, shown, store.folder, known)
    turned = {case: led_by(one, picture_run(drawn, case)) for case, one in views(by_id, shown, store.folder).items()}
    proven = [exhibit for section in sections for exhibit in section.exhibits]
    leaves = leaves_of(shown, tables, drawn, sections)
    try:
        figures = out / "figures"
        remove_older(out)
        figures.mkdir(parents=True, exist_ok=True)
        uris = save_all([*drawn, *proven], figures, for_print)
        bibliography = catalog.data_folder("references") / BIBLIOGRAPHY
        facts = _facts(stored, rows, tables, sections, read_bibliography(bibliography))
        facts |= {
            "made_by": _made_by(facts["makings"], [*drawn, *proven], turned),
            "uris": uris,
            "for_print": for_print,
            "beyond": "" if whole else beyond(rows),
            "leaves": leaves,
            "verdicts": {leaf.name: overall(leaf.rows) for leaf in leaves},
        }
        library = scripts(viewing=True).library if turned else ""
        for leaf in leaves:
            _write(out / leaf.file, _page("leaf.html.j2", HTML, leaf, facts | _of_leaf(leaf, turned, facts)))
        whole_report = Leaf(WHOLE, "", list(shown), tables, drawn, list(sections))
        _write(out / "index.html", _page("index.html.j2", HTML, whole_report, facts | _scripts({})))
        _write(out / "report.md", _page("report.md.j2", MARKDOWN, whole_report, facts | _paths_shown(whole_report)))
        if library:
            _write(out / LIBRARY, library)
        _write(out / "table.csv", tables_as_csv([*tables.displacements, *tables.quantities]))
        _write(out / "table.tex", "\n".join(table.write("latex") for table in tables.printed))
        _write(out / "table.json", render(rows, "json"))
        for table in (*tables.apart, *(table for section in sections for table in section.details)):
            _write(out / f"{table.name}.csv", table.write("csv"))
        if bibliography.is_file():
            shutil.copyfile(bibliography, out / BIBLIOGRAPHY)
        names = [exhibit.name for exhibit in (*drawn, *proven)]
        files = [figures / f"{name}.{suffix}" for name in names for suffix in ("pdf", "png", "svg")]
        pages = ["index.html", LIBRARY, *(leaf.file for leaf in leaves)]
        list_own(out, [*(out / name for name in (*pages, *facts["downloads"])), *files])
    except OSError as error:
        raise InputError(f"{out}: the report can't be written ({error.strerror})") from None
    return out / "index.html"


def picture_run(drawn: Sequence[Exhibit], case: str) -> str:
    """Return the run that the still picture of a case shows; empty if there is none."""
    runs = (exhibit.run_ids for exhibit in drawn if exhibit.name == f"{PICTURE}{case}")
    return next(iter(next(runs, ())), "")


def _facts(
    records: dict[str, Record],
    rows: Sequence[Row],
    tables: Tables,
    sections: Sequence[Section],
    sources: dict[str, Source],
) -> dict[str, Any]:
    made, environments = makings(records, rows)
    shown = compared(rows)
    return {
        "version": __version__,
        "verdict": overall(shown),
        "strain_words": findings(shown) if tables.strains else [],
        "newton_title": NEWTON_TITLE,
        "derivation": DERIVATION,
        "report_command": REPORT_COMMAND,
        "solvers": _labels(rows),
        "makings": made,
        "environments": [environment_words(environment) for environment in environments],
        "newest": _newest(records.values()),
        "bibliography": sources,
        "downloads": ["report.md", "table.csv", "table.tex", "table.json"]
        + [f"{table.name}.csv" for table in tables.apart]
        + [f"{table.name}.csv" for section in sections for table in section.details]
        + ([BIBLIOGRAPHY] if sources else []),
    }


def _labels(rows: Sequence[Row]) -> dict[str, str]:
    return {row.solver: row.solver_label for row in rows if row.solver_label}


def _newest(records: Collection[Record]) -> str | None:
    return _minute(max(records, key=lambda record: record.order).created) if records else None


def _minute(created: str) -> str:
    """Say a moment to the minute."""
    return datetime.fromisoformat(created).astimezone(UTC).strftime("%Y-%m-%d %H:%M UTC")


def _made_by(made: Sequence[Making], drawn: Sequence[Exhibit], turned: Mapping[str, View]) -> dict[str, list[Making]]:
    """Return how each figure was made, with the view that may take its place."""
    by_run = {making.record.run_id: making for making in made}
    seen = {f"{PICTURE}{case}": [answer.run_id for answer in one.answers] for case, one in turned.items()}
    shown = {exhibit.name: dict.fromkeys([*exhibit.run_ids, *seen.get(exhibit.name, ())]) for exhibit in drawn}
    return {name: [by_run[run_id] for run_id in run_ids if run_id in by_run] for name, run_ids in shown.items()}


def _of_leaf(leaf: Leaf, turned: Mapping[str, View], facts: Mapping[str, Any]) -> dict[str, Any]:
    pictures = {exhibit.name for exhibit in leaf.exhibits}
    on_page = {case: one for case, one in turned.items() if f"{PICTURE}{case}" in pictures}
    return {"verdict": facts["verdicts"][leaf.name]} | _paths_shown(leaf) | _cloth(leaf) | _scripts(on_page)


def _paths_shown(leaf: Leaf) -> dict[str, Any]:
    curves = any(exhibit.name.startswith((CURVE, STATES)) for exhibit in leaf.exhibits)
    return {"paths_shown": bool(leaf.tables.paths) or curves}


def _scripts(turned: Mapping[str, View]) -> dict[str, Any]:
    """Return the views by the name of the picture that each takes the place of, and what runs in the page."""
    run = scripts(viewing=bool(turned))
    return {
        "views": {f"{PICTURE}{case}": view_json(one) for case, one in turned.items()},
        "dense": any(answer.density is not None for one in turned.values() for answer in one.answers),
        "palettes": palettes_json(),
        "scripts": run.inline,
        "library": LIBRARY if turned else "",
        "script_hashes": run.hashes,
    }


def _cloth(leaf: Leaf) -> dict[str, Any]:
    """Return the cases of the section on cloth: the title of each, and names of its figures."""
    figures = {exhibit.name for exhibit in leaf.exhibits}
    names = {case: [name for prefix in CLOTH if (name := f"{prefix}{case}") in figures] for case in leaf.cases}
    cases = {case: (leaf.cases[case], of_case) for case, of_case in names.items() if of_case}
    return {"cloth": cases, "motions_shown": bool(cases or leaf.tables.motions)}


def _page(template: str, notation: Notation, leaf: Leaf, facts: dict[str, Any]) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("shellbench.report"),
        autoescape=notation is HTML,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"escape_words": notation.escape, "code": notation.code, "anchor": anchor}
    tables = [*leaf.tables.all, *(table for section in leaf.sections for table in section.tables)]
    shown = {table.name: table for table in tables}.values()
    titles, lines = matrix(leaf.rows, notation)
    cited = dict.fromkeys(source for table in shown for source in table.cited)
    on_index = template.startswith("index")
    apart = {"solvers": _labels(leaf.rows)} if leaf.name != WHOLE else {}
    return environment.get_template(template).render(
        **facts | apart,
        leaf=leaf,
        tables=leaf.tables,
        sections=leaf.sections,
        exhibits=leaf.exhibits,
        short=shortfalls(leaf.rows),
        sources=[(key, facts["bibliography"].get(key)) for key in cited],
        files={table.name: _table_files(table) for table in shown} if notation is HTML and not on_index else {},
        written={} if on_index else {t.name: t.write("html" if notation is HTML else "markdown") for t in shown},
        matrix_solvers=[solver for solver, _ in lines],
        matrix=[(title, [cells[case] for _, cells in lines]) for case, title in enumerate(titles)] if lines else [],
    )


def _table_files(table: Table) -> dict[str, str]:
    """Return links that hold a table's files, so that the page keeps them wherever it is moved."""
    return {
        "csv": data_uri("text/csv;charset=utf-8", table.write("csv").encode()),
        "tex": data_uri("text/x-tex;charset=utf-8", table.write("latex").encode()),
    }


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
