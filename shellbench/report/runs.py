"""The table of runs: a line for each figure of each run, from which the sections of evidence are made by grouping.

What a row says stands in columns of its own, missing numbers as NaN, so that a section groups, filters and aggregates
with pandas. The row and the record themselves stand in the last columns, for what is in no column: histories, other
quantities, shorter numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import pandas as pd

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.bench.suite import Study
from shellbench.report.solutions import same_but_for_seed, solution_name, variant_name
from shellbench.report.suites import compared, leading_rows, studies_of

GIVEN = ("case", "solver", "quantity", "unit", "status", "label")
GIVEN_NUMBERS = (
    *("value", "uncertainty", "reference", "reference_uncertainty", "relative_error", "absolute_error"),
    *("energy_gap", "seconds", "storage_bytes", "seed"),
)
GIVEN_FLAGS = ("own_case", "primary", "default_settings", "declared")
FLAGS = ("sound", "compared", "leading")
T = TypeVar("T")
COLUMNS = {
    **dict.fromkeys((*GIVEN, "title", "solution", "variant", "alike", "studies", "reason", "run_id"), object),
    **dict.fromkeys((*GIVEN_NUMBERS, "unknowns", "solve_memory_bytes", "floor"), float),
    **dict.fromkeys((*GIVEN_FLAGS, *FLAGS), bool),
    **dict.fromkeys(("row", "record"), object),
}


def table_of_runs(records: Mapping[str, Record], rows: Sequence[Row]) -> pd.DataFrame:
    """Return the table, in the order of the rows.

    Beside what a `shellbench.bench.row.Row` calls so, its columns are

    title, solution, variant
        What a reader calls the case, the solver with its settings, and these settings.
    alike
        What runs have in common that differ in their seed alone.
    studies
        Those that declare the run.
    unknowns, solve_memory_bytes
        Parameters; peak memory less what the process held before the solve.
    floor
        Relative uncertainty of the known value, 0 where there is none.
    sound
        Whether the run ended well.
    compared, leading
        Whether it holds its solver against a known value; and whether it is the solver's own, not a variant's.
    run_id, record
        Empty, and None, of a run that is missing.
    """
    held = compared(rows)
    flags = {"compared": set(map(id, held)), "leading": set(map(id, leading_rows(held)))}
    lines = [
        _line(row, records.get(row.run_id or "")) | {flag: id(row) in rows for flag, rows in flags.items()}
        for row in rows
    ]
    return pd.DataFrame(lines, columns=list(COLUMNS)).astype(COLUMNS)


def _line(row: Row, record: Record | None) -> dict[str, Any]:
    peak, idle = row.peak_memory_bytes, row.idle_memory_bytes
    return {name: getattr(row, name) for name in (*GIVEN, *GIVEN_NUMBERS, *GIVEN_FLAGS)} | {
        "title": row.case_title or row.case,
        "solution": solution_name(row),
        "variant": variant_name(row),
        "alike": same_but_for_seed(row),
        "studies": studies_of(row),
        "reason": row.reason or "",
        "run_id": row.run_id or "",
        "unknowns": row.parameters,
        "solve_memory_bytes": peak - idle if peak and idle and peak > idle else None,
        "floor": (row.reference_uncertainty or 0.0) / abs(row.reference) if row.reference else 0.0,
        "sound": row.status == "ok",
        "row": row,
        "record": record,
    }


def headlines(runs: pd.DataFrame, study: Study | None = None) -> pd.DataFrame:
    """Return the lines of the headline quantities of the suite's own cases, of one study alone if it is given."""
    found = runs[runs["primary"] & ~runs["own_case"]]
    return found if study is None else found[in_study(found, study)]


def in_study(runs: pd.DataFrame, study: Study) -> pd.Series[bool]:
    """Return of which lines a suite of the study declares the run."""
    return runs["studies"].map(lambda studies: study in studies).astype(bool)


def in_order_of_cases(data: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Return lines sorted by columns within each case, the cases as they appear."""
    order = {case: place for place, case in enumerate(data["case"].unique())} if len(data) else {}
    return data.sort_values(
        by=["case", *by], key=lambda one: one.map(order) if one.name == "case" else one, kind="stable"
    )


def groups_alike(items: Iterable[T], size: Callable[[T], float], ratio: float) -> list[tuple[T, ...]]:
    """Split items in order of size into groups of which none is larger than `ratio` times the first."""
    groups: list[list[T]] = []
    for item in items:
        if groups and size(item) <= ratio * size(groups[-1][0]):
            groups[-1].append(item)
        else:
            groups.append([item])
    return [tuple(group) for group in groups]


def run_ids(data: pd.DataFrame) -> tuple[str, ...]:
    """Return the runs of lines whose column `run_ids` names several each."""
    return tuple(" ".join(data["run_ids"]).split())
