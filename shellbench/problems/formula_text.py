"""Formulas as text made from other formulas, so that a case made of another one is data like any other."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

Formula = float | str


def substituted(formula: Formula, values: Mapping[str, str]) -> Formula:
    """Return a formula with names replaced by expressions, all at once; a number stays as it is."""
    if not isinstance(formula, str) or not values:
        return formula
    names = "|".join(map(re.escape, sorted(values, key=len, reverse=True)))
    return re.sub(rf"(?<![\w.])({names})(?!\w)", lambda match: f"({values[match[1]]})", formula)


def times(formula: Formula, factor: float) -> Formula:
    """Return a formula times a number."""
    if factor == 1:
        return formula
    return f"{factor!r}*({formula})" if isinstance(formula, str) else formula * factor


def combined(formulas: Sequence[Formula], weights: Sequence[float]) -> Formula:
    """Return the sum of formulas times numbers."""
    if not any(isinstance(f, str) for f in formulas):
        return sum(float(f) * w for f, w in zip(formulas, weights, strict=True))
    terms = [times(f, w) for f, w in zip(formulas, weights, strict=True) if w != 0 and f != 0]
    return " + ".join(f"({term})" if isinstance(term, str) else f"({term!r})" for term in terms) or 0.0
