"""The portrait of a record's problem: what a report can ask it, whatever its kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pydantic import ValidationError

from shellbench.bench.record import Record
from shellbench.portrait import Portrait
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.portrait import ShellPortrait

FIRST = "shell"  # kind of a case that names none
KINDS: dict[str, Callable[[Mapping[str, Any]], Portrait]] = {
    FIRST: lambda data: ShellPortrait(Case.model_validate(data)),
}
"""Takes a problem as a record keeps it and returns its portrait, by kind of problem."""


def portrait_of(record: Record) -> Portrait | None:
    """Return the portrait of the problem that a record answers; None if it can't be read any more."""
    paint = KINDS.get(record.case.get("kind", FIRST))
    try:
        return None if paint is None else paint(record.case)
    except ValidationError:
        return None


def portrait_of_named(case: Case) -> Portrait:
    """Return the portrait of a case of the catalog."""
    return KINDS[case.kind](case.model_dump(mode="json", exclude_unset=True))
