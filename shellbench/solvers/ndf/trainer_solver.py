"""The solver `ndf` and its settings; what trains is `trainer`, which is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field as PydanticField

from shellbench.model import Positive
from shellbench.problem import Capabilities, ProgressCallback, SeededSettings, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Beyond, why_not_plain
from shellbench.solvers.ndf.choices import LARGEST_GAP, Components, PeriodicInput, StrainName
from shellbench.solvers.ndf.field_solver import FieldSolver

if TYPE_CHECKING:
    from shellbench.solvers.ndf.motion_solution import MotionSolution
    from shellbench.solvers.ndf.solution import NdfSolution, PathSolution

LAYER = 2.2  # l of stretched inputs in sqrt(h R): between 2 and 2.5 the certified energy of pinched cylinders is flat
MULTIPLIERS = 4  # singular features a point force; more gained under a tenth of the remaining error
INNER = (8, 8)  # hidden layers before the last; wider ones gained nothing certified


class TrainerSettings(SeededSettings):
    """Settings of `ndf`; what is None follows from the case.

    Attributes
    ----------
    activation
        "sine", "tanh" or "gelu"; "relu" has no curvature, and is refused.
    """

    inner: tuple[int, ...] = PydanticField(INNER, description="widths of the hidden layers before the last")
    widths: tuple[int, ...] | None = PydanticField(None, description="widths of the last hidden layer, tried in turn")
    activation: str = "sine"
    directions: int | None = PydanticField(
        None, ge=1, description="of hidden weights that a Gauss-Newton step moves in; None for all of them"
    )
    optimiser: Literal["gauss-newton", "adam"] = PydanticField(
        "gauss-newton", description="what moves hidden weights; the output layer is always solved for"
    )
    learning_rate: Positive = PydanticField(1e-3, description="of Adam, at the start; it falls along half a cosine")
    iterations: int | None = PydanticField(
        None, ge=0, le=100_000, description="at most; None for 3, or 2 on curved shells under forces at points"
    )
    tolerance: Positive = PydanticField(2e-6, description="certified relative gain below which training ends")
    gap: Positive = PydanticField(1e-5, description="gap of a training state beyond which more points are taken")
    damping: Positive = PydanticField(0.1, description="Marquardt's, at the start")
    attempts: int = PydanticField(5, ge=1, le=50, description="steps tried an iteration, ever more damped")
    layer: Positive = PydanticField(LAYER, description="length of stretched inputs, in sqrt(h R)")
    singular: int = PydanticField(MULTIPLIERS, ge=0, le=6, description="singular features a point force; 0 for none")
    stretched: bool = PydanticField(True, description="whether inputs are stretched toward point forces")
    mirrors: bool | None = PydanticField(
        None, description="whether planes of symmetry are built in; None: on curved shells under forces at points"
    )
    periodic_input: PeriodicInput = PydanticField("both", description='"both", "cosine" or "none" (a slit shell)')
    components: Components = PydanticField("cartesian", description="what the output layer gives")
    largest_gap: Positive = PydanticField(LARGEST_GAP, description="largest admissible quadrature gap")
    strain: StrainName | None = PydanticField(None, description="strain measure; exact in the non-linear theory")


class NdfSolver(FieldSolver):
    """The trainer; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = "ndf"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"),
        label="neural field: deep sine network, all weights trained in linear theory (variable projection,"
        " Gauss-Newton); at finite strain its output layer follows the path, and in motion, modes, buckling and"
        " under end moments its hidden layers stay as drawn",
        devices=("cpu", "cuda"),
    )
    settings_type: ClassVar[type[TrainerSettings]] = TrainerSettings
    uses_start: ClassVar[bool] = True
    takes: ClassVar[frozenset[Beyond]] = frozenset(
        {"varying stiffness", "bending Poisson's ratio", "loaded parts", "local loads", "kinks", "modes"}
    )

    def declines(self, case: Case) -> str | None:
        """Return why the boundary factors can't hold this case, as one clause, or None if they can."""
        from shellbench.solvers.ndf.declines import why_declined
        from shellbench.solvers.ndf.modes import why_no_modes

        if case.modal and (reason := why_no_modes(case)):
            return reason
        return why_not_plain(case, self.takes) or why_declined(case)

    def load(self, path: Path) -> NdfSolution | PathSolution | MotionSolution:
        """Read a solution of this recipe; InputError in one sentence if it is none."""
        from shellbench.solvers.ndf.motion_solution import load_solution

        return load_solution(path, self.name)

    def answer(
        self, case: Case, settings: TrainerSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> NdfSolution | PathSolution | MotionSolution:
        """Train a field; with `start`, an earlier solution of this recipe (or its file), go on from its weights.

        Raises
        ------
        SolveFailure
            If training breaks down, or the energy on the finest quadrature disagrees by more than the largest
            admissible gap; the last certified state comes with it.
        InputError
            If the settings or the start can't be used: it must be of a shell of which the case is an edit, and a motion
            begins at rest.
        """
        from shellbench.solvers.ndf import trainer

        return trainer.solve(case, settings, start, progress)
