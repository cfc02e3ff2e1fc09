"""What solvers of fields have in common: the protocol, what they refuse, and what two levels say of the uncertainty."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from shellbench.errors import InputError
from shellbench.problem import Capabilities, ProgressCallback, Settings, Solution
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.solution import FieldAnswer

ROUNDING = 1e-14  # relative: what no level tells


class FieldSolver(ABC):
    """A solver of problems of kind `field`; see `shellbench.problem.Solver` for the protocol.

    A subclass says which theories it takes, and gives `answer` and what it refuses beyond them by `refuses`.
    """

    name: ClassVar[str]
    capabilities: ClassVar[Capabilities]
    settings_type: ClassVar[type[Settings]] = Settings

    def declines(self, case: Any) -> str | None:
        """Return why it can't take a problem, as one clause, or None if it can."""
        if not isinstance(case, FieldCase) or case.theory not in self.capabilities.theories:
            return f"it solves problems of kind 'field' with theory {' or '.join(self.capabilities.theories)} only"
        return self.refuses(case)

    def refuses(self, case: FieldCase) -> str | None:
        """Return why it can't take a field of its theories."""
        return None

    def solve(
        self,
        case: FieldCase,
        settings: Any = None,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> Solution:
        """Solve a case with settings, or what makes some.

        Raises
        ------
        SolveFailure
            If no trustworthy answer was reached.
        InputError
            If an earlier solution is given, or the case is declined.
        """
        if start is not None:
            raise InputError(f"{self.name} starts from no earlier solution")
        if reason := self.declines(case):
            raise InputError(f"{case.name}: {reason}")
        kind = self.settings_type
        chosen = settings if isinstance(settings, kind) else kind.model_validate(settings or {})
        return self.answer(case, chosen, progress or (lambda _: None))

    @abstractmethod
    def answer(self, case: FieldCase, settings: Any, progress: ProgressCallback) -> Solution:
        """Solve a case that is not declined; see `solve`."""

    @abstractmethod
    def load(self, path: Path) -> Solution:
        """Read what an answer has saved."""


def measured(case: FieldCase, answer: FieldAnswer) -> dict[str, float]:
    """Return the case's quantities by name."""
    return {quantity.name: quantity.measure(answer) for quantity in case.quantities}


def told_by_levels(levels: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return how far figures of the last level are from those of the one before, and from rounding."""
    before, last = levels[-2], levels[-1]
    return {name: abs(value - before[name]) + ROUNDING * abs(value) for name, value in last.items()}
