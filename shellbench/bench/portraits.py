"""The portrait of a record's problem: what a report can ask it, whatever its kind."""

from __future__ import annotations

from pydantic import ValidationError

from shellbench.bench.record import Record
from shellbench.portrait import Portrait
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.portrait import ShellPortrait


def portrait_of(record: Record) -> Portrait | None:
    """Return the portrait of the problem that a record answers; None if it can't be read any more."""
    try:
        return ShellPortrait(Case.model_validate(record.case))
    except ValidationError:
        return None


def portrait_of_named(case: Case) -> Portrait:
    """Return the portrait of a case of the catalog."""
    return ShellPortrait(case)
