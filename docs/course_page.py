"""Tables of three findings, from kept runs: `python -m docs.course_page` writes them.

docs/findings/course.md is made of reports/course/table.json, the rows of one run of the obstacle course, and of
reports/resolution.json, the kept summary of its runs at many resolutions; the second table is left out while there is
none. docs/findings/large_displacements.md and docs/findings/cloth.md are made of reports/example/table.json.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from docs.studies_page import table
from shellbench.bench.catalogue import catalog
from shellbench.report.data.kept_data import KeptRun, Summary, read_summary, sweeps_of
from shellbench.report.data.notation import byte_size, duration, rounded
from shellbench.report.data.runs import grouped

ROOT = Path(__file__).parents[1]
FINDINGS = ROOT / "docs/findings"
PAGE = FINDINGS / "course.md"
SUITE = "obstacle_course"
SOLVERS = {"fem": "elements", "ndf-ritz": "field", "ndf": "field, trained"}
TWINS = ("naghdi", "naghdi_soft")
LEVELS = (1e-3, 1e-4)  # errors at which sizes are compared
Row = Mapping[str, Any]


def headline_rows(folder: str, suite: str) -> list[Row]:
    """Return the headline rows of a suite by default settings, without variants."""
    rows = json.loads((ROOT / "reports" / folder / "table.json").read_bytes())
    return [
        row
        for row in rows
        if suite in row["suites"] and row["primary"] and row["default_settings"] and not row.get("variant")
    ]


def title(case: str) -> str:
    """Return the name of a case in a table: its title."""
    return catalog.named_case(case).title


def beside() -> list[str]:
    """Return error, seconds and memory of elements and fields with default settings, a shell a row."""
    rows = headline_rows("course", SUITE)
    heads = ["shell", *(f"`{solver}` ({kind})" for solver, kind in SOLVERS.items())]
    cases = [case for case in catalog.find_suite(SUITE).order if any(row["case"] == case for row in rows)]
    return table(heads, ([title(case), *(cell(rows, case, solver) for solver in SOLVERS)] for case in cases))


def limits() -> list[str]:
    """Return the limits of the shells at rest in both theories, with hard and with soft supports."""
    lines = []
    for case in (catalog.named_case(name) for name in catalog.find_suite(SUITE).order):
        if case.theory == "kirchhoff-love-linear":
            found = [title(case.name)]
            asked = ((case.name, case.theory), *((f"{case.name}@{twin}", "naghdi-linear") for twin in TWINS))
            for name, theory in asked:
                judge = catalog.known_values(name).judge(case.primary.name, theory)
                digits = rounded(judge.value, judge.uncertainty or 0.0) if judge else None
                found.append(
                    f"{digits.mantissa}{f'e{digits.exponent}' if digits.exponent else ''} m" if digits else "none"
                )
            lines.append(found)
    return table(["shell", "Kirchhoff-Love", "Naghdi, hard supports", "Naghdi, soft supports"], lines)


def large_displacements() -> list[str]:
    """Return known value, error and seconds of the shells at finite strain."""
    return of_example("nonlinear", ("fem", "ndf", "ndf-ritz"))


def motions() -> list[str]:
    """Return known value, error and seconds of the cloth in motion and of the sleeves."""
    return of_example("cloth", ("fem", "ndf"))


def of_example(suite: str, solvers: tuple[str, ...]) -> list[str]:
    """Return the known value of each case of a suite of the example, and error and seconds of the solvers."""
    rows = headline_rows("example", suite)
    first = {row["case"]: row for row in reversed(rows)}
    lines = (
        [asked(first[case]), known(first[case]), *(cell(rows, case, solver, memory=False) for solver in solvers)]
        for case in catalog.find_suite(suite).order
        if case in first
    )
    return table(["case: quantity", "known value", *(f"`{solver}`" for solver in solvers)], lines)


def asked(row: Row) -> str:
    """Return the case and the quantity of a row."""
    return f"{row['case_title']}: {row['description']}"


def known(row: Row) -> str:
    """Return the known value of a row with its certain digits, and its unit."""
    digits = rounded(row["reference"], row["reference_uncertainty"])
    return f"{digits.mantissa}{f'e{digits.exponent}' if digits.exponent else ''} {row['unit']}"


def cell(rows: list[Row], case: str, solver: str, memory: bool = True) -> str:
    """Return the worst error, the longest time and, if asked, the largest memory of a solver's seeds."""
    found = [row for row in rows if (row["case"], row["solver"]) == (case, solver)]
    if not found:
        return "not run"
    if any(row["value"] is None for row in found):
        return found[0]["status"]
    if any(row.get("relative_error") is None for row in found):
        error = f"{max(abs(row['absolute_error'] or 0.0) for row in found):.2g} {found[0].get('unit', '')}"
    else:
        error = f"{100 * max(abs(row['relative_error']) for row in found):.2g} %"
    error = error.replace("e-0", "e-")
    seconds = f"{error}, {duration(max(row['seconds'] for row in found))} s"
    return f"{seconds}, {byte_size(max(row['peak_memory_bytes'] for row in found))}" if memory else seconds


def at_equal_error() -> list[str]:
    """Return the fewest bytes and seconds of kept runs at stated errors, a shell a row; nothing without a summary."""
    if (summary := read_summary()) is None:
        return []
    solvers = [*SOLVERS, *sorted({run.solver for run in summary.runs} - set(SOLVERS))]
    order = [case for case in catalog.find_suite(SUITE).order if case in summary.cases]
    rows = (
        [f"{title(case)}, {100 * level:g} %", *(cheapest(summary, case, solver, level) for solver in solvers)]
        for case in order
        for level in LEVELS
    )
    made = (
        "Fewest bytes of a solution whose headline is within the error, and the seconds of that solve. All finer runs of its"
        " sweep are within the error, too. Each run has one fixed size and no refinement."
        f" Kept runs of commit {summary.made.commit[:12]}; compare seconds within one table only."
    )
    return [made, "", *table(["shell, error", *(f"`{solver}`" for solver in solvers)], rows)]


def cheapest(summary: Summary, case: str, solver: str, level: float) -> str:
    """Return bytes and seconds of the run that takes the fewest bytes, or that there is none."""
    best = cheapest_run(summary, case, solver, level)
    if best is None:
        return "not reached" if any((run.case, run.solver) == (case, solver) for run in summary.runs) else "not run"
    return f"{byte_size(best.storage or 0)}, {duration(best.seconds or 0.0)} s"


def cheapest_run(summary: Summary, case: str, solver: str, level: float) -> KeptRun | None:
    """Return the run of fewest bytes among sizes from which on all runs of a sweep are within a level; None if none is."""
    found = []
    runs = [run for run in summary.runs if (run.case, run.solver) == (case, solver)]
    for sweep in sweeps_of(runs).values():
        lasting: list[KeptRun] = []
        for alike in reversed(grouped(sweep, lambda run: run.label).values()):
            if any(run.error is None or run.error > level for run in alike):
                break
            lasting = alike
        found += [run for run in lasting if run.storage is not None]
    return min(found, key=lambda run: run.storage or 0, default=None)


TABLES = {
    PAGE: (beside, limits, at_equal_error),
    FINDINGS / "large_displacements.md": (large_displacements,),
    FINDINGS / "cloth.md": (motions,),
}


def main() -> None:
    """Write the tables into their pages."""
    for page, tables in TABLES.items():
        text = page.read_text(encoding="utf-8")
        for make in tables:
            made = "\n".join(make())
            part = re.compile(rf"(<!-- table {make.__name__} -->\n).*?(<!-- end -->)", re.DOTALL)
            text = part.sub(lambda found, made=made: f"{found[1]}\n{made}\n\n{found[2]}", text)
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
