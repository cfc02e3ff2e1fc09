"""The portrait of a record's problem: what a report can ask it, whatever its kind."""

from __future__ import annotations

from pydantic import ValidationError

from shellbench.bench.kinds import find_kind, problem_of
from shellbench.bench.record import Record
from shellbench.errors import InputError
from shellbench.portrait import Portrait
from shellbench.problem import Problem


def portrait_of(record: Record) -> Portrait | None:
    """Return the portrait of the problem that a record answers; None if it can't be read any more."""
    try:
        return portrait_of_named(problem_of(record.case))
    except (ValidationError, InputError):
        return None


def portrait_of_named(case: Problem) -> Portrait:
    """Return the portrait of a problem."""
    return find_kind(case.kind).portrait(case)
