"""Marks: which state of a case a figure belongs to, as a number and in words.

A mark is a time or load factor, or the displacement by which a path is controlled (see `path.Path`).
"""

from __future__ import annotations

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities import QuantityModel, Unmarked

FULL = 1.0  # the load factor of a figure of which nothing else is said


def mark_of(quantity: QuantityModel) -> float | None:
    """Return the mark of a quantity's state; None for a turning or critical point, which the path marks."""
    return None if isinstance(quantity, Unmarked) else quantity.at


def mark_words(case: Case, mark: float) -> str:
    """Return what a mark of a case means, such as "t = 0.25" or "deflection = 12 mm"."""
    path = case.path
    if case.dynamics is not None:
        return f"t = {mark:.4g} s"
    if path.quantity is None:
        return f"t = {mark:.4g}"
    unit = case.quantity(path.quantity).unit
    return f"{path.quantity.replace('_', ' ')} = {mark:.4g} {unit}".rstrip()


def telling_mark(case: Case, quantity: QuantityModel) -> str:
    """Return the words for a quantity's mark; empty where all of the case's figures belong to its full load."""
    mark = mark_of(quantity)
    asked = {mark_of(other) for other in case.quantities} - {None}
    return (
        ""
        if mark is None or (asked == {FULL} and case.path.quantity is None and case.dynamics is None)
        else mark_words(case, mark)
    )
