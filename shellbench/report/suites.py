"""Which suite a row is shown under: suites with gates first, and each figure drawn once.

Which rows belong to a study: a suite says what it studies, and its runs are shown where that is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from shellbench.bench import catalog
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.bench.suite import Study
from shellbench.model import LONGEST_TITLE


def studies_of(row: Row) -> set[Study]:
    """Return the studies that declare the run of a row; none where its suites compare solvers.

    A run that no suite declares belongs to all suites of its case, but is part of no study.
    """
    found = {study_of(suite) for suite in row.suites} if row.declared else set()
    return {study for study in found if study is not None}


def study_of(suite: str) -> Study | None:
    """Return what a suite studies; None if it compares solvers, or is none of the catalog."""
    return catalog.find_suite(suite).study if suite in catalog.suite_names() else None


def rows_of_study(rows: Sequence[Row], study: Study) -> list[Row]:
    """Return the rows of runs that a suite of this study declares."""
    return [row for row in rows if study in studies_of(row)]


def remarks_on(rows: Sequence[Row], study: Study) -> tuple[str, ...]:
    """Return what the suites of a study that the rows belong to say of their solvers and cases."""
    suites = dict.fromkeys(
        suite for row in rows_of_study(rows, study) for suite in row.suites if study_of(suite) == study
    )
    return tuple(words for suite in suites for words in catalog.find_suite(suite).remarks)


OWN = "own_"  # begins the name of a user's own case that would else be mistaken for one of the suite's
NO_SUITE = "other"  # for runs that no suite declares


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
