"""The section on supports: built into the field, or asked for by a penalty (Kairanda et al., figure II, F.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report import cells
from shellbench.report.digits import percent, quoted, rounded
from shellbench.report.evidence import Evidence, Section
from shellbench.report.notation import Notation
from shellbench.report.solutions import STATUS_WORDS, solution_name
from shellbench.report.table import Column, Line, Note, Table, present

SUPPORT_ERROR = "support_error"  # diagnostics of a solver that can leak: the largest displacement at held places, m
PENALTY = "penalty"  # the weight of the penalty, None where supports are built into the field


def section(evidence: Evidence) -> Section | None:
    """Return the section; None if no run held its supports by a penalty."""
    table = support_table(evidence.records, evidence.rows)
    if table is None:
        return None
    return Section(
        name="supports",
        title="Hard and soft supports",
        words=(
            "A support can be built into the form of a field, which then holds it for all weights, or it can be"
            " asked for by a penalty: a spring of a chosen weight along the held places. A soft support leaks by what"
            " the spring gives; too stiff a spring makes the equations ill-conditioned. The weight has to be found by"
            " trial, and no weight holds the support exactly.",
        ),
        tables=(table,),
        exhibits=(),
    )


def support_table(records: Mapping[str, Record], rows: Sequence[Row]) -> Table | None:
    """Return a line for each run that says how well it holds its supports, of cases with a penalty in any run."""
    found = [
        (row, record.diagnostics, _largest(record))
        for row in rows
        if row.primary
        and (record := records.get(row.run_id or "")) is not None
        and _number(record.diagnostics.get(SUPPORT_ERROR)) is not None
    ]
    soft = {row.case for row, diagnostics, _ in found if _number(diagnostics.get(PENALTY))}
    kept = [one for one in found if one[0].case in soft]
    kept = [one for one in kept if _number(one[1].get(PENALTY)) or one[0].default_settings]
    seeds = {(row.case, solution_name(row)): row.seed for row, _, _ in reversed(kept)}  # the first of each
    kept = [one for one in kept if one[0].seed == seeds[one[0].case, solution_name(one[0])]]
    if not kept:
        return None
    cases = list(dict.fromkeys(row.case for row, _, _ in kept))
    kept.sort(key=lambda one: (cases.index(one[0].case), _number(one[1].get(PENALTY)) or float("inf")))
    lines: list[dict[str, Any]] = [
        {
            "block": row.case_title or row.case,
            "case": row.case,
            "solution": solution_name(row),
            "run_id": row.run_id,
            "penalty": _number(diagnostics.get(PENALTY)),
            "support_error": _number(diagnostics.get(SUPPORT_ERROR)),
            "largest_displacement": largest,
            "relative_error": row.relative_error,
            "ended": "solved" if row.status == "ok" else STATUS_WORDS.get(row.status, row.status),
        }
        for row, diagnostics, largest in kept
    ]
    reasons = dict.fromkeys(
        (solution_name(row), row.reason) for row, _, _ in kept if row.status != "ok" and row.reason is not None
    )
    return Table(
        name="supports",
        title="Hard and soft supports",
        caption="Weight of the penalty (none: the support is built into the field), largest displacement at held"
        " places, that share of the largest displacement of the shell, and the error of the headline quantity."
        " One seed.",
        data=pd.DataFrame(lines),
        columns=(
            Column("Solution", cells.solution, right=False),
            Column("Weight", _weight),
            Column("At held places (m)", _metres),
            Column("Of the largest", _leak),
            Column("Error", cells.error("relative_error")),
            Column("Ended", lambda line, notation: notation.escape(line["ended"]), right=False),
        ),
        notes=tuple(Note(name, reason) for name, reason in reasons),
    )


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _largest(record: Record) -> float | None:
    return max((step.largest_displacement for step in record.resolution), default=None)


def _weight(line: Line, notation: Notation) -> str:
    return notation.number(quoted(line["penalty"])) if present(line["penalty"]) else "none"


def _metres(line: Line, notation: Notation) -> str:
    value = line["support_error"]
    return notation.number(rounded(value, value / 10)) if value else "0"


def _leak(line: Line, notation: Notation) -> str:
    value, largest = line["support_error"], line["largest_displacement"]
    if not present(largest) or not largest:
        return notation.missing
    return notation.number(percent(value / largest, signed=False)) + notation.per_cent
