"""What solvers of several kinds have in common: how they take a case, settings and progress. No mechanics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

from shellbench.errors import InputError
from shellbench.problem import Capabilities, ProgressCallback, Settings, Solution


class FreshSolver(ABC):
    """A solver that starts from no earlier solution; see `shellbench.problem.Solver` for the protocol.

    A subclass gives `declines` and `answer`.
    """

    name: ClassVar[str]
    capabilities: ClassVar[Capabilities]
    settings_type: ClassVar[type[Settings]] = Settings

    @abstractmethod
    def declines(self, case: Any) -> str | None:
        """Return why it can't take a problem, as one clause, or None if it can."""

    def solve(
        self,
        case: Any,
        settings: Any = None,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> Solution:
        """Solve a case with settings, or what makes some.

        Raises
        ------
        SolveFailure
            If no trustworthy answer was reached; what was reached comes with it.
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
    def answer(self, case: Any, settings: Any, progress: ProgressCallback) -> Solution:
        """Solve a case that is not declined; see `solve`."""
