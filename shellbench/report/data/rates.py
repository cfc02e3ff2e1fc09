"""Errors of a case: what they are relative to, how they fell on the way of a solve, and at which rate.

Errors of a headline quantity are relative to one yardstick, so that they can stand on one logarithmic axis; a course is
what a stored history says of one solve; a rate is the slope of an error on logarithmic axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from shellbench.bench.judge.row import Row
from shellbench.bench.store.record import Record, portrait_of
from shellbench.protocol.history import HistoryStep
from shellbench.report.data.runs import variant_name

Abscissa = Literal["unknowns", "seconds", "iteration"]
SURFACE_DIMENSION = 2  # unknowns grow as the square of 1/h, h the mesh width
FEWEST = 3  # points that make a slope believable
COARSEST = 0.3  # relative errors above this are no asymptotic range
ABOVE_FLOOR = 2.0  # errors closer than this factor to what is known of the answer say nothing about the rate
LONGEST = 4  # points of a fit, from the finest backwards: the asymptotic range


@dataclass(frozen=True)
class Yardstick:
    """The reference of a case's errors: the value that they are measured from and the scale that they are relative to.

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
    """Return the known value as the yardstick of one case's errors; the best answer if there is no known value.

    The best answer has the least uncertainty of its own. If no answer states one, it is the answer of most unknowns.
    None if no run answered, or if the value is zero and not a position.
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


@dataclass(frozen=True)
class Course:
    """The history of one solve, ready to be drawn.

    Attributes
    ----------
    case, title
        Name and title of the case.
    solver, variant
        Which solver, and how the run departs from its defaults.
    reference, uncertainty
        The known value that errors are relative to, and its uncertainty.
    """

    case: str
    title: str
    solver: str
    variant: str
    seed: int | None
    quantity: str
    reference: float
    uncertainty: float
    steps: tuple[HistoryStep, ...]
    run_id: str

    @property
    def refines(self) -> bool:
        """True if the unknowns grew during the run: a refinement, and not iterations at a fixed size."""
        return len({step.unknowns for step in self.steps if self.quantity in step.quantities}) > 1

    @property
    def is_field(self) -> bool:
        """True if the run iterates at a fixed size, or has a measured quadrature gap."""
        iterates = len(self.steps) > 1 and not self.refines
        return iterates or any(step.gap is not None for step in self.steps)

    @property
    def floor(self) -> float:
        """Relative uncertainty of the known value: smaller errors can't be told from zero."""
        return self.uncertainty / abs(self.reference)

    def errors(self, of: Abscissa) -> tuple[list[float], list[float]]:
        """Return abscissae and relative errors of the steps that measured the quantity."""
        steps = [step for step in self.steps if self.quantity in step.quantities]
        errors = [abs(step.quantities[self.quantity] / self.reference - 1) for step in steps]
        return [_abscissa(step, of) for step in steps], errors

    def gaps(self, of: Abscissa) -> tuple[list[float], list[float]]:
        """Return abscissae and quadrature gaps of the steps that measured one."""
        steps = [step for step in self.steps if step.gap is not None]
        return [_abscissa(step, of) for step in steps], [step.gap for step in steps if step.gap is not None]


def _abscissa(step: HistoryStep, of: Abscissa) -> float:
    return float(step.iteration + 1) if of == "iteration" else float(getattr(step, of))


def courses(records: Mapping[str, Record], rows: Sequence[Row]) -> list[Course]:
    """Return the history of each run whose headline quantity has a known value.

    The states of a path are no part of it, and where nothing was solved for nothing converged.
    """
    found = []
    for row in rows:
        record = records.get(row.run_id or "")
        steps = tuple(step for step in record.history if step.phase == "solve" and step.unknowns) if record else ()
        if record is not None and row.primary and row.reference and steps:
            title, doubt = row.case_title or row.case, row.reference_uncertainty or 0.0
            whose = (row.case, title, row.solver, variant_name(row), row.seed)
            found.append(Course(*whose, row.quantity, row.reference, doubt, steps, record.run_id))
    return found


@dataclass(frozen=True)
class Rate:
    """A fitted power law error = factor * x ** slope over [first, last]."""

    slope: float
    factor: float
    first: float
    last: float

    def __call__(self, x: float) -> float:
        """Return the error that the law gives at x."""
        return float(self.factor * x**self.slope)


def fitted_rate(x: Sequence[float], error: Sequence[float], floor: float = 0.0) -> Rate | None:
    """Fit a power law by least squares in the logarithms.

    Parameters
    ----------
    x
        Degrees of freedom, seconds, or what else grows.
    error
        Relative errors, positive.
    floor
        Relative uncertainty of what the error is measured against.

    Returns
    -------
    Rate or None
        None if fewer than `FEWEST` points lie above the floor and below `COARSEST`.
    """
    points = [
        (a, e) for a, e in sorted(zip(x, error, strict=True)) if a > 0 and max(0.0, ABOVE_FLOOR * floor) < e < COARSEST
    ][-LONGEST:]
    if len({a for a, _ in points}) < FEWEST:
        return None
    logs = np.log(np.array(points))
    slope, intercept = np.polyfit(logs[:, 0], logs[:, 1], 1)
    return Rate(float(slope), float(np.exp(intercept)), points[0][0], points[-1][0])
