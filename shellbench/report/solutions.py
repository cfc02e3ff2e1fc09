"""From rows to the data of the tables: runs that differ in their seed alone become one line.

A block is one quantity of one case: the figures that others quote, the known value that judges, and a line for
each solver with its mean and its worst seed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from shellbench.bench import catalog
from shellbench.bench.reference import KnownValue, KnownValues
from shellbench.bench.row import Row

Known = Callable[[str], KnownValues]
Block = tuple[str, bool, str, float | None]
T = TypeVar("T")

THEORIES = {
    "kirchhoff-love-linear": "linear Kirchhoff–Love",
    "kirchhoff-love-nonlinear": "non-linear Kirchhoff–Love",
    "reissner-mindlin": "Reissner–Mindlin",
    "inextensional": "inextensional",
    "membrane": "membrane",
    "mixed": "mixed theories",
    "unstated": "theory not stated",
}
COLUMNS = (
    "block",
    "case",
    "quantity",
    "at",
    "mark",
    "unit",
    "kind",
    "solution",
    "theory",
    "judged_by",
    "source",
    "origin",
    "locator",
    "value",
    "uncertainty",
    "converged",
    "spread",
    "extrapolated",
    "mean_error",
    "worst_error",
    "mean_absolute_error",
    "worst_absolute_error",
    "worst_seed",
    "reference",
    "reference_uncertainty",
    "tolerance",
    "tolerance_is_absolute",
    "verdict",
    "reason",
    "seeds",
    "answered",
    "parameters",
    "storage_bytes",
    "seconds",
    "peak_memory_bytes",
    "energy_gap",
    "run_ids",
)

INTEGERS = ("worst_seed", "answered", "parameters", "storage_bytes", "peak_memory_bytes")

PASS, SHORT, EXPECTED, NOT_GATED = "pass", "fell short", "expected failure", "not gated"
STATUS_WORDS = {"failed": "run failed", "timeout": "timed out", "missing": "missing", "declined": "declined"}
BAD = (SHORT, *STATUS_WORDS.values())


def theory_words(theory: str | None) -> str:
    """Return what a reader calls a theory."""
    return THEORIES.get(theory or "", theory or "")


def block_of(row: Row) -> Block:
    """Return what a row is a figure of: case, whether it is a user's own, quantity, and the mark of its state."""
    return row.case, row.own_case, row.quantity, row.at


def heading(row: Row) -> str:
    """Return the words that head a block."""
    what = row.description or row.quantity.replace("_", " ")
    unit = f" ({row.unit})" if row.unit else ""
    at = f" at {row.mark}" if row.mark else ""
    return f"{row.case_title or row.case}: {what}{unit}{at}"


def solution_name(row: Row) -> str:
    """Return what a line of a table is called: the solver, and how the run departs from its defaults."""
    return f"{row.solver}, {variant}" if (variant := variant_name(row)) else row.solver


def variant_name(row: Row) -> str:
    """Return how a run departs from its solver's defaults: the suite's word for it, or its settings."""
    settings = ", ".join(f"{key}={value}" for key, value in row.overrides.items())
    return (row.label or settings) if settings else ""


def same_but_for_seed(row: Row) -> str:
    """Return what the runs of one line have in common.

    Settings that are not at their defaults tell lines apart, not all settings: a run that is missing has no others.
    """
    return json.dumps([row.solver, row.overrides, row.device, row.dtype], sort_keys=True, default=str)


def grouped(rows: Iterable[Row], key: Callable[[Row], T]) -> dict[T, list[Row]]:
    """Return the rows by a key, in order of appearance."""
    groups: dict[T, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def verdict(rows: Sequence[Row]) -> str:
    """Return the verdict on the runs of one line; one bad seed spoils it."""
    for status, words in STATUS_WORDS.items():
        if any(row.status == status for row in rows):
            return words
    if any(row.passed is False for row in rows):
        return SHORT
    if any(row.open_finding for row in rows):
        return EXPECTED
    return PASS if all(row.passed for row in rows) else NOT_GATED


def comparison(rows: Sequence[Row], known: Known) -> pd.DataFrame:
    """Return the data of a table: for each block others' figures, the known value, and a line a solver.

    Parameters
    ----------
    rows
        Of any quantities; the table has their order.
    known
        Known values by name of case.
    """
    lines: list[dict[str, Any]] = []
    for (case, own, quantity, _), of_block in grouped(rows, block_of).items():
        first = of_block[0]
        common = {
            "block": heading(first),
            "case": case,
            "quantity": quantity,
            "at": first.at,
            "mark": first.mark,
            "unit": first.unit,
        }
        judge = next((row for row in of_block if row.reference is not None), None)
        labels = {variant_name(row) for row in of_block}
        values = KnownValues() if own else known(case)
        lines += [common | _figure(value, judge) for value in _others(values, quantity, labels)]
        if judge is not None:
            lines.append(common | _judge(judge, values))
        for group in grouped(of_block, same_but_for_seed).values():
            lines.append(common | _solver(group))
    return pd.DataFrame(lines, columns=list(COLUMNS)).astype(dict.fromkeys(INTEGERS, "Int64"))


def _others(values: KnownValues, quantity: str, labels: set[str]) -> list[KnownValue]:
    """Others' figures that belong beside these solutions: a variant's only where the variant itself is shown."""
    return [v for v in values.of(quantity, "literature", "published") if v.label not in variants() - labels]


def variants() -> set[str]:
    """Return what the suites call their variants of solvers."""
    return {run.label for name in catalog.suite_names() for run in catalog.find_suite(name).runs if run.settings}


def _figure(value: KnownValue, judge: Row | None) -> dict[str, Any]:
    reference = judge.reference if judge else None
    error = (value.value - reference) / abs(reference) if reference else None
    return {
        "kind": value.role,
        "solution": f"{value.label}, published" if value.label in variants() else value.label or value.role,
        "theory": value.theory,
        "judged_by": judge.reference_theory if judge else None,
        "source": value.source,
        "origin": value.origin,
        "locator": value.locator,
        "value": value.value,
        "uncertainty": value.uncertainty,
        "mean_error": error,
        "worst_error": error,
        "reference": reference,
        "reference_uncertainty": judge.reference_uncertainty if judge else None,
    }


def _judge(row: Row, values: KnownValues) -> dict[str, Any]:
    judge = values.judge(row.quantity, row.reference_theory or "")
    return {
        "kind": "judge",
        "solution": "Converged",
        "theory": row.reference_theory,
        "judged_by": row.reference_theory,
        "source": row.reference_source,
        "origin": judge.origin if judge else "",
        "locator": judge.locator if judge else "",
        "value": row.reference,
        "uncertainty": row.reference_uncertainty,
        "reference": row.reference,
        "reference_uncertainty": row.reference_uncertainty,
    }


def _solver(rows: list[Row]) -> dict[str, Any]:
    first = rows[0]
    answered = [row for row in rows if row.value is not None]
    values = [row.value for row in answered if row.value is not None]
    return {
        "kind": "solver",
        "solution": solution_name(first),
        "judged_by": first.reference_theory,
        "origin": first.solver_label,
        "value": float(np.mean(values)) if values else None,
        "uncertainty": _largest(row.uncertainty for row in answered),
        "converged": all(said) if (said := [r.converged for r in rows if r.converged is not None]) else None,
        "spread": float(np.std(values, ddof=1)) if len(values) > 1 else None,
        "extrapolated": first.extrapolated if len(rows) == 1 else None,
        "mean_error": _mean(row.relative_error for row in answered),
        "worst_error": _worst(row.relative_error for row in answered),
        "mean_absolute_error": _mean(row.absolute_error for row in answered),
        "worst_absolute_error": _worst(row.absolute_error for row in answered),
        "worst_seed": _worst_seed(answered),
        "reference": first.reference,
        "reference_uncertainty": first.reference_uncertainty,
        "tolerance": first.tolerance,
        "tolerance_is_absolute": first.tolerance_is_absolute,
        "verdict": verdict(rows),
        "reason": _reasons(rows),
        "seeds": " ".join(str(row.seed) for row in rows if row.seed is not None),
        "answered": len(answered),
        "parameters": _largest(row.parameters for row in rows),
        "storage_bytes": _largest(row.storage_bytes for row in rows),
        "seconds": _mean(row.seconds for row in rows),
        "peak_memory_bytes": _largest(row.peak_memory_bytes for row in rows),
        "energy_gap": _largest(row.energy_gap for row in rows),
        "run_ids": " ".join(row.run_id for row in rows if row.run_id),
    }


def _reasons(rows: Sequence[Row]) -> str:
    by_reason = grouped((row for row in rows if row.reason or row.open_finding), _reason)
    several = len(rows) > 1
    parts = []
    for reason, of_reason in by_reason.items():
        seeds = ", ".join(str(row.seed) for row in of_reason if row.seed is not None)
        parts.append(f"seed {seeds}: {reason}" if several and seeds else reason)
    return "; ".join(parts)


def _reason(row: Row) -> str:
    return row.reason or f"open finding: {row.open_finding}"


def _given(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _mean(values: Iterable[float | None]) -> float | None:
    given = _given(values)
    return float(np.mean(given)) if given else None


def _largest(values: Iterable[float | None]) -> float | None:
    return max(_given(values), default=None)


def _worst(values: Iterable[float | None]) -> float | None:
    return max(_given(values), key=abs, default=None)


def _worst_seed(rows: Sequence[Row]) -> int | None:
    judged = [row for row in rows if row.relative_error is not None and row.seed is not None]
    return max(judged, key=lambda row: abs(row.relative_error or 0.0)).seed if judged else None
