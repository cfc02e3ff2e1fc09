"""From rows to the data of the tables: runs that differ in their seed alone become one line.

A block is one quantity of one case: the figures that others quote, the known value that judges, and a line for
each solver with its mean and its worst seed. Values whose name `COLUMNS` lacks are dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.reference import KnownValue, KnownValues
from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import ANSWERED, NOT_SETTLED
from shellbench.report.data.columns import frame
from shellbench.report.data.notation import MARKDOWN, Notation, allowance, percent, rounded
from shellbench.report.data.runs import Known, grouped, same_but_for_seed, solution_name, variant_name

THEORIES = {
    "kirchhoff-love-linear": "linear Kirchhoff–Love",
    "naghdi-linear": "linear Naghdi",
    "kirchhoff-love-nonlinear": "non-linear Kirchhoff–Love",
    "reissner-mindlin": "Reissner–Mindlin",
    "inextensional": "inextensional",
    "membrane": "membrane",
    "mixed": "mixed theories",
    "unstated": "theory not stated",
}
MARKED = ("at", "mark", "unit")
COLUMNS = (
    *("block", "case", "quantity", *MARKED, "kind", "solution", "theory", "judged_by"),
    *("source", "origin", "locator", "value", "uncertainty", "converged", "spread", "extrapolated"),
    *("mean_error", "worst_error", "mean_absolute_error", "worst_absolute_error", "worst_seed"),
    *("reference", "reference_uncertainty", "tolerance", "tolerance_is_absolute", "verdict", "reason"),
    *("seeds", "answered", "parameters", "storage_bytes", "seconds", "peak_memory_bytes", "energy_gap", "run_ids"),
)
BLOCK = ["case", "own_case", "quantity", "at"]  # what a row is a figure of, the mark of its state among it
NUMBERS = ["value", "uncertainty", "relative_error", "absolute_error", "seed", "parameters", "storage_bytes", "seconds"]
NUMBERS += ["peak_memory_bytes", "energy_gap", "reference"]

PASS, SHORT, EXPECTED, NOT_GATED = "pass", "fail", "expected failure", "not gated"
STATUS_WORDS = {
    "failed": "run failed",
    "timeout": "timed out",
    "missing": "missing",
    "declined": "declined",
    NOT_SETTLED: NOT_SETTLED,
}
BAD = (SHORT, *STATUS_WORDS.values())
MOST_VALUES = 3  # in one line of what fails


def theory_words(theory: str | None) -> str:
    """Return the readable name of a theory."""
    return THEORIES.get(theory or "", theory or "")


def heading(row: Row) -> str:
    """Return the words that head a block."""
    what = row.description or row.quantity.replace("_", " ")
    unit = f" ({row.unit})" if row.unit else ""
    at = f" at {row.mark}" if row.mark else ""
    return f"{row.case_title or row.case}: {what}{unit}{at}"


def verdict(rows: Sequence[Row]) -> str:
    """Return the verdict on the runs of one line; one bad seed spoils it."""
    # What an open finding expects of an answer, it may expect of one that has not settled.
    expected = [row.status == NOT_SETTLED and row.passed is None and bool(row.open_finding) for row in rows]
    for status, words in STATUS_WORDS.items():
        if any(row.status == status and not known for row, known in zip(rows, expected, strict=True)):
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
    runs = pd.DataFrame([dict(row) | {"row": row, "line": same_but_for_seed(row)} for row in rows])
    lines: list[dict[str, Any]] = []
    if len(runs):
        runs[NUMBERS] = runs[NUMBERS].astype(float)
        for _, block in runs.groupby(BLOCK, sort=False, dropna=False):
            lines += _block(block, known)
    return frame(lines, COLUMNS)


def _block(runs: pd.DataFrame, known: Known) -> list[dict[str, Any]]:
    """Return the lines of one quantity of one case."""
    first = runs["row"].iloc[0]
    judge = next(iter(runs.loc[runs["reference"].notna(), "row"]), None)
    values = KnownValues() if first.own_case else known(first.case)
    absent = variants() - set(map(variant_name, runs["row"]))  # a variant's figure stands beside the variant alone
    quoted = () if first.variant else values.of(first.quantity, "literature", "published")  # said of the case itself
    lines = [_figure(value, judge) for value in quoted if value.label not in absent]
    lines += [] if judge is None else [_judge(judge, values)]
    lines += [_solver(line) for _, line in runs.groupby("line", sort=False)]
    common = {"block": heading(first)} | {name: getattr(first, name) for name in ("case", "quantity", *MARKED)}
    return [common | line for line in lines]


def variants() -> set[str]:
    """Return the names of all solver variants in the suites."""
    return {run.label for name in catalog.suite_names() for run in catalog.find_suite(name).runs if run.settings}


def _reference(judge: Row | None) -> dict[str, Any]:
    """Return the reference value of a line, its uncertainty and its theory."""
    if judge is None:
        return {}
    figures = {"reference": judge.reference, "reference_uncertainty": judge.reference_uncertainty}
    return {"judged_by": judge.reference_theory, **figures}


def _figure(value: KnownValue, judge: Row | None) -> dict[str, Any]:
    reference = judge.reference if judge else None
    error = (value.value - reference) / abs(reference) if reference else None
    label = f"{value.label}, published" if value.label and value.label in variants() else value.label
    return _reference(judge) | {
        "kind": value.role,
        "solution": label or value.role,
        **{name: getattr(value, name) for name in ("theory", "source", "origin", "locator", "value", "uncertainty")},
        "mean_error": error,
        "worst_error": error,
    }


def _judge(row: Row, values: KnownValues) -> dict[str, Any]:
    judge = values.judge(row.quantity, row.reference_theory or "")
    return _reference(row) | {
        "kind": "judge",
        "solution": "Converged",
        "theory": row.reference_theory,
        "source": row.reference_source,
        "origin": judge.origin if judge else "",
        "locator": judge.locator if judge else "",
        "value": row.reference,
        "uncertainty": row.reference_uncertainty,
    }


def _solver(runs: pd.DataFrame) -> dict[str, Any]:
    rows: list[Row] = list(runs["row"])
    first = rows[0]
    answered = runs[runs["value"].notna()]
    settled = runs["converged"].dropna()
    judged = answered[answered["seed"].notna()]
    return _reference(first) | {
        "kind": "solver",
        "solution": solution_name(first),
        "origin": first.solver_label,
        "value": answered["value"].mean(),
        "uncertainty": answered["uncertainty"].max(),
        "converged": all(settled) if len(settled) else None,
        "spread": answered["value"].std(),
        "extrapolated": first.extrapolated if len(rows) == 1 else None,
        "mean_error": answered["relative_error"].mean(),
        "worst_error": _worst(answered, "relative_error", "relative_error"),
        "mean_absolute_error": answered["absolute_error"].mean(),
        "worst_absolute_error": _worst(answered, "absolute_error", "absolute_error"),
        "worst_seed": _worst(judged, "relative_error", "seed"),
        "tolerance": first.tolerance,
        "tolerance_is_absolute": first.tolerance_is_absolute,
        "verdict": verdict(rows),
        "reason": _reasons(rows),
        "seeds": " ".join(str(row.seed) for row in rows if row.seed is not None),
        "answered": len(answered),
        "seconds": runs["seconds"].mean(),
        **{name: runs[name].max() for name in ("parameters", "storage_bytes", "peak_memory_bytes", "energy_gap")},
        "run_ids": " ".join(row.run_id for row in rows if row.run_id),
    }


def _worst(runs: pd.DataFrame, name: str, wanted: str) -> float | None:
    """Return a column's value of the run with the largest magnitude of an error; None if no run has that error."""
    errors = runs[name].dropna().abs()
    return None if errors.empty else float(runs.loc[errors.idxmax(), wanted])


def _reasons(rows: Sequence[Row]) -> str:
    told = [row for row in rows if row.reason or row.open_finding]
    by_reason = grouped(told, lambda row: row.reason or f"open finding: {row.open_finding}")
    several = len(rows) > 1
    parts = []
    for reason, of_reason in by_reason.items():
        seeds = ", ".join(str(row.seed) for row in of_reason if row.seed is not None)
        parts.append(f"seed {seeds}: {reason}" if several and seeds else reason)
    return "; ".join(parts)


@dataclass(frozen=True)
class Verdict:
    """Counts of the gated rows that passed and failed.

    Attributes
    ----------
    bad_runs, beside
        Runs that failed or are missing: of all that any gate judges, and of those that none does, such as ablations.
    without_answer
        Gated figures that fell short because their run failed or is missing.
    unsettled
        Gated figures that fell short because their answer has not settled.
    """

    gated: int
    held: int
    expected: int
    bad_runs: int
    beside: int = 0
    without_answer: int = 0
    unsettled: int = 0

    @property
    def good(self) -> bool:
        """True if at least one value is gated and all gated values pass."""
        return self.gated > 0 and self.held == self.gated

    @property
    def words(self) -> str:
        """The verdict in one sentence."""
        short = self.gated - self.held - self.without_answer - self.unsettled
        have, settled = ("have" if count != 1 else "has" for count in (self.without_answer, self.unsettled))
        held = f"{'All' if self.good else f'{self.held} of'} {self.gated} gated values pass"
        parts = (
            held if self.gated else "Nothing is gated here",
            f"{short} fail{'s' if short == 1 else ''}" if short else "",
            f"{self.without_answer} {have} no answer" if self.without_answer else "",
            f"{self.unsettled} {settled} not settled" if self.unsettled else "",
            f"{_counted(self.expected, 'expected failure')} (open findings)" if self.expected else "",
            f"{_counted(self.bad_runs, 'run')} failed or missing" if self.bad_runs else "",
            f"{_counted(self.beside, 'run')} beside them, which no gate judges, failed" if self.beside else "",
        )
        return "; ".join(filter(None, parts)) + "."


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count != 1 else ''}"


@dataclass(frozen=True)
class Shortfall:
    """Runs of one solver on one case that fell short for the same reason: which seeds, in what, and why."""

    case: str
    solution: str
    words: str


def shortfalls(rows: Sequence[Row]) -> list[Shortfall]:
    """Return the values that fail or have no answer, a line for each case, solver and reason; expected ones too."""
    bad = [row for row in rows if row.passed is False or _is_expected(row) or row.status not in ("ok", "declined")]
    groups = grouped(bad, lambda row: (row.case_title or row.case, solution_name(row), *_why(row)))
    found = []
    for (case, solution, word, reason), of_group in groups.items():
        seeds = list(dict.fromkeys(str(row.seed) for row in of_group if row.seed is not None))
        which = f"seed{'s' if len(seeds) > 1 else ''} {', '.join(seeds)}, " if seeds else ""
        values = list(dict.fromkeys(map(value_words, of_group)))
        more = f" and {len(values) - MOST_VALUES} more" if len(values) > MOST_VALUES else ""
        shown = ", ".join(values[:MOST_VALUES]) + more
        found.append(Shortfall(case, solution, f"{which}{word} ({shown})" + (f": {reason}" if reason else "")))
    return found


def _is_expected(row: Row) -> bool:
    return row.passed is None and row.open_finding is not None


def _why(row: Row) -> tuple[str, str]:
    """Return the fate of a value and its reason; nothing if its error says so."""
    if row.status != "ok":
        return STATUS_WORDS.get(row.status, SHORT), row.reason or ""
    if _is_expected(row):
        return EXPECTED, row.open_finding or ""
    exceeds = row.judged_error is not None and row.tolerance is not None and abs(row.judged_error) > row.tolerance
    return SHORT, "" if exceeds else row.reason or ""


def value_words(row: Row, with_allowed: bool = True) -> str:
    """Return a value's name, its error and the error that is allowed; its name alone if no error is known."""
    name = row.quantity.replace("_", " ") + (f" at {row.mark}" if row.mark else "")
    if row.judged_error is None or row.status != "ok":
        return name
    allowed = f" ({allowed_words(row)} allowed)" if with_allowed and row.tolerance is not None else ""
    return f"{name} {size_words(row, row.judged_error)}{allowed}"


def allowed_words(row: Row) -> str:
    """Return the largest error that a row is allowed."""
    if row.tolerance is not None and not row.tolerance_is_absolute:
        return f"{MARKDOWN.number(allowance(row.tolerance))} %"
    return size_words(row, row.tolerance)


def size_words(row: Row, size: float | None, notation: Notation = MARKDOWN) -> str:
    """Return an error in percent, or in the row's unit where its tolerance is absolute; plain words unless told."""
    size = size or 0.0
    if not row.tolerance_is_absolute:
        return notation.number(percent(size)) + (" %" if notation is MARKDOWN else notation.per_cent)
    return f"{notation.number(rounded(size, abs(size) / 10))} {row.unit}".strip()


def overall(rows: Sequence[Row]) -> Verdict:
    """Return the counts of gated rows that passed and failed."""
    gated = [row for row in rows if row.passed is not None]
    judged = {row.run_id for row in rows if row.passed is not None or row.open_finding}
    bad: set[tuple[object, ...]] = set()
    beside: set[tuple[object, ...]] = set()
    for row in rows:
        if row.status not in (*ANSWERED, "declined"):
            of = bad if row.run_id is None or row.run_id in judged else beside
            of.add((row.case, same_but_for_seed(row), row.seed))
    return Verdict(
        gated=len(gated),
        held=sum(bool(row.passed) for row in gated),
        expected=sum(row.passed is None and row.open_finding is not None for row in rows),
        bad_runs=len(bad),
        beside=len(beside - bad),
        without_answer=sum(not row.passed and row.status not in ANSWERED for row in gated),
        unsettled=sum(not row.passed and row.status == NOT_SETTLED for row in gated),
    )
