"""The common part of solvers of shells: what is asked of a case and of settings before anything is solved."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from shellbench.errors import InputError
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Solution
from shellbench.problems.shell.case import Case


def silent(progress: Progress) -> None:
    """Tell nobody."""


class ShellSolver:
    """What solvers of shells have in common; see `shellbench.problem.Solver` for the protocol.

    A subclass gives `answer` and `load`, and `declines` where it can't take all cases of its theories. It is a light
    module: what solves is imported when it is called.

    Attributes
    ----------
    uses_start
        Whether `answer` goes on from an earlier solution; it is refused otherwise.
    """

    name: ClassVar[str]
    capabilities: ClassVar[Capabilities]
    settings_type: ClassVar[type[Settings]] = Settings
    uses_start: ClassVar[bool] = False

    def declines(self, case: Case) -> str | None:
        """Return why the solver can't take this case, as one clause, or None if it can."""
        return None if case.theory in self.capabilities.theories else f"it does not solve the theory {case.theory}"

    def declines_with(self, case: Case, settings: Any) -> str | None:
        """Return why the solver can't take a case with settings; what `declines` says unless settings matter."""
        return self.declines(case)

    def solve(
        self,
        case: Case,
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
            If the solver declines the case, the settings do not fit it, or `start` is of no use to the solver.
        """
        chosen = (
            settings if isinstance(settings, self.settings_type) else self.settings_type.model_validate(settings or {})
        )
        if start is not None and not self.uses_start:
            raise InputError(f"{self.name} can't go on from an earlier solution: it solves every case from rest")
        refusal = self.declines_with(case, chosen)
        if refusal:
            raise InputError(f"{self.name} can't take {case.name}: {refusal}")
        return self.answer(case, chosen, start, progress or silent)

    def answer(self, case: Case, settings: Any, start: Solution | Path | None, progress: ProgressCallback) -> Solution:
        """Solve a case that is not declined; see `solve`."""
        raise NotImplementedError

    def load(self, path: Path) -> Solution:
        """Read a solution that `Solution.save` wrote; InputError in one sentence if it is none."""
        raise NotImplementedError
