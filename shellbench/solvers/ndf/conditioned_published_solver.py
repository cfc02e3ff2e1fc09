"""The solver `ndf-material`; the module `conditioned_published` trains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from shellbench.problem import Capabilities, ProgressCallback
from shellbench.problems.series.conditioned import ConditionedCase
from shellbench.problems.series.conditioned_answer import THEORIES, ConditionedSolver
from shellbench.solvers.ndf.published.published_settings import ConditionedPublishedSettings

if TYPE_CHECKING:
    from shellbench.solvers.ndf.published.conditioned_published import TrainedField


class ConditionedPublishedSolver(ConditionedSolver):
    """The paper's field with the material as an input (Kairanda et al. 2023, section 4.4)."""

    name: ClassVar[str] = "ndf-material"
    capabilities: ClassVar[Capabilities] = Capabilities(
        THEORIES, "neural field with the material as an input, by the published training", devices=("cpu", "cuda")
    )
    settings_type: ClassVar[type[ConditionedPublishedSettings]] = ConditionedPublishedSettings

    def refuses(self, case: ConditionedCase) -> str | None:
        """Return the reason that the published boundary functions can't hold the shell, or None if they can."""
        from shellbench.solvers.ndf.published import published

        return published.why_not_held(case.shell_of(case.middle))

    def answer(
        self, case: ConditionedCase, settings: ConditionedPublishedSettings, progress: ProgressCallback
    ) -> TrainedField:
        """Train a field; SolveFailure if the loss becomes non-finite."""
        from shellbench.solvers.ndf.published.conditioned_published import solve

        return solve(case, settings, progress)

    def load(self, path: Path) -> TrainedField:
        """Read the file of an answer; InputError in one sentence if it is no such file."""
        from shellbench.solvers.ndf.published.conditioned_published import TrainedField

        return TrainedField.load(path)
