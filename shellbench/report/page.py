"""The report: a folder with one page that stands alone, the same in Markdown, the tables and the figures."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from shellbench import __version__, catalog
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.bench.store import Store
from shellbench.errors import InputError
from shellbench.report.bibliography import Source, read_bibliography
from shellbench.report.derivation import DERIVATION
from shellbench.report.derivation import TITLE as NEWTON_TITLE
from shellbench.report.effort import effort_table
from shellbench.report.exhibits import exhibits
from shellbench.report.fields import field_table
from shellbench.report.motion_exhibits import CLOTH
from shellbench.report.motion_tables import motion_tables
from shellbench.report.newton import newton_table
from shellbench.report.notation import HTML, MARKDOWN, Notation, anchor
from shellbench.report.path_exhibits import CURVE, STATES
from shellbench.report.provenance import environment_words, makings
from shellbench.report.resolution import mesh_table, resolution_table
from shellbench.report.solutions import Known
from shellbench.report.strains import strain_table
from shellbench.report.strains import words as strain_words
from shellbench.report.suites import rows_at_home
from shellbench.report.summary import matrix, overall, shortfalls
from shellbench.report.table import Table
from shellbench.report.tables import displacement_tables, quantity_tables, render, tables_as_csv

BIBLIOGRAPHY = "bibliography.bib"


@dataclass(frozen=True)
class Tables:
    """All tables of a report."""

    displacements: list[Table]
    resolution: list[Table]
    paths: list[Table]
    strains: list[Table]
    quantities: list[Table]
    motions: list[Table]
    newton: list[Table]

    @property
    def printed(self) -> list[Table]:
        """Those that fit a printed page."""
        return [*self.displacements, *self.paths, *self.strains, *self.newton, *self.motions, *self.resolution]

    @property
    def apart(self) -> list[Table]:
        """Those with columns of their own, each a file of its own."""
        return [*self.paths, *self.strains, *self.newton, *self.motions, *self.resolution]

    @property
    def all(self) -> list[Table]:
        """All of them, in the order of the page."""
        return [*self.printed, *self.quantities]


def write_report(
    store: Store,
    rows: Sequence[Row],
    out: Path,
    known: Known = catalog.known_values,
    for_print: bool = True,
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

    Returns
    -------
    Path
        The page, ``index.html``.

    Raises
    ------
    InputError
        If the store can't be read, or `out` is a file or can't be written.
    """
    rows = [row for of_suite in rows_at_home(rows).values() for row in of_suite]
    named = {row.run_id for row in rows}
    by_id = {record.run_id: record for record in store.read().records if record.run_id in named}
    studies = (resolution_table(by_id, rows), mesh_table(by_id, rows), field_table(by_id, rows, store.folder))
    tables = Tables(
        displacements=displacement_tables(rows, known),
        resolution=[table for table in studies if table is not None],
        paths=[table for table in (effort_table(by_id, rows),) if table is not None],
        strains=[table for table in (strain_table(rows),) if table is not None],
        quantities=quantity_tables(rows, known),
        motions=motion_tables(by_id, rows, store.folder),
        newton=[table for table in (newton_table(by_id, rows),) if table is not None],
    )
    try:
        figures = out / "figures"
        shutil.rmtree(figures, ignore_errors=True)
        figures.mkdir(parents=True)
        shown = [(exhibit, exhibit.save(figures, for_print)) for exhibit in exhibits(by_id, rows, store.folder, known)]
        bibliography = catalog.data_folder("references") / BIBLIOGRAPHY
        sources = read_bibliography(bibliography)
        facts = _facts(by_id, rows, tables, sources)
        facts["exhibits"], facts["for_print"] = shown, for_print
        facts |= _cloth(rows, {exhibit.name for exhibit, _ in shown}, tables)
        facts["paths_shown"] = tables.paths or any(exhibit.name.startswith((CURVE, STATES)) for exhibit, _ in shown)
        _write(out / "index.html", _page("page.html.j2", HTML, tables, facts))
        _write(out / "report.md", _page("report.md.j2", MARKDOWN, tables, facts))
        _write(out / "table.csv", tables_as_csv([*tables.displacements, *tables.quantities]))
        _write(out / "table.tex", "\n".join(table.write("latex") for table in tables.printed))
        _write(out / "table.json", render(rows, "json"))
        for table in tables.apart:
            _write(out / f"{table.name}.csv", table.write("csv"))
        if bibliography.is_file():
            shutil.copyfile(bibliography, out / BIBLIOGRAPHY)
    except OSError as error:
        raise InputError(f"{out}: the report can't be written ({error.strerror})") from None
    return out / "index.html"


def _facts(
    records: dict[str, Record], rows: Sequence[Row], tables: Tables, sources: dict[str, Source]
) -> dict[str, Any]:
    made, environments = makings(records, rows)
    cited = dict.fromkeys(source for table in tables.displacements + tables.quantities for source in table.sources)
    return {
        "version": __version__,
        "rows": rows,
        "verdict": overall(rows),
        "short": shortfalls(rows),
        "strain_words": strain_words(rows) if tables.strains else [],
        "newton_title": NEWTON_TITLE,
        "derivation": DERIVATION if tables.newton else (),
        "solvers": {row.solver: row.solver_label for row in rows if row.solver_label},
        "makings": made,
        "environments": [environment_words(environment) for environment in environments],
        "newest": max((record.created for record in records.values()), default=None),
        "sources": [(key, sources.get(key)) for key in cited],
        "downloads": ["report.md", "table.csv", "table.tex", "table.json"]
        + [f"{table.name}.csv" for table in tables.apart]
        + ([BIBLIOGRAPHY] if sources else []),
    }


def _cloth(rows: Sequence[Row], figures: Collection[str], tables: Tables) -> dict[str, Any]:
    """Return the cases of the section on cloth: the title of each, and names of its figures."""
    titles = {row.case: row.case_title or row.case for row in rows}
    names = {case: [name for prefix in CLOTH if (name := f"{prefix}{case}") in figures] for case in titles}
    cases = {case: (titles[case], of_case) for case, of_case in names.items() if of_case}
    return {"cloth": cases, "motions_shown": bool(cases or tables.motions)}


def _page(template: str, notation: Notation, tables: Tables, facts: dict[str, Any]) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("shellbench.report"),
        autoescape=notation is HTML,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"escape_words": notation.escape, "code": notation.code, "anchor": anchor}
    titles, lines = matrix(facts["rows"], notation)
    return environment.get_template(template).render(
        **facts,
        tables=tables,
        written={table.name: table.write("html" if notation is HTML else "markdown") for table in tables.all},
        matrix_titles=titles,
        matrix=lines,
    )


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
