"""Marks: which state of a case a figure belongs to, as a number and in words."""

from __future__ import annotations

from shellbench.problem import Problem, Quantity


def mark_of(quantity: Quantity) -> float | None:
    """Return the mark of a quantity's state; None for one that the solution itself marks."""
    return quantity.mark


def mark_words(case: Problem, mark: float) -> str:
    """Return what a mark of a case means, such as "t = 0.25" or "deflection = 12 mm"."""
    return case.mark_words(mark)


def telling_mark(case: Problem, quantity: Quantity) -> str:
    """Return the words for a quantity's mark; empty where all of the case's figures belong to its full load."""
    return case.telling_mark(quantity)
