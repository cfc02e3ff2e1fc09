"""Precision: what rounding does to a solution of one number."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problem import NumberFormat
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.records.sampling import FORMATS, MARKS, marks_of, precision_study
from shellbench.problems.shell.records.series import frames
from tests.bench import spring
from tests.bench.falling import FallSolution
from tests.bench.spring import SpringSolution

THIRD = 1 / 3  # of no binary format
KEPT = (0.25, 0.5, 1.0)  # marks of the loaded case; it rises by their squares


class OneNumber(SpringSolution):
    """A plate that rises by a third of what the spring does, and keeps that third."""

    def __init__(self, case: Case, factor: float = THIRD, refuses: NumberFormat | None = None) -> None:
        super().__init__(case)
        self.factor, self.refuses, self.roundings = factor, refuses, 0

    def displacement(self, points, at=None, material=None):  # type: ignore[no-untyped-def]
        with np.errstate(invalid="ignore"):  # infinity times the zeros of the other components
            return self.factor * super().displacement(points, at)

    def energies(self, at=None):  # type: ignore[no-untyped-def]
        return tuple(self.factor**2 * part for part in super().energies(at))

    def rounded(self, format: NumberFormat) -> tuple[OneNumber, int]:
        self.roundings += 1
        kind = np.dtype(format)
        if format == "float64":
            return self, kind.itemsize
        factor = math.inf if format == self.refuses else float(kind.type(self.factor))
        return OneNumber(self.case, factor), kind.itemsize


def lost(format: str) -> float:
    return abs(float(np.dtype(format).type(THIRD)) - THIRD)


def test_differences_are_those_of_the_number_that_is_rounded() -> None:
    case = spring.loaded_case()
    steps = precision_study(OneNumber(case), case, {})
    assert [step.format for step in steps] == list(FORMATS)
    assert [step.storage_bytes for step in steps] == [8, 4, 2]
    assert (steps[0].largest_difference, steps[0].rms_difference) == (0.0, 0.0)
    for step in steps[1:]:
        assert step.largest_difference == pytest.approx(lost(step.format), rel=1e-9)
        rms = math.sqrt(sum(mark**4 for mark in KEPT) / len(KEPT))
        assert step.rms_difference == pytest.approx(lost(step.format) * rms, rel=1e-9)


def test_quantities_are_measured_of_the_rounded_solution() -> None:
    case = spring.loaded_case()
    known: dict[str, Any] = {"half": THIRD / 4, "full": THIRD}
    double, _, half = precision_study(OneNumber(case), case, known)
    assert double.quantities == known | {"bending": pytest.approx(0.5 / 9), "energy": pytest.approx(3 / 9)}
    kept = float(np.float16(THIRD))
    assert half.quantities == {
        "half": pytest.approx(kept / 4, rel=1e-12),
        "full": pytest.approx(kept, rel=1e-12),
        "bending": pytest.approx(kept**2 / 2, rel=1e-12),
        "energy": pytest.approx(3 * kept**2, rel=1e-12),
    }


def test_loads_of_a_path_are_no_business_of_rounding() -> None:
    case = spring.snapping_case()
    for step in precision_study(OneNumber(case), case, {}):
        assert set(step.quantities) == {"rise"}


def test_a_format_that_can_not_hold_the_solution_says_so_and_costs_no_other() -> None:
    case = spring.loaded_case()
    _, single, half = precision_study(OneNumber(case, refuses="float16"), case, {})
    assert single.largest_difference == pytest.approx(lost("float32"), rel=1e-9)
    assert (half.largest_difference, half.rms_difference, half.quantities) == (None, None, {})
    assert half.storage_bytes == 2


def test_a_solution_that_can_not_be_rounded_has_no_steps() -> None:
    case = spring.loaded_case()
    assert precision_study(SpringSolution(case), case, {}) == ()


def test_a_path_that_reached_nothing_has_no_steps() -> None:
    case = spring.loaded_case()
    solution = OneNumber(case)
    solution.upto = 0.0
    assert precision_study(solution, case, {}) == ()
    assert solution.roundings == 0


def test_states_beyond_the_end_are_not_compared() -> None:
    case = spring.loaded_case()
    solution = OneNumber(case)
    solution.upto = 0.5

    def refused(format: NumberFormat) -> tuple[OneNumber, int]:
        short, size = OneNumber(case, float(np.float16(THIRD))), 2
        short.upto = 0.5
        return short, size

    solution.rounded = refused  # type: ignore[method-assign]
    for step in precision_study(solution, case, {}):
        assert step.largest_difference == pytest.approx(lost("float16") / 4, rel=1e-9)
        assert set(step.quantities) == {"half", "bending"}


def test_a_motion_is_compared_at_a_few_times_up_to_its_end() -> None:
    case = catalog.named_case("free_fall")
    solution = FallSolution(case)
    marks = marks_of(solution, case)
    assert len(marks) == MARKS
    assert marks[-1] == frames(solution, case)[-1] == 1.0
    assert set(marks) < set(frames(solution, case))
    assert np.ptp(np.diff(np.array(marks, dtype=float))) < 0.1


def test_few_states_are_all_compared() -> None:
    case = spring.loaded_case()
    assert marks_of(SpringSolution(case), case) == KEPT


def test_a_rounded_solution_may_refuse_a_state() -> None:
    case = spring.loaded_case()
    solution = OneNumber(case)

    def refusing(format: NumberFormat) -> tuple[OneNumber, int]:
        short = OneNumber(case)
        short.upto = 0.6
        with pytest.raises(InputError):
            short.displacement(np.zeros((1, 2)), at=1.0)
        return short, 1

    solution.rounded = refusing  # type: ignore[method-assign]
    assert {step.largest_difference for step in precision_study(solution, case, {})} == {None}
