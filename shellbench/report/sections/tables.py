"""The tables of the report: displacements in the manner of Kairanda et al. 2023, Table 3; other quantities; resolution.

`render` is what ``shellbench table`` prints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.compare import as_json
from shellbench.bench.judge.row import Row
from shellbench.bench.plugins.kinds import headline_of
from shellbench.report.data.columns import Column, Line, column, in_its_unit, present, significant, solution, words
from shellbench.report.data.evidence import Evidence
from shellbench.report.data.notation import LATEX_NOTATION, TEXT, Notation, allowance, quoted, rounded
from shellbench.report.data.runs import (
    Known,
    compared,
    rows_at_home,
    rows_of,
    seed_words,
    solution_name,
    suite_title,
    suites_of,
)
from shellbench.report.data.section import AND, Section
from shellbench.report.data.solutions import BAD, EXPECTED, comparison, theory_words
from shellbench.report.data.table import Format, Note, Table

DISPLACEMENTS, QUANTITIES = "displacements_", "quantities_"  # how names of tables begin
HEADLINES = "Headline values"  # where there are none


def render(
    rows: Sequence[Row],
    format: Format | Literal["json"],
    known: Known = catalog.known_values,
    whole: bool = False,
    width: int | None = None,
) -> str:
    """Write the rows in a format.

    Parameters
    ----------
    rows
        From `shellbench.bench.judge.compare`.
    format
        "json" is the list of the rows themselves; all others are tables, one for each suite. Those of studies are left
        out unless there are no others.
    known
        Known values by name of case.
    whole
        Whether each suite is shown whole, as it was asked for by name; else each run is shown once.
    width
        Letters of a line of text; as many as the tables need if not given.
    """
    if format == "json":
        return as_json(rows) + "\n"
    tables = displacement_tables(compared(rows) or rows, known, whole=whole)
    if format == "csv":
        return tables_as_csv(tables)
    return "\n".join(table.write(format, width) for table in tables)


def tables_as_csv(tables: Sequence[Table]) -> str:
    """Write tables of the same columns as one CSV."""
    written = [table.write("csv") for table in tables]
    return "".join(text if i == 0 else text.partition("\n")[2] for i, text in enumerate(written))


def displacement_tables(
    rows: Sequence[Row], known: Known = catalog.known_values, *, whole: bool = False
) -> list[Table]:
    """Return a table of the headline quantities for each suite.

    A run that several suites declare is in the table of the first, or in all if suites are shown whole.
    """
    headline = [row for row in rows if row.primary]
    shown = {suite: rows_of(headline, suite) for suite in suites_of(headline)} if whole else rows_at_home(headline)
    tables = []
    for suite, of_suite in shown.items():
        heading = AND.join(dict.fromkeys(headline_of(row.kind, row.unit) for row in of_suite))
        tables.append(replace(comparison_table(DISPLACEMENTS, suite, "", of_suite, known), heading=heading))
    return tables


def displacements(found: Evidence) -> Section:
    """Return the section of headline quantities."""
    tables = displacement_tables(found.compared, found.known, whole=found.whole)
    return Section("displacements", HEADLINES, tables=tuple(tables), place="its suites").retitled()


def quantities(found: Evidence) -> Section:
    """Return the section of all other quantities; a run that several suites declare is in the table of one."""
    homes = rows_at_home([row for row in found.compared if not row.primary])
    title = ": other quantities"
    tables = [comparison_table(QUANTITIES, suite, title, of_suite, found.known) for suite, of_suite in homes.items()]
    return Section("quantities", "Other quantities", tables=tuple(tables), place="its suites")


def comparison_table(begins: str, suite: str, title: str, rows: Sequence[Row], known: Known) -> Table:
    """Return the table of a suite that holds solvers against known values."""
    data = comparison(rows, known)
    theories = dict.fromkeys(theory_words(theory) for theory in data.loc[data["kind"] == "judge", "theory"])
    sources = tuple(dict.fromkeys(source for source in data["source"] if present(source)))
    return Table(
        name=f"{begins}{suite}",
        title=f"{suite_title(suite)}{title}",
        caption=caption(
            list(theories),
            stated=any(line["kind"] == "solver" and present(line["uncertainty"]) for line in data.to_dict("records")),
        ),
        data=data,
        columns=COMPARISON,
        notes=tuple(notes(rows, data.to_dict("records"), known)),
        sources=sources,
        suite=suite,
        spare=SPARE,
    )


def caption(theories: Sequence[str], stated: bool = False) -> str:
    """Say what judges, and how the errors are to be read."""
    sentences = {
        f"Errors are relative to the converged value of {' and '.join(theories)} theory.": bool(theories),
        "Values of other theories or origins are listed for comparison; notes name their theory. A solver's value and"
        " error are means over its seeds, beside the error of its worst seed. Digits in brackets are the uncertainty"
        " of the last digits.": True,
        "Uncertainty is the error estimate of the solver itself, the largest over its seeds.": stated,
        "Unknowns are free parameters or degrees of freedom. Time is wall time of the solve. Memory is the largest"
        " of the solving process.": True,
    }
    return " ".join(sentence for sentence, told in sentences.items() if told)


def notes(rows: Sequence[Row], lines: Sequence[Line], known: Known) -> list[Note]:
    """Return the remarks: what the known values say of themselves, then every run that did not simply pass."""
    titles = {row.case: row.case_title or row.case for row in rows}
    shown = {(line["case"], line["quantity"], line["source"], line["value"]) for line in lines}
    judged_by = {(line["case"], line["quantity"]): line["judged_by"] for line in lines}
    about: dict[tuple[str, str, str], dict[str, None]] = {}
    for case, quantity in dict.fromkeys((row.case, row.quantity) for row in rows if not row.own_case):
        for value in known(case).of(quantity, "literature", "published", "judge"):
            differs = value.theory != judged_by[case, quantity] and value.role != "judge"
            if (value.note or differs) and (case, quantity, value.source, value.value) in shown:
                name = "Converged" if value.role == "judge" else value.label or value.role
                theory = f"{theory_words(value.theory)}; " if differs else ""
                text = f"{theory}{value.origin}. {value.note}".strip()
                about.setdefault((name, text, value.source), {})[titles[case]] = None
    remarks = []
    if any(map(within_doubt, lines)):
        remarks.append(Note("*", "the error is smaller than the uncertainty of the known value"))
    if any(map(fell_short, lines)):
        remarks.append(Note(NOT_CONVERGED, "the solver stopped before it reached its own tolerance"))
    remarks += [
        Note(f"{name} ({'; '.join(dict.fromkeys(of))})", text, source) for (name, text, source), of in about.items()
    ]
    for line in lines:
        if line["kind"] == "solver" and present(line["reason"]):
            remarks.append(Note(f"{titles[line['case']]}, {line['solution']} ({line['verdict']})", line["reason"]))
    about_runs = {(row.case, solution_name(row), row.seed): row for row in rows if row.remark}
    for (case, name, seed), row in about_runs.items():
        remarks.append(Note(f"{titles[case]}, {name}{seed_words(seed)}", row.remark))
    for row in rows:
        if row.reference is None and row.disagreement is not None and row.disagreement_with:
            difference = f"{100 * row.disagreement:+.2g} % from {row.disagreement_with}"
            what = f"{titles[row.case]}, {row.quantity}, {row.solver}{seed_words(row.seed)}"
            remarks.append(Note(what, f"no known value; differs by {difference}"))
    return list(dict.fromkeys(remarks))


def _solution(value: Any, line: Line, notation: Notation) -> str:
    if line["kind"] == "solver":
        return solution(value, line, notation)
    name = notation.escape(value)
    if line["kind"] == "judge":
        name = notation.strong(name)
    if notation not in (TEXT, LATEX_NOTATION):
        return name
    return f"{name} {notation.cite(line['source'])}" if present(line["source"]) else name


def _origin(line: Line, notation: Notation) -> str:
    if line["kind"] == "solver":
        return ""
    told = notation.escape(f"{theory_words(line['theory'])}: {line['origin']}")
    return f"{told} {notation.cite(line['source'])}" if present(line["source"]) else told


def _seeds(value: Any, line: Line, notation: Notation) -> str:
    return f"{int(line['answered'])}/{len(str(value).split())}"


def _value(value: Any, line: Line, notation: Notation) -> str:
    if line["kind"] in ("literature", "published"):
        return notation.number(quoted(value))
    if line["kind"] == "judge":
        uncertainty = line["uncertainty"] if present(line["uncertainty"]) else None
        return notation.strong_number(rounded(value, uncertainty, show_uncertainty=True))
    return notation.number(rounded(value, doubt(line)))


def doubt(line: Line) -> float | None:
    """Return the uncertainty that limits the digits of a solver's value; None if there is none.

    This is the largest of its own uncertainty, its spread over seeds, the known value's uncertainty and a tenth of its
    error.
    """
    doubts = [line[name] for name in ("uncertainty", "spread", "reference_uncertainty") if present(line[name])]
    if present(line["mean_absolute_error"]):
        doubts.append(abs(line["mean_absolute_error"]) / 10)
    return max((float(value) for value in doubts if value > 0), default=None)


def within_doubt(line: Line, which: str = "mean") -> bool:
    """Tell whether a solver's error is smaller than the uncertainty of the known value."""
    error, uncertainty = line[f"{which}_error"], line["reference_uncertainty"]
    if line["kind"] != "solver" or not present(error) or not present(uncertainty):
        return False
    return bool(abs(error * line["reference"]) < uncertainty)


def fell_short(line: Line) -> bool:
    """Tell whether a solver says of its own answer that it did not converge."""
    return bool(line["kind"] == "solver" and present(line["converged"]) and not line["converged"])


def _own_uncertainty(line: Line, notation: Notation) -> str:
    """Write what a solver says of its own error; that it did not converge, if it says so."""
    if line["kind"] != "solver":
        return ""
    stated = line["uncertainty"]
    number = GLANCE(stated, line, notation) if present(stated) and stated > 0 else ""
    short = notation.escape(NOT_CONVERGED) if fell_short(line) else ""
    return " ".join(filter(None, (number, short))) or notation.missing


def _error(which: str, heading: str) -> Column:
    def marked(value: Any, line: Line, notation: Notation) -> str:
        return notation.error(value) + (notation.escape("*") if within_doubt(line, which) else "")

    return column(f"{which}_error", heading, marked, instead=in_its_unit(f"{which}_absolute_error", GLANCE))


def _worst(line: Line, notation: Notation) -> str:
    if line["kind"] != "solver":
        return ""
    several = present(line["answered"]) and line["answered"] > 1
    return WORST.show(line, notation) if several else notation.missing


def _tolerance(value: Any, line: Line, notation: Notation) -> str:
    if line["tolerance_is_absolute"]:
        return f"{notation.number(quoted(value))} {notation.escape(line['unit'])}"
    return notation.number(allowance(value)) + notation.per_cent


def _verdict(value: Any, line: Line, notation: Notation) -> str:
    told = words(value, line, notation)
    return notation.strong(told) if value in (*BAD, EXPECTED) else told


NOT_CONVERGED = "(not converged)"
GLANCE = significant(2)
WORST = _error("worst", "Worst seed")
SPARE = ("Unknowns", "Memory", "Seeds", "Tolerance", "Worst seed", "Uncertainty", "Time (s)")
COMPARISON: tuple[str | Column, ...] = (
    column("solution", way=_solution, right=False),
    Column("Theory, origin and source", _origin, right=False, wide=True),
    column("seeds", way=_seeds),
    column("value", "Value", _value),
    Column("Uncertainty", _own_uncertainty),
    _error("mean", "Error"),
    replace(WORST, show=_worst),
    column("tolerance", "Tolerance", _tolerance),
    column("verdict", "Verdict", _verdict, right=False),
    "parameters",
    "seconds",
    "peak_memory_bytes",
)
