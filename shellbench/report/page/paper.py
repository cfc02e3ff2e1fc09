r"""The report for a paper: each table a file for ``\input``, each figure a PDF, and a document that shows them all.

What stands here is what the page shows. A caption says its theory and cites its sources, so that a table can be taken
into another document as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from shellbench import __version__
from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record, portrait_of
from shellbench.bench.store.store import Say, Store, silent
from shellbench.errors import InputError
from shellbench.report.data import document
from shellbench.report.data.columns import present
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.exhibit import PRINT_DPI, Exhibit, style
from shellbench.report.data.notation import LATEX_NOTATION
from shellbench.report.data.runs import Known, is_graded
from shellbench.report.data.section import Section, all_tables
from shellbench.report.data.solutions import overall, theory_words
from shellbench.report.data.table import PACKAGES, Table, with_letters_of_latex
from shellbench.report.page.sections import gather

DOCUMENT = "paper.tex"
MARKUP = {"block": ("<%", "%>"), "variable": ("<<", ">>"), "comment": ("<#", "#>")}  # braces are LaTeX's
OWN = "shellbench"  # source of known values that were computed here, by independent programs
OWN_ENTRY = f"""@misc{{{OWN},
  title = {{shellbench {__version__}}},
  note  = {{Computed for this suite by a program of its own; see its folders references and derivations}},
}}
"""
LINE_INCHES = 17 / 2.54  # of the document
ERROR, REFERENCE = "error", "reference"  # how columns end that hold figures against known values


def write_paper(
    store: Store,
    rows: Sequence[Row],
    out: Path,
    known: Known = catalog.known_values,
    whole: bool = False,
    say: Say = silent,
) -> Path:
    """Write tables, figures, bibliography and the document that shows them.

    Parameters are those of `shellbench.report.page.page.write_report`; in `out`, tables and figures have folders of
    their own. Returns the document, ``paper.tex``.

    Raises
    ------
    InputError
        If the store can't be read, or `out` is a file or can't be written.
    """
    found, records, sections = gather(store, rows, known, whole, say)
    chapters = [
        section.with_each(lambda table: _stated(table, found), lambda exhibit: exhibit.film is None)
        for section in sections
    ]
    try:
        document.remove_older(out)
        for name in ("tables", "figures"):
            (out / name).mkdir(parents=True, exist_ok=True)
        tables = {out / "tables" / f"{table.name}.tex": table for table in all_tables(chapters)}
        for path, table in tables.items():
            document.write(path, table.write("latex"))
        drawn = [exhibit for chapter in chapters for exhibit in chapter.all_exhibits]
        for exhibit in drawn:
            _draw(exhibit, out / "figures")
        bibliography = catalog.data_folder("references") / document.BIBLIOGRAPHY
        given = bibliography.read_text(encoding="utf-8") if bibliography.is_file() else ""
        own = "" if OWN in document.read_bibliography(bibliography) else OWN_ENTRY
        document.write(out / document.BIBLIOGRAPHY, "\n".join(part for part in (given, own) if part))
        document.write(out / DOCUMENT, _document(chapters, records, found))
        figures = [out / "figures" / f"{exhibit.name}.pdf" for exhibit in drawn]
        document.list_own(out, [*tables, *figures, out / document.BIBLIOGRAPHY, out / DOCUMENT])
    except OSError as error:
        raise InputError(f"{out}: the paper can't be written ({error.strerror})") from None
    return out / DOCUMENT


def _draw(exhibit: Exhibit, folder: Path) -> None:
    with style():
        path = folder / f"{exhibit.name}.pdf"
        exhibit.figure.savefig(path, format="pdf", dpi=PRINT_DPI, metadata={"CreationDate": None})


def _stated(table: Table, found: Evidence) -> Table:
    """Return the table with a caption that says what theory its cases ask for, and whose figures judge them."""
    cases = list(dict.fromkeys(map(str, table.data["case"]))) if "case" in table.data else []
    theories = dict.fromkeys(
        theory_words(case.theory)
        for record in found.records.values()
        if record.case_name in cases and (case := portrait_of(record)) is not None
    )
    unsaid = [theory for theory in theories if theory not in table.caption]
    caption = f"{table.caption} Theory: {' and '.join(unsaid)}." if unsaid else table.caption
    judged = any(str(name).endswith((ERROR, REFERENCE)) for name in table.data.columns)
    values = (value for case in cases for value in found.known(case).values if value.role == "judge" and judged)
    sources = table.sources or tuple(dict.fromkeys(value.source for value in values if present(value.source)))
    return replace(table, caption=caption, sources=sources)


def _document(chapters: Sequence[Section], records: Mapping[str, Record], found: Evidence) -> str:
    made, environments = document.makings(records, found.rows)
    environment = document.templates(
        autoescape=False,
        keep_trailing_newline=True,
        **{f"{what}_start_string": start for what, (start, _) in MARKUP.items()},
        **{f"{what}_end_string": end for what, (_, end) in MARKUP.items()},
    )
    environment.filters["words"] = LATEX_NOTATION.escape
    facts: dict[str, Any] = {
        "version": __version__,
        "packages": PACKAGES,
        "line_inches": LINE_INCHES,
        "verdict": overall([row for row in found.compared if not is_graded(row)]).words,
        "chapters": chapters,
        "environments": environments,
        "commands": dict.fromkeys(making.command for making in made),
        "cited": any(table.cited for table in all_tables(chapters)),
    }
    return with_letters_of_latex(environment.get_template("paper.tex.j2").render(facts))
