"""The solver `ndf-ritz`; the module `ritz`, which solves, is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from shellbench.problem import Capabilities, ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import Beyond, why_not_plain
from shellbench.solvers.ndf.field_solver import FieldSolver
from shellbench.solvers.ndf.linear.ritz_settings import NDF_RITZ, RitzSettings

if TYPE_CHECKING:
    from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
    from shellbench.solvers.ndf.motion.motion_solution import MotionSolution


class RitzSolver(FieldSolver):
    """Random features with a solved output layer; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = NDF_RITZ
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"),
        label="neural field: fixed random sine layer, output layer solved for (Ritz); trains nothing",
        devices=("cpu", "cuda"),
    )
    settings_type: ClassVar[type[RitzSettings]] = RitzSettings
    slopes: ClassVar[Literal["", "energies", "differences"]] = "energies"
    uses_start: ClassVar[bool] = True
    takes: ClassVar[frozenset[Beyond]] = frozenset(
        {
            "varying stiffness",
            "orthotropic",
            "stiffening",
            "bending Poisson's ratio",
            "foundation",
            "loaded parts",
            "local loads",
            "kinks",
            "folds",
            "modes",
            "contact",
            "resultants",
            "narrow formulas",
        }
    )

    def declines(self, case: Case) -> str | None:
        """Return the reason that the usual field can't represent this case, as one clause, or None if it can."""
        return self.declines_with(case, RitzSettings())

    def load(self, path: Path) -> NdfSolution | PathSolution | MotionSolution:
        """Read a file of this recipe; InputError in one sentence if it is no such file."""
        from shellbench.solvers.ndf.motion.motion_solution import load_solution

        return load_solution(path, self.name)

    def declines_with(self, case: Case, settings: RitzSettings) -> str | None:
        """Return the reason that the field of these settings can't represent this case, as one clause, or None."""
        from shellbench.solvers.ndf.linear.declines import why_declined
        from shellbench.solvers.ndf.linear.ritz_field import field_spec
        from shellbench.solvers.ndf.path.modes import why_no_modes

        spec = field_spec(case, settings)
        if case.modal and (reason := why_no_modes(case, spec)):
            return reason
        return why_not_plain(case, self.takes) or why_declined(case, spec)

    def answer(
        self, case: Case, settings: RitzSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> NdfSolution | PathSolution | MotionSolution:
        """Solve a case; with `start`, an earlier path of this recipe (or its file), continue from its states.

        Raises
        ------
        SolveFailure
            If the energies on the two quadratures disagree by more than the largest admissible gap, or the path of a
            non-linear case ends early.
        InputError
            If the case can't be solved with these settings.
        """
        from shellbench.solvers.ndf import ritz

        return ritz.solve(case, settings, start, progress)
