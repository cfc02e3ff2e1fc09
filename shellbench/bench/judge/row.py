"""Rows: one comparable value each, the common data of tables, gates and reports; and the verdict on a row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field

from shellbench.bench.catalogue.reference import Tolerance
from shellbench.bench.store.identity import GATED_DTYPE
from shellbench.bench.store.record import NOT_SETTLED, STATED
from shellbench.problem import VARIANT
from shellbench.protocol.schema import Model

UNEXPLAINED = 1.0  # relative: worse than the answer zero, and therefore not the known mistake
Colour = Literal["green", "red", "expected failure", "not compared", "not judged"]
RowStatus = Literal["ok", "not settled", "failed", "timeout", "missing", "declined"]


class Row(Model):
    """One quantity of one run, compared with its known value.

    The fields up to `run_id` are the contract of ``shellbench table --format json``; the rest is for tables
    and gates. A row is made for each (case, solver, settings, seed, quantity, at).

    Attributes
    ----------
    case, suite, kind
        Names; a variant's stands behind that of its case and ``@``. The suite is the first that declares the run, or
        else the first that the case belongs to; None for a user's own case.
    settings
        All settings of the run, defaults included; `overrides` are those that differ from the defaults.
    seed
        None for a deterministic solver.
    quantity, primary, at
        The quantity; True if it is the case's headline; time, s, load factor, or displacement that marks the
        state (see `path.Path`); None for a turning point of a path. `mark` says it in words, where the
        case's figures belong to several states.
    value
        In the quantity's `unit`; None if the run left none.
    reference, reference_uncertainty, reference_theory, reference_source
        The known value of the case's own theory that judges; None if there is none.
    literature
        The value usually quoted, of any theory; see `literature_theory` and `literature_source`.
    published
        The paper's value for its own solver, or for this ablation if `label` is one of the paper's.
    relative_error
        Signed, value/reference - 1; None without a reference or where the reference is near zero.
    absolute_error
        Signed, value - reference.
    tolerance
        Largest admissible error for this solver, relative unless `tolerance_is_absolute`; None if not gated.
    passed
        None if nothing is gated, and for an expected failure (see `open_finding`).
    status
        Status of the run; ``missing`` only for requested rows without a record, ``declined`` for these and if the
        solver declines the quantity. An answer that is ``not settled`` has its value and uncertainty, and has not
        passed.
    seconds, peak_memory_bytes, parameters, storage_bytes
        Cost of the run: wall time of the solve, largest resident memory, free parameters or degrees of
        freedom, bytes that keep the solution.
    default_settings
        True if the run has the solver's default settings; only such runs are gated.
    declared
        True if a suite declares this run.
    suites
        All suites that declare the run, or that the case belongs to if none does.
    label
        Name of the run in its suite, after the solver's name, such as "GELU".
    uncertainty, extrapolated
        The solver's own estimate of its error, and the value extrapolated from its history, in the unit.
    data_error
        Part of the uncertainty that comes from the question's data, such as a mesh; None for exact data.
    converged
        True if the solver states that the answer converged to the requested accuracy, or names other quantities that
        did not; None if it states nothing.
    disagreement, disagreement_with
        Without a known value: signed relative difference from another solver's value, and the name of that solver.
    energy_gap
        Difference of the energy between the solve's quadrature and a finer one, relative, if it was measured.
    reason
        Reason why the run failed or the row did not pass, in one sentence.
    remark
        Remark on the run's answer, judged or not, as a clause; may be empty.
    """

    case: str
    suite: str | None
    kind: str = ""
    solver: str
    settings: dict[str, Any]
    seed: int | None
    quantity: str
    primary: bool
    at: float | None
    value: float | None
    reference: float | None = None
    reference_uncertainty: float | None = None
    reference_theory: str | None = None
    reference_source: str | None = None
    literature: float | None = None
    relative_error: float | None = None
    absolute_error: float | None = None
    tolerance: float | None = None
    passed: bool | None = None
    status: RowStatus
    seconds: float | None = None
    peak_memory_bytes: int | None = None
    parameters: int | None = None
    storage_bytes: int | None = None
    run_id: str | None = None

    case_title: str = ""
    own_case: bool = False
    suites: tuple[str, ...] = ()
    declared: bool = False
    solver_label: str = ""
    label: str = ""
    overrides: dict[str, Any] = Field(default_factory=dict)
    default_settings: bool = True
    device: str = "cpu"
    dtype: str = "float64"
    unit: str = ""
    description: str = ""
    mark: str = ""
    tolerance_is_absolute: bool = False
    open_finding: str | None = None
    literature_theory: str | None = None
    literature_source: str | None = None
    published: float | None = None
    published_source: str | None = None
    uncertainty: float | None = None
    data_error: float | None = None
    extrapolated: float | None = None
    converged: bool | None = None
    disagreement: float | None = None
    disagreement_with: str | None = None
    energy_gap: float | None = None
    idle_memory_bytes: int | None = None
    reason: str | None = None
    remark: str = ""

    @property
    def base(self) -> str:
        """Name of the case as declared."""
        return self.case.partition(VARIANT)[0]

    @property
    def variant(self) -> str | None:
        """Name of the variant; None for the case as declared."""
        return self.case.partition(VARIANT)[2] or None

    @property
    def stated(self) -> bool:
        """True for a value that shellbench did not compute."""
        return self.solver.endswith(STATED)

    @property
    def gated(self) -> bool:
        """True if a gate judges the row."""
        return self.passed is not None or self.open_finding is not None

    @property
    def judged_error(self) -> float | None:
        """Signed error that is compared with the tolerance: relative, or absolute if the tolerance is absolute."""
        return self.absolute_error if self.tolerance_is_absolute else self.relative_error

    def held_to(self, allowed: Tolerance) -> Row:
        """Return the row with a tolerance."""
        return self.model_copy(update={"tolerance": allowed.largest, "tolerance_is_absolute": allowed.is_absolute})

    def judged(self, allowed: Tolerance, ours: bool = False) -> Row:
        """Return the row with its verdict for its frozen tolerance.

        A built-in solver (`ours`) also fails if its stated uncertainty exceeds the tolerance.
        """
        row = self.held_to(allowed)
        why_not = row.why_short(row.tolerance) or (row.why_unsure() if ours else None)
        passed: bool | None = why_not is None
        if allowed.open_finding is not None:
            # An open finding of a case need not apply to its variants.
            easy = self.variant is not None
            passed, why_not = (
                (None, why_not) if why_not else (easy, None if easy else "it passes, but is an open finding")
            )
            if row.status == "ok" and row.relative_error is not None and abs(row.relative_error) > UNEXPLAINED:
                passed, why_not = False, f"no open finding explains an error of {row.relative_error:.2g}"
        found = {"open_finding": allowed.open_finding, "passed": passed, "reason": row.reason or why_not}
        return row.model_copy(update=found)

    def why_short(self, tolerance: float | None) -> str | None:
        """Return the reason why the row fails a tolerance, as a clause; None if it passes."""
        error = self.judged_error
        if self.status == NOT_SETTLED:
            return f"it has not settled: {self.reason}"
        if self.status != "ok":
            return self.reason or "the run failed"
        if self.dtype != GATED_DTYPE:
            return f"it was computed in {self.dtype}, and only {GATED_DTYPE} is gated"
        if self.value is None or not math.isfinite(self.value):
            return "the run left no finite value"
        if self.reference is None:
            return "no known value of its theory judges it"
        if tolerance is None:
            return "it has no tolerance"
        if error is None or not abs(error) <= tolerance:
            return f"its error is {error if error is None else format(error, '.2g')}, and {tolerance:g} is allowed"
        return None

    def why_unsure(self) -> str | None:
        """Return the reason why the stated uncertainty exceeds the tolerance, as a clause; None if it does not."""
        if self.uncertainty is None or self.tolerance is None or self.reference is None:
            return None
        stated = self.uncertainty if self.tolerance_is_absolute else self.uncertainty / abs(self.reference)
        return (
            None if stated <= self.tolerance else f"it is uncertain by {stated:.2g}, and {self.tolerance:g} is allowed"
        )

    def finding(self) -> Finding:
        """Return the accuracy gate's finding on a gated row."""
        if self.passed is None:
            return Finding(self, "expected failure", f"open finding: {self.open_finding}")
        if not self.passed or self.judged_error is None:
            why_not = self.why_short(self.tolerance) if self.status == NOT_SETTLED else None
            return Finding(self, "green" if self.passed else "red", why_not or self.reason or "")
        unit = f" {self.unit}" if self.tolerance_is_absolute else ""
        return Finding(self, "green", f"error {self.judged_error:+.2e}{unit}, {self.tolerance:g} allowed")


@dataclass(frozen=True)
class Finding:
    """A gate's verdict on one row, in one clause."""

    row: Row
    colour: Colour
    sentence: str


def in_suites(rows: Sequence[Row], suites: Sequence[str]) -> list[Row]:
    """Return the rows that belong to one of the suites, each narrowed to these; all if no suite is named."""
    if not suites:
        return list(rows)
    asked = [(row, tuple(name for name in row.suites if name in suites)) for row in rows]
    return [row.model_copy(update={"suite": kept[0], "suites": kept}) for row, kept in asked if kept]
