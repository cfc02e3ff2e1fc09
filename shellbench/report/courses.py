"""Courses: how the error of a solve fell on its way, from stored histories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from shellbench.account import HistoryStep
from shellbench.bench.record import Record
from shellbench.bench.row import Row
from shellbench.report.solutions import variant_name

Abscissa = Literal["unknowns", "seconds", "iteration"]
SURFACE_DIMENSION = 2  # unknowns grow as the square of 1/h, h the mesh width


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
        """Whether the unknowns grew on the way: a refinement, rather than iterations at a fixed size."""
        return len({step.unknowns for step in self.steps if self.quantity in step.quantities}) > 1

    @property
    def is_field(self) -> bool:
        """Whether it iterates at a fixed size, or is checked for exploiting its quadrature."""
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
