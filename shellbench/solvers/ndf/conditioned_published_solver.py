"""The solver `ndf-material` and its settings; what trains is `conditioned_published`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from shellbench.model import Positive
from shellbench.problem import Capabilities, ProgressCallback, SeededSettings
from shellbench.problems.conditioned.case import ConditionedCase
from shellbench.problems.conditioned.solving import THEORIES, ConditionedSolver

if TYPE_CHECKING:
    from shellbench.solvers.ndf.conditioned_published import TrainedField


class ConditionedPublishedSettings(SeededSettings):
    """Settings of `ndf-material`; the defaults are the paper's."""

    iterations: int = Field(2000, ge=1, description="of Adam, each at one random material")
    layers: int = Field(5, ge=1, le=20, description="hidden layers")
    width: int = Field(512, ge=1, le=4096, description="of each hidden layer")
    omega0: Positive = Field(15.0, description="frequency of the sines")
    learning_rate: Positive = Field(1e-4, description="of Adam")
    cells: tuple[int, int] = Field((20, 20), description="of the grid of samples, along xi1 and xi2")
    dtype: Literal["float32", "float64"] = Field("float32", description="precision of the training")


class ConditionedPublishedSolver(ConditionedSolver):
    """The paper's field with the material as an input (Kairanda et al., section 4.4)."""

    name: ClassVar[str] = "ndf-material"
    capabilities: ClassVar[Capabilities] = Capabilities(
        THEORIES, "neural field with the material as an input, by the published training", devices=("cpu", "cuda")
    )
    settings_type: ClassVar[type[ConditionedPublishedSettings]] = ConditionedPublishedSettings

    def refuses(self, case: ConditionedCase) -> str | None:
        """Return why the published boundary functions can't hold the shell."""
        from shellbench.solvers.ndf import published

        return published.why_not(case.shell_of(case.middle))

    def answer(
        self, case: ConditionedCase, settings: ConditionedPublishedSettings, progress: ProgressCallback
    ) -> TrainedField:
        """Train a field; SolveFailure if the loss stops being finite."""
        from shellbench.solvers.ndf.conditioned_published import solve

        return solve(case, settings, progress)

    def load(self, path: Path) -> TrainedField:
        """Read what an answer has saved; InputError in one sentence if it is none."""
        from shellbench.solvers.ndf.conditioned_published import TrainedField

        return TrainedField.load(path)
