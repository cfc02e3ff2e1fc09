"""The table of `shellbench judge`: stated values on each mesh, their limit, and the known value of each theory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from shellbench.bench.judge.classes import BLUNT, CLASSES, class_of
from shellbench.bench.judge.row import Row
from shellbench.bench.stated.judging import ENOUGH, Judged
from shellbench.report.data.columns import Line, column, frame, present, words
from shellbench.report.data.notation import MARKDOWN, Notation, rounded
from shellbench.report.data.solutions import heading
from shellbench.report.data.table import Note, Table

COLUMNS = ["block", "case", "quantity", "unit", "kind", "name", "cells", "unknowns", "value", "uncertainty"]
COLUMNS += ["error", "absolute_error", "class", "rate", "nearest_node", "seconds", "tends_to"]
SETTLED = 1e-9  # relative spread of values that no longer change


def table(judged: Sequence[Judged], name: str = "") -> Table:
    """Return the table: for each quantity the known limits, the values from coarse to fine, and their limit."""
    return Table(
        name="stated",
        title=f"Stated values{f': {name}' if name else ''}",
        caption="Errors are relative to the known value that is marked with *: that of the theory which judges. A class"
        " is the tightest relative error that the value is within. Digits in brackets are uncertainties.",
        data=frame([line for one in judged for line in _lines(one)], COLUMNS),
        columns=(
            column("name", "Mesh or limit", words, right=False),
            "unknowns",
            column("value", "Value", _value),
            column("error", "Error", lambda value, line, notation: notation.error(value)),
            column("class", "Class", lambda value, line, notation: words(value, line, notation)),
            column("rate", "Rate", lambda value, line, notation: notation.number(rounded(value, 0.1))),
            column("nearest_node", "Nearest node", lambda value, line, notation: f"{value:.2g}"),
            column("seconds", "Stated time (s)", lambda value, line, notation: f"{value:.3g}"),
        ),
        notes=tuple(
            Note(f"{one.answers[0].case.name} {one.rows[0].quantity}", tends_to(one)) for one in judged if one.known
        ),
    )


def _lines(one: Judged) -> Iterator[dict[str, Any]]:
    last = one.rows[-1]
    common = {"block": heading(last), "case": last.case, "quantity": last.quantity, "unit": last.unit}
    for name in one.nearest:
        value, mark = one.known[name], "*" if name == one.judge else ""
        more = {"name": f"{name}{mark}", "value": value.value, "uncertainty": value.uncertainty}
        yield common | {"kind": "known"} | more
    for row, answer in zip(one.rows, one.answers, strict=True):
        name = "one mesh" if answer.size is None else f"{answer.cells} cells" if answer.cells else "mesh"
        found = {name: getattr(answer, name) for name in ("cells", "unknowns", "seconds")}
        more = {"name": name, "value": row.value, "nearest_node": answer.nearest}
        yield common | found | more | _errors(row, row.value) | {"kind": "mesh", "class": _class(row)}
    if one.limit is not None:
        more = {"uncertainty": one.limit.uncertainty, "rate": one.limit.rate, "tends_to": tends_to(one)}
        more |= {"value": one.limit.value} | _errors(last, one.limit.value)
        yield common | {"kind": "limit", "name": "limit"} | more


def _errors(row: Row, value: float | None) -> dict[str, Any]:
    """Return the errors of a value against the known value of a row."""
    if row.reference is None or value is None:
        return {}
    relative = None if row.relative_error is None else (value - row.reference) / abs(row.reference)
    return {"absolute_error": value - row.reference, "error": relative}


def _class(row: Row) -> str:
    found = class_of(row)
    return "" if row.reference is None else f"{found:g}" if found else f"misses {CLASSES[-1]:g}"


def _value(value: Any, line: Line, notation: Notation) -> str:
    doubt = line["uncertainty"]
    return notation.number(rounded(value, doubt if present(doubt) and doubt else None, show_uncertainty=True))


def _number(value: float, doubt: float | None) -> str:
    return MARKDOWN.number(rounded(value, doubt or None, show_uncertainty=True))


def tends_to(one: Judged) -> str:
    """Return the sentence that names the limit that the values tend to, beside all known ones."""
    listed = [(name, one.known[name]) for name in one.nearest]
    known = [f"the {name} is {_number(value.value, value.uncertainty)}" for name, value in listed]
    if one.limit is None:
        return f"one mesh shows no limit: {'; '.join(known)}"
    value, doubt = one.limit.value, one.limit.uncertainty
    first, *others = (abs(of.value - value) - (of.uncertainty or 0.0) for _, of in listed)
    if one.limit.rate is None and len(one.rows) >= ENOUGH and doubt > SETTLED * abs(value):
        begin = f"shows no rate of convergence: the last values differ by {doubt:.2g}"
    else:
        begin = f"tends to {_number(value, doubt)}"
    nearest, near = listed[0]
    if any(other <= doubt for other in others):
        begin += ", which is too uncertain to tell the limits apart"
    elif first > max(BLUNT * doubt, CLASSES[-1] * abs(near.value)):
        begin += ", which is none of the known limits"
    elif first > BLUNT * doubt and near.value:
        off = MARKDOWN.error((value - near.value) / abs(near.value))
        begin += f", which is {off} from the {nearest}, more than the meshes explain"
    return f"{begin}: {'; '.join(known)}"
