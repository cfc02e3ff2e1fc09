"""Base of the solvers of fields: the protocol, the cases that they decline, and the uncertainty from two levels."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from shellbench.problem import Solution
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.solution import FieldAnswer
from shellbench.problems.solving import FreshSolver

LEVEL_ROUNDING = 1e-14  # relative: rounding, which no level shows


class FieldSolver(FreshSolver):
    """A solver of problems of kind `field`.

    A subclass states the theories that it takes, and gives `answer`, and in `refuses` the cases that it declines beyond
    them.
    """

    def declines(self, case: Any) -> str | None:
        """Return the reason that the solver declines a problem, as one clause, or None if it takes it."""
        if not isinstance(case, FieldCase) or case.theory not in self.capabilities.theories:
            return f"it solves problems of kind 'field' with theory {' or '.join(self.capabilities.theories)} only"
        return self.refuses(case)

    def refuses(self, case: FieldCase) -> str | None:
        """Return the reason that the solver declines a field of its theories, or None if it takes it."""
        return None

    @abstractmethod
    def load(self, path: Path) -> Solution:
        """Read the file of an answer."""


def measured(case: FieldCase, answer: FieldAnswer) -> dict[str, float]:
    """Return the case's quantities by name."""
    return {quantity.name: quantity.measure(answer) for quantity in case.quantities}


def told_by_levels(levels: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the uncertainty by quantity: the change between the last two levels, and a share for rounding."""
    before, last = levels[-2], levels[-1]
    return {name: abs(value - before[name]) + LEVEL_ROUNDING * abs(value) for name, value in last.items()}
