"""What the errors of a case's headline quantity are relative to, so that they can stand on one logarithmic axis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from shellbench.bench.kinds import portrait_of
from shellbench.bench.record import Record
from shellbench.bench.row import Row


@dataclass(frozen=True)
class Yardstick:
    """What errors are measured from and relative to.

    Attributes
    ----------
    value
        The known value, or the best answer.
    scale
        Positive, in the quantity's unit: the magnitude of `value`, or the extent of the shell for a position.
    floor
        Uncertainty of `value` over `scale`: what lies below can't be told from zero.
    words
        What errors are relative to, as the end of a sentence.
    run_id
        Of the best answer where no value is known.
    """

    value: float
    scale: float
    floor: float
    words: str
    run_id: str | None = None

    def error(self, value: float) -> float:
        """Return the signed relative error of a value."""
        return (value - self.value) / self.scale


def yardstick_of(records: Mapping[str, Record], rows: Sequence[Row]) -> Yardstick | None:
    """Return what the errors of runs of one case are relative to: the known value, or the best answer if there is none.

    The best answer is the one with the least uncertainty of its own, or of most unknowns if none states one. None if
    nothing was answered, or the value is zero without being a position.
    """
    known = known_yardstick(records, rows)
    return known if any(row.reference is not None for row in rows) else _best_answer(rows)


def known_yardstick(records: Mapping[str, Record], rows: Sequence[Row]) -> Yardstick | None:
    """Return the known value as a yardstick; None if there is none, or nothing that it could be relative to."""
    known = next((row for row in rows if row.reference is not None), None)
    if known is None or known.reference is None:
        return None
    uncertainty = known.reference_uncertainty or 0.0
    if all(row.relative_error is None for row in rows if row.value is not None):
        extent = next(filter(None, (_extent(records.get(row.run_id or ""), row.unit) for row in rows)), None)
        if extent is None:
            return None
        words = (
            f"the known value, and relative to the extent of the shell, {extent:.3g} {known.unit}, not to a position"
        )
        return Yardstick(known.reference, extent, uncertainty / extent, words)
    scale = abs(known.reference)
    return Yardstick(known.reference, scale, uncertainty / scale, "the known value") if scale else None


def _extent(record: Record | None, unit: str) -> float | None:
    """Return the largest extent of a shell along an axis; None for quantities that are no lengths."""
    case = portrait_of(record) if record is not None else None
    return None if case is None or unit != case.unit_of_length else case.extent


def _best_answer(rows: Sequence[Row]) -> Yardstick | None:
    answers = [row for row in rows if row.status == "ok" and row.value and math.isfinite(row.value)]
    stated = [row for row in answers if row.uncertainty is not None]
    best = (
        min(stated, key=lambda row: row.uncertainty or 0.0)
        if stated
        else max(answers, key=lambda row: row.parameters or 0, default=None)
    )
    if best is None or best.value is None:
        return None
    words = f"the best answer, that of {best.solver} with {best.parameters} unknowns, for no value is known"
    scale = abs(best.value)
    return Yardstick(best.value, scale, (best.uncertainty or 0.0) / scale, words, best.run_id)
