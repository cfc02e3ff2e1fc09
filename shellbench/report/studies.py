"""Which rows belong to a study: a suite says what it studies, and its runs are shown where that is."""

from __future__ import annotations

from collections.abc import Sequence

from shellbench.bench import catalog
from shellbench.bench.row import Row
from shellbench.bench.suite import Study


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
