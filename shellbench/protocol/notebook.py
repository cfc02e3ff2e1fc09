"""HTML of cases and solutions for notebooks: small tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any


def case_html(case: Any) -> str:
    """Return a case as HTML: title, theory and quantities."""
    asked = [(q.name, q.description, q.unit, case.telling_mark(q)) for q in case.quantities]
    about = f"{case.name}, kind {case.kind}, {case.theory}, units {case.units}"
    return _html(case.title, about, ("quantity", "what it is", "unit", "at"), asked)


def solution_html(solution: Any) -> str:
    """Return a solution as HTML: the values of its case, each with the solver's uncertainty."""
    lines = []
    for quantity in solution.case.quantities:
        try:
            value = f"{quantity.measure(solution) * quantity.factor:.8g}"
        except ValueError as error:  # it belongs to a state that was not reached
            value = str(error)
        doubt = solution.uncertainty.get(quantity.name)
        lines.append((quantity.name, value, "" if doubt is None else f"{doubt * quantity.factor:.2g}", quantity.unit))
    about = f"{solution.parameters} unknowns, {solution.storage_bytes} bytes"
    return _html(solution.case.title, about, ("quantity", "value", "uncertainty", "unit"), lines)


def _html(title: str, about: str, headings: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(word)}</th>" for word in headings)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in line)}</tr>" for line in lines)
    caption = f"<caption><strong>{escape(title)}</strong><br>{escape(about)}</caption>"
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
