"""The solver `ndf`; the module `trainer`, which trains, is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from shellbench.problem import Capabilities, ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import Beyond, why_not_plain
from shellbench.solvers.ndf.field_solver import FieldSolver
from shellbench.solvers.ndf.training.trainer_settings import NDF, TrainerSettings

if TYPE_CHECKING:
    from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
    from shellbench.solvers.ndf.motion.motion_solution import MotionSolution


class NdfSolver(FieldSolver):
    """The trainer; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = NDF
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"),
        label="neural field: deep sine network, all weights trained at rest and along paths under load (variable"
        " projection, Gauss-Newton); in motion, modes and buckling its hidden layers stay as drawn",
        devices=("cpu", "cuda"),
    )
    settings_type: ClassVar[type[TrainerSettings]] = TrainerSettings
    slopes: ClassVar[Literal["", "energies", "differences"]] = "energies"
    uses_start: ClassVar[bool] = True
    takes: ClassVar[frozenset[Beyond]] = frozenset(
        {
            "varying stiffness",
            "orthotropic",
            "bending Poisson's ratio",
            "foundation",
            "loaded parts",
            "local loads",
            "damping",
            "kinks",
            "modes",
        }
    )

    def declines(self, case: Case) -> str | None:
        """Return the reason that the boundary factors can't hold this case, as one clause, or None if they can."""
        from shellbench.solvers.ndf.linear.declines import why_declined
        from shellbench.solvers.ndf.path.modes import why_no_modes

        if case.modal and (reason := why_no_modes(case)):
            return reason
        return why_not_plain(case, self.takes) or why_declined(case)

    def load(self, path: Path) -> NdfSolution | PathSolution | MotionSolution:
        """Read a file of this recipe; InputError in one sentence if it is no such file."""
        from shellbench.solvers.ndf.motion.motion_solution import load_solution

        return load_solution(path, self.name)

    def answer(
        self, case: Case, settings: TrainerSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> NdfSolution | PathSolution | MotionSolution:
        """Train a field; with `start`, an earlier solution of this recipe (or its file), continue from its weights.

        Raises
        ------
        SolveFailure
            If training breaks down, or the energy on the finest quadrature disagrees by more than the largest
            admissible gap; the last certified state comes with it.
        InputError
            If the settings or the start can't be used. The start must be of a shell of which the case is an edit;
            motions begin at rest.
        """
        from shellbench.solvers.ndf.training import trainer

        return trainer.solve(case, settings, start, progress)
