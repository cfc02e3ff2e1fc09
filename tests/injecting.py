"""Faults are put into functions, whose results or arguments change as long as a test runs, and seen by errors."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problem import Problem
from shellbench.problems.shell.quantities.measure import measure_all


def wrapped(owner: Any, name: str, change: Callable) -> Callable[[pytest.MonkeyPatch], None]:
    """Replace a function by one that changes its result."""

    def inject(patch: pytest.MonkeyPatch) -> None:
        original = getattr(owner, name)
        patch.setattr(owner, name, lambda *args, **more: change(original(*args, **more)))

    return inject


def given(owner: Any, name: str, change: Callable) -> Callable[[pytest.MonkeyPatch], None]:
    """Replace a function by one that gets other arguments."""

    def inject(patch: pytest.MonkeyPatch) -> None:
        original = getattr(owner, name)
        patch.setattr(owner, name, lambda *args, **more: original(*change(*args), **more))

    return inject


def room(case: Problem, quantity: str, solver: str) -> float:
    """Return the largest error that passes for a solver, in the quantity's unit; infinite if the value is not gated."""
    judge, tolerance = (
        catalog.known_values(case.name).judge(quantity, case.theory),
        catalog.tolerance(case.name, quantity, solver),
    )
    if judge is None or tolerance is None:
        return math.inf
    return tolerance.largest * (1.0 if tolerance.is_absolute else abs(judge.value))


def share(case: Problem, quantity: str, value: float, solver: str) -> float:
    """Return the error of a value in units of what is allowed."""
    known = catalog.known_values(case.name).judge(quantity, case.theory).value
    return abs(value - known) / room(case, quantity, solver)


def shares_of_tolerances(solution: Any, solver: str) -> dict[str, float]:
    """Return an answer's errors in units of the tolerance, by gated quantity; NaN if it is no number."""
    values, gated = measure_all(solution), catalog.tolerances()[solver][solution.case.name]
    return {name: share(solution.case, name, values[name], solver) for name in gated}


def exceeded(name: str, solver: Any, settings: Any = None) -> set[str]:
    """Solve a case; return the quantities whose error is larger than their frozen tolerance: all, if there is no answer."""
    case, gated = catalog.named_case(name), set(catalog.tolerances()[solver.name][name])
    try:
        answer = solver.solve(case, settings)
    except SolveFailure:
        return gated
    return {q for q in gated if not _measured_share(case, q, answer, solver.name) <= 1}


def _measured_share(case: Problem, quantity: str, answer: Any, solver: str) -> float:
    try:
        return share(case, quantity, case.quantity(quantity).measure(answer), solver)
    except ValueError:
        return math.inf
