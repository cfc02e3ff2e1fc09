"""The table of runs: a line for each figure of each run, from which the sections of evidence are made by grouping.

What a row says stands in columns of its own, missing numbers as NaN, so that a section groups, filters and aggregates
with pandas. The row and the record themselves stand in the last columns, for what is in no column: histories, other
quantities, shorter numbers.

A row is shown under a suite, those with gates first, so that each figure is drawn once. A suite says what it studies,
and its runs are shown where that is.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import pandas as pd

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValues
from shellbench.bench.catalogue.suite import Study
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record
from shellbench.errors import InputError
from shellbench.protocol.schema import LONGEST_TITLE

OWN = "own_"  # begins the name of a user's own case that would else be mistaken for one of the suite's
NO_SUITE = "other"  # for runs that no suite declares
GIVEN = ("case", "solver", "quantity", "unit", "status", "label")
GIVEN_NUMBERS = (
    *("value", "uncertainty", "reference", "reference_uncertainty", "relative_error", "absolute_error"),
    *("energy_gap", "seconds", "storage_bytes", "seed"),
)
GIVEN_FLAGS = ("own_case", "primary", "default_settings", "declared")
FLAGS = ("sound", "compared", "leading")
Known = Callable[[str], KnownValues]
R = TypeVar("R")
T = TypeVar("T")
COLUMNS = {
    **dict.fromkeys((*GIVEN, "title", "solution", "variant", "alike", "studies", "reason", "run_id"), object),
    **dict.fromkeys((*GIVEN_NUMBERS, "unknowns", "solve_memory_bytes", "floor"), float),
    **dict.fromkeys((*GIVEN_FLAGS, *FLAGS), bool),
    **dict.fromkeys(("row", "record"), object),
}


def solution_name(row: Row) -> str:
    """Return the name of a table's line: the solver, and the settings that are no defaults."""
    return f"{row.solver}, {variant}" if (variant := variant_name(row)) else row.solver


def variant_name(row: Row) -> str:
    """Return the settings of a run that are no defaults, or the name that a suite gives them."""
    settings = ", ".join(f"{key}={value}" for key, value in row.overrides.items())
    return (row.label or settings) if settings else ""


def seed_words(seed: int | None) -> str:
    """Return a seed as the end of a run's name; nothing if the run has none."""
    return "" if seed is None else f", seed {seed}"


def same_but_for_seed(row: Row) -> str:
    """Return the key by which runs share a line of a table.

    Settings that are not at their defaults tell lines apart, not all settings: a run that is missing has no others.
    """
    return json.dumps([row.solver, row.overrides, row.device, row.dtype], sort_keys=True, default=str)


def grouped(found: Iterable[R], key: Callable[[R], T]) -> dict[T, list[R]]:
    """Return rows or records by a key, in order of appearance."""
    groups: dict[T, list[R]] = {}
    for one in found:
        groups.setdefault(key(one), []).append(one)
    return groups


def studies_of(row: Row) -> set[Study]:
    """Return the studies that declare the run of a row; none where its suites compare solvers.

    A run that no suite declares belongs to all suites of its case, but is part of no study.
    """
    found = {study_of(suite) for suite in row.suites} if row.declared else set()
    return {study for study in found if study is not None}


def study_of(suite: str) -> Study | None:
    """Return the study that a suite belongs to; None if it compares solvers or is not in the catalog."""
    try:
        return catalog.find_suite(suite).study
    except InputError:
        return None


def rows_of_study(rows: Sequence[Row], study: Study) -> list[Row]:
    """Return the rows of runs that a suite of this study declares."""
    return [row for row in rows if study in studies_of(row)]


def remarks_on(rows: Sequence[Row], study: Study) -> tuple[str, ...]:
    """Return the remarks of all suites of a study that the rows belong to."""
    suites = dict.fromkeys(
        suite for row in rows_of_study(rows, study) for suite in row.suites if study_of(suite) == study
    )
    return tuple(words for suite in suites for words in catalog.find_suite(suite).remarks)


def is_study(suite: str) -> bool:
    """Tell whether a suite studies something else than how right solvers are."""
    return study_of(suite) is not None


def compared(rows: Sequence[Row]) -> list[Row]:
    """Return the rows that hold solvers against known values.

    Those of studies alone are evidence of other things, unless a gate judges them.
    """
    return [row for row in rows if not row.suites or _judged(row) or not all(map(is_study, row.suites))]


def _judged(row: Row) -> bool:
    return row.passed is not None and row.default_settings and not row.label


def is_graded(row: Row) -> bool:
    """Tell whether a row is judged by a class: its solver has no frozen tolerances."""
    return row.default_settings and not row.own_case and row.solver not in catalog.tolerances()


def told_apart(rows: Sequence[Row], records: Mapping[str, Record] | None = None) -> tuple[list[Row], dict[str, Record]]:
    """Return rows and records, a user's own case that has the name of one of the suite's under another name."""
    names = set(catalog.case_names())
    apart = [
        row.model_copy(update={"case": OWN + row.case, "case_title": f"{row.case_title or row.case} (own case)"})
        if row.own_case and row.case in names
        else row
        for row in rows
    ]
    titles = {row.run_id: row.case_title for row in apart if row.own_case and row.case_title}
    renamed = dict(records or {})
    for run_id, record in renamed.items():
        update: dict[str, Any] = {}
        if record.own_case and record.case_name in names:
            update["case_name"] = OWN + record.case_name
        if run_id in titles:
            update["case"] = record.case | {"title": titles[run_id][:LONGEST_TITLE]}
        renamed[run_id] = record.model_copy(update=update) if update else record
    return apart, renamed


def shown_under(row: Row) -> tuple[str, ...]:
    """Return the suites under which a row is shown: no studies, unless it belongs to no other."""
    suites = row.suites or (row.suite or NO_SUITE,)
    return tuple(suite for suite in suites if not is_study(suite)) or suites


def suites_of(rows: Sequence[Row]) -> list[str]:
    """Return the suites of the rows: the one with most gated rows first, those of equal weight as they appear."""
    weight: dict[str, int] = {}
    for row in rows:
        for suite in shown_under(row):
            weight[suite] = weight.get(suite, 0) + (row.passed is not None or row.open_finding is not None)
    return sorted(weight, key=lambda suite: -weight[suite])


def rows_of(rows: Sequence[Row], suite: str) -> list[Row]:
    """Return the rows of all runs that a suite declares, in the suite's order of cases."""
    order = catalog.find_suite(suite).order if suite in catalog.suite_names() else ()
    found = [row for row in rows if suite in shown_under(row)]
    return sorted(found, key=lambda row: order.index(row.case) if row.case in order else len(order))


def rows_at_home(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return each row once, under the first of its suites, in the suites' order of cases."""
    homes = {suite: [r for r in rows_of(rows, suite) if shown_under(r)[0] == suite] for suite in suites_of(rows)}
    return {suite: of_suite for suite, of_suite in homes.items() if of_suite}


def leading_rows(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of each solver's own runs of a case: with default settings, or else those that a suite declares.

    A recipe that takes hours is declared with fewer iterations, and has no run with its defaults.
    """
    own = {(row.case, row.own_case, row.solver) for row in rows if row.default_settings}
    return [
        row
        for row in rows
        if row.default_settings or (row.declared and (row.case, row.own_case, row.solver) not in own)
    ]


def suite_title(suite: str) -> str:
    """Return the title of a suite of the catalog; of any other its name."""
    if suite in catalog.suite_names():
        return catalog.find_suite(suite).title
    return suite.replace("_", " ").capitalize()


def table_of_runs(records: Mapping[str, Record], rows: Sequence[Row]) -> pd.DataFrame:
    """Return the table, in the order of the rows.

    Beside what a `shellbench.bench.judge.row.Row` calls so, its columns are

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
