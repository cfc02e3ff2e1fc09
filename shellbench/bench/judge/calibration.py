"""Calibration: the true errors of answers, compared with the uncertainties that their solvers state.

    ratio = |value - known value| / (stated uncertainty + uncertainty of the known value)

A solver passes if 95 % of its values have a ratio of at most 2, and none has a ratio above 5. A ratio above 5 is a
finding about the solver, even if the value is within the tolerance. For a solver with frozen tolerances this finding is
red, unless the answer states that it has not settled, or an open finding names it. For a third-party solver the finding
is only shown.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from shellbench.bench.judge.classes import scale_of
from shellbench.bench.judge.row import Finding, Row
from shellbench.bench.store.identity import GATED_DTYPE
from shellbench.bench.store.record import ANSWERED

ASKED_SHARE = 0.95  # share of the values that must be
WITHIN = 2.0  # within this multiple of the stated uncertainty,
MOST = 5.0  # and none beyond this
TIMES = (1.0, WITHIN, MOST)
ROUNDING = 1e-12  # of a value's scale: the limit of double precision


@dataclass(frozen=True)
class Judged:
    """One value with a known error and a stated uncertainty.

    Attributes
    ----------
    error, stated
        Magnitudes in the row's unit; `stated` includes the known value's own uncertainty, and rounding.
    scale
        Scale of relative values: the known value, or the largest known value of its unit if that is near zero.
    """

    row: Row
    error: float
    stated: float
    scale: float

    @property
    def ratio(self) -> float:
        """True error over stated uncertainty."""
        return self.error / self.stated if self.stated else math.inf if self.error else 0.0

    @property
    def name(self) -> str:
        """Case, seed if there is one, and quantity."""
        seed = "" if self.row.seed is None else f" seed {self.row.seed}"
        return f"{self.row.case}{seed} {self.row.quantity}"


@dataclass(frozen=True)
class Calibration:
    """Comparison of a solver's stated uncertainties with its actual errors.

    Attributes
    ----------
    judged
        Values with a known value and a stated uncertainty, the worst first.
    silent
        Number of values that have a known value and state no uncertainty.
    """

    solver: str
    judged: tuple[Judged, ...]
    silent: int

    def share(self, times: float) -> float | None:
        """Return the share of values whose ratio is at most `times`; None if there are no values."""
        return sum(one.ratio <= times for one in self.judged) / len(self.judged) if self.judged else None

    @property
    def overconfident(self) -> tuple[Judged, ...]:
        """Values of answers with status ok whose ratio exceeds the largest admissible one."""
        return tuple(one for one in self.judged if one.ratio > MOST and one.row.status == "ok")

    @property
    def holds(self) -> bool | None:
        """True if the stated uncertainties cover enough errors and none is far too small; None if none is stated."""
        share = self.share(WITHIN)
        return None if share is None else share >= ASKED_SHARE and not self.overconfident

    def __str__(self) -> str:
        none = f"{self.silent} figure{'' if self.silent == 1 else 's'}"
        if not self.judged:
            return f"{self.solver} states no uncertainty of {none}"
        worst = self.judged[0]
        words = (
            f"{self.solver}: {100 * (self.share(WITHIN) or 0.0):.3g} % of {len(self.judged)} errors are within"
            f" {WITHIN:g} times the stated uncertainty ({100 * ASKED_SHARE:g} % asked); the worst is {worst.ratio:.3g}"
            f" times, {worst.name}"
        )
        return f"{words}; it states none of {none}" if self.silent else words


def judged_figure(row: Row) -> Judged | None:
    """Return the error and its stated uncertainty; None if the row has no known value or no uncertainty."""
    if not _has_known_error(row) or row.uncertainty is None or row.absolute_error is None or row.reference is None:
        return None
    near_zero = row.relative_error is None
    scale = (0.0 if row.own_case else scale_of(row.case, row.unit)) if near_zero else abs(row.reference)
    stated = row.uncertainty + (row.reference_uncertainty or 0.0) + ROUNDING * scale
    return Judged(row, abs(row.absolute_error), stated, scale)


def _has_known_error(row: Row) -> bool:
    return (
        row.status in ANSWERED
        and row.default_settings
        and row.dtype == GATED_DTYPE
        and row.absolute_error is not None
        and math.isfinite(row.absolute_error)
    )


def calibrations(rows: Iterable[Row]) -> list[Calibration]:
    """Return the calibration of each solver whose answers have known values, by its name."""
    known: dict[str, list[Row]] = {}
    for row in rows:
        if _has_known_error(row):
            known.setdefault(row.solver, []).append(row)
    found = []
    for solver, of_solver in sorted(known.items()):
        judged = [one for row in of_solver if (one := judged_figure(row)) is not None]
        judged.sort(key=lambda one: -one.ratio)
        found.append(Calibration(solver, tuple(judged), len(of_solver) - len(judged)))
    return found


def calibration_findings(found: Sequence[Calibration], ours: Collection[str]) -> list[Finding]:
    """Return a finding for each value of a built-in solver whose error far exceeds its stated uncertainty."""
    return [
        Finding(
            one.row,
            "red" if one.row.open_finding is None else "expected failure",
            f"its error is {one.ratio:.3g} times the uncertainties of answer and known value, and {MOST:g} is allowed",
        )
        for calibration in found
        if calibration.solver in ours
        for one in calibration.overconfident
    ]
