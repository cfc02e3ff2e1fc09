"""The solver `bspline-ritz`; the module `bspline`, which solves, is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from shellbench.problem import Capabilities, ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import Beyond
from shellbench.solvers.ndf.bspline.bspline_settings import SplineSettings
from shellbench.solvers.ndf.field_solver import FieldSolver

if TYPE_CHECKING:
    from shellbench.solvers.ndf.bspline.bspline_solution import SplineSolution


class SplineSolver(FieldSolver):
    """Cubic B-splines with solved coefficients; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = "bspline-ritz"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear",), label="grid of cubic B-splines, solved for (Ritz)"
    )
    settings_type: ClassVar[type[SplineSettings]] = SplineSettings
    slopes: ClassVar[Literal["", "energies", "differences"]] = "energies"
    takes: ClassVar[frozenset[Beyond]] = frozenset(
        {
            "varying stiffness",
            "orthotropic",
            "bending Poisson's ratio",
            "foundation",
            "loaded parts",
            "local loads",
            "kinks",
            "narrow formulas",
        }
    )

    def declines(self, case: Case) -> str | None:
        """Return the reason that a grid can't represent this case, as one clause, or None if it can."""
        if reason := super().declines(case):
            return reason
        from shellbench.solvers.ndf.bspline.bspline import why_not_held

        return why_not_held(case)

    def declines_with(self, case: Case, settings: SplineSettings) -> str | None:
        """Return the reason that the grid of these settings can't represent this case, as one clause, or None."""
        if settings.degree == 1:
            return "a bilinear grid has no curvature, so that bending would cost it nothing"
        return self.declines(case)

    def load(self, path: Path) -> SplineSolution:
        """Read a file of this solver; InputError in one sentence if it is no such file."""
        from shellbench.solvers.ndf.bspline.bspline_solution import SplineSolution

        return SplineSolution.load(path)

    def answer(
        self, case: Case, settings: SplineSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> SplineSolution:
        """Solve a case.

        Raises
        ------
        SolveFailure
            If the equations have no solution.
        """
        from shellbench.solvers.ndf.bspline import bspline

        return bspline.solve(case, settings, progress)
