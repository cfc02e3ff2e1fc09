"""The tables of docs/findings/course.md that set elements beside fields: `python -m docs.course_page` writes them.

They are made of reports/course/table.json, the rows of one run of the obstacle course, and of reports/resolution.json,
the kept summary of its runs at many resolutions; the second table is left out while there is none.
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
from shellbench.report.data.notation import byte_size, duration
from shellbench.report.data.runs import grouped

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/findings/course.md"
SUITE = "obstacle_course"
SOLVERS = {"fem": "elements", "ndf-ritz": "field", "ndf": "field, trained"}
LEVELS = (1e-3, 1e-4)  # errors at which sizes are compared
Row = Mapping[str, Any]


def course_rows() -> list[Row]:
    """Return the headline rows of the course itself, without variants."""
    rows = json.loads((ROOT / "reports/course/table.json").read_bytes())
    return [row for row in rows if SUITE in row["suites"] and row["primary"] and not row.get("variant")]


def title(case: str) -> str:
    """Return the name of a case in a table: its title."""
    return catalog.named_case(case).title


def beside() -> list[str]:
    """Return error, seconds and memory of elements and fields with default settings, a shell a row."""
    rows = course_rows()
    heads = ["shell", *(f"`{solver}` ({kind})" for solver, kind in SOLVERS.items())]
    cases = [case for case in catalog.find_suite(SUITE).order if any(row["case"] == case for row in rows)]
    return table(heads, ([title(case), *(cell(rows, case, solver) for solver in SOLVERS)] for case in cases))


def cell(rows: list[Row], case: str, solver: str) -> str:
    """Return the worst error, the longest time and the largest memory of a solver's seeds."""
    found = [row for row in rows if (row["case"], row["solver"]) == (case, solver)]
    if not found:
        return "not run"
    if any(row["value"] is None for row in found):
        return found[0]["status"]
    if any(row["relative_error"] is None for row in found):
        error = f"{max(abs(row['absolute_error'] or 0.0) for row in found):.2g} {found[0].get('unit', '')}"
    else:
        error = f"{100 * max(abs(row['relative_error']) for row in found):.2g} %".replace("e-0", "e-")
    seconds, memory = (max(row[name] for row in found) for name in ("seconds", "peak_memory_bytes"))
    return f"{error}, {duration(seconds)} s, {byte_size(memory)}"


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
        "Fewest bytes that keep a solution within an error, in all finer runs of its sweep too, and the seconds of that"
        f" solve: kept runs of commit {summary.made.commit[:12]}, {summary.made.date}."
    )
    return [made, "", *table(["shell, error", *(f"`{solver}`" for solver in solvers)], rows)]


def cheapest(summary: Summary, case: str, solver: str, level: float) -> str:
    """Return bytes and seconds of the coarsest size from which on all runs of its sweep are within a level."""
    found = []
    runs = [run for run in summary.runs if (run.case, run.solver) == (case, solver)]
    for sweep in sweeps_of(runs).values():
        lasting: list[KeptRun] = []
        for alike in reversed(grouped(sweep, lambda run: run.label).values()):
            if any(run.error is None or run.error > level for run in alike):
                break
            lasting = alike
        found += [run for run in lasting if run.storage is not None]
    if not found:
        return "not reached" if runs else "not run"
    best = min(found, key=lambda run: run.storage or 0)
    return f"{byte_size(best.storage or 0)}, {duration(best.seconds or 0.0)} s"


TABLES = {one.__name__: one for one in (beside, at_equal_error)}


def main() -> None:
    """Write the tables into the page."""
    text = PAGE.read_text(encoding="utf-8")
    for name, make in TABLES.items():
        made = "\n".join(make())
        part = re.compile(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        text = part.sub(lambda found, made=made: f"{found[1]}\n{made}\n\n{found[2]}", text)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
