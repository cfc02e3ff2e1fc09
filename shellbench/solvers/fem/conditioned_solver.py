"""The solver `fem-repeated`: `fem` once for every material, the baseline of fields for all materials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from shellbench.problem import Capabilities, ProgressCallback, Settings
from shellbench.problems.series.conditioned import ConditionedCase
from shellbench.problems.series.conditioned_answer import IN_MOTION, ConditionedSolver
from shellbench.solvers.fem.conditioned_settings import RepeatedSettings
from shellbench.solvers.fem.solver import FemSolver

if TYPE_CHECKING:
    from shellbench.solvers.fem.conditioned import RepeatedSolution


class FemRepeatedSolver(ConditionedSolver):
    """Finite elements, one solve a material; derivatives by central differences."""

    name: ClassVar[str] = "fem-repeated"
    capabilities: ClassVar[Capabilities] = Capabilities(
        IN_MOTION, "fem, one solve a material; derivatives by differences"
    )
    settings_type: ClassVar[type[Settings]] = RepeatedSettings

    def refuses(self, case: ConditionedCase) -> str | None:
        """Return the reason that `fem` declines the shell, or None if it takes it."""
        return FemSolver().refusal(case.shell_of(case.middle))

    def answer(self, case: ConditionedCase, settings: RepeatedSettings, progress: ProgressCallback) -> RepeatedSolution:
        """Solve for each held-out material; InputError and SolveFailure are those of `fem`."""
        from shellbench.solvers.fem.conditioned import solve

        return solve(case, settings, FemSolver(), progress)

    def load(self, path: Path) -> RepeatedSolution:
        """Read the file of an answer; InputError in one sentence if it is no such file."""
        from shellbench.solvers.fem.conditioned import RepeatedSolution

        return RepeatedSolution.load(path)
