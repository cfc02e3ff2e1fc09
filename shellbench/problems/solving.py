"""Base classes of the solvers of all kinds: they check the case and its settings, and report progress. No mechanics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

from shellbench.errors import InputError
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Solution, declined_quantities


def silent(progress: Progress) -> None:
    """Ignore the progress."""


class CheckedSolver(ABC):
    """A solver that answers all cases that it does not decline; see `shellbench.problem.Solver` for the protocol.

    Attributes
    ----------
    uses_start
        Whether it can continue from an earlier solution; otherwise it refuses one.
    """

    name: ClassVar[str]
    capabilities: ClassVar[Capabilities]
    settings_type: ClassVar[type[Settings]] = Settings
    uses_start: ClassVar[bool] = False

    @abstractmethod
    def declines(self, case: Any) -> str | None:
        """Return the reason that the solver declines a problem, as one clause, or None if it takes it."""

    def declines_quantity(self, case: Any, quantity: Any) -> str | None:
        """Return the reason that it can't give a quantity of a problem that it takes, or None if it can; one clause."""
        return None

    def refusal(self, case: Any) -> str | None:
        """Return the reason that it can't give everything that a problem asks, as one clause, or None if it can."""
        return self.declines(case) or next(iter(declined_quantities(self, case).values()), None)

    def declines_with(self, case: Any, settings: Any) -> str | None:
        """Return the reason that it declines a problem with these settings, or None; by default that of `declines`."""
        return self.declines(case)

    def solve(
        self,
        case: Any,
        settings: Any = None,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> Solution:
        """Solve a case with settings, or with data from which settings are made.

        Raises
        ------
        SolveFailure
            If no trustworthy answer was reached; the partial solution comes with it.
        InputError
            If the solver declines the case, the settings do not fit it, or `start` is of no use to the solver.
        """
        kind = self.settings_type
        chosen = settings if isinstance(settings, kind) else kind.model_validate(settings or {})
        if start is not None and not self.uses_start:
            raise InputError(f"{self.name} can't go on from an earlier solution: it solves every case from rest")
        if reason := self.declines_with(case, chosen):
            raise InputError(f"{self.name} can't take {case.name}: {reason}")
        for name, reason in declined_quantities(self, case).items():
            raise InputError(f"{self.name} can't give {name} of {case.name}: {reason}")
        return self.answer_from(start, case, chosen, progress or silent)

    @abstractmethod
    def answer_from(
        self, start: Solution | Path | None, case: Any, settings: Any, progress: ProgressCallback
    ) -> Solution:
        """Solve a case that is not declined; `start` is None unless the solver can use it."""


class FreshSolver(CheckedSolver):
    """A solver that starts from no earlier solution. A subclass gives `declines` and `answer`."""

    def answer_from(
        self, start: Solution | Path | None, case: Any, settings: Any, progress: ProgressCallback
    ) -> Solution:
        """Solve a case that is not declined; see `answer`."""
        return self.answer(case, settings, progress)

    @abstractmethod
    def answer(self, case: Any, settings: Any, progress: ProgressCallback) -> Solution:
        """Answer a case that it takes; SolveFailure if it can't."""
