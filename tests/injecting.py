"""Faults are put into functions, whose results or arguments change as long as a test runs, and seen by errors."""

from collections.abc import Callable
from typing import Any

import pytest

from shellbench.bench.catalogue import catalog
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


def shares_of_tolerances(solution: Any, solver: str) -> dict[str, float]:
    """Return an answer's errors in units of what is allowed, by gated quantity; NaN where it is none."""
    name, values, found = solution.case.name, measure_all(solution), {}
    for quantity, allowed in catalog.tolerances()[solver][name].items():
        known = catalog.known_values(name).judge(quantity, solution.case.theory).value
        found[quantity] = abs(values[quantity] - known) / (allowed.absolute or allowed.relative * abs(known))
    return found
