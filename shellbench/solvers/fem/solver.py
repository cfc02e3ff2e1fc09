"""The solver `fem`: refine until every quantity is converged, and state its uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, get_args

from shellbench.problem import Capabilities, ProgressCallback, Quantity, Settings, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import Beyond
from shellbench.problems.shell.quantities.quantities import DerivativeQuantity, ResultantQuantity
from shellbench.problems.shell.solution import ShellSolver
from shellbench.solvers.fem.settings import FemSettings, takes_bubbles

if TYPE_CHECKING:
    from shellbench.solvers.fem.mechanics.solution import FemSolution
    from shellbench.solvers.fem.motion.motion_solution import MotionSolution


class FemSolver(ShellSolver):
    """C1 finite elements on a tensor mesh with the exact geometry: Bogner, Fox & Schmit's, and bubbles on its cells."""

    name: ClassVar[str] = "fem"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"), label="C1 finite elements, exact geometry"
    )
    settings_type: ClassVar[type[Settings]] = FemSettings
    uses_start: ClassVar[bool] = True
    takes: ClassVar[frozenset[Beyond]] = frozenset(get_args(Beyond))  # all there is

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines this case, or None if it takes it."""
        if refusal := super().declines(case):
            return refusal
        if case.surface.fold_lines:
            from shellbench.solvers.fem.mechanics.fold_conditions import why_not_at_folds

            if refusal := why_not_at_folds(case):
                return refusal
        if any(support.holds_slope for support in case.supports):
            from shellbench.solvers.fem.mechanics.constraints import why_no_mirror, why_no_slope

            if refusal := why_no_mirror(case) or why_no_slope(case):
                return refusal
        if case.dynamics is not None:
            from shellbench.solvers.fem.motion import motion

            return motion.why_declined(case)
        if case.linear:
            return None
        from shellbench.solvers.fem.path import large_displacement

        return large_displacement.why_declined(case)

    def declines_quantity(self, case: Case, quantity: Quantity) -> str | None:
        """Return the reason that a quantity of a case that it takes has no value, or None."""
        if isinstance(quantity, DerivativeQuantity):
            from shellbench.solvers.fem.derivatives.answer import why_no_derivative

            other: Any = case.quantity(quantity.derivative_of)
            return self.declines_quantity(case, other) or why_no_derivative(case, other, quantity.parameter(case))
        if not (case.linear and isinstance(quantity, ResultantQuantity)):
            return None
        from shellbench.solvers.fem.mechanics.resultants import why_infinite

        return why_infinite(case, quantity)

    def declines_with(self, case: Case, settings: FemSettings) -> str | None:
        """Return the reason that the solver declines this case with these settings, or None if it takes it."""
        if settings.degree in (4, 5) and not takes_bubbles(case):
            what = (
                "shells at rest: in the linear theory with supports of whole edges along fixed directions, or with the"
                " whole field prescribed, without moments or following pressure in the non-linear theory"
            )
            return f"degree {settings.degree} is for {what}"
        if settings.degree == 3 and case.surface.fold_lines:
            return "degree 3 is for surfaces without folds"
        return self.declines(case)

    def answer(
        self, case: Case, settings: FemSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> FemSolution | MotionSolution:
        """Solve a case on ever finer meshes until all its quantities are converged.

        `start` is an earlier solution (or its file) of a shell of which the case is an edit. Then the meshes are like
        its last ones, and a path continues from its states.

        Raises
        ------
        SolveFailure
            If a linear solve fails or the loads are not in balance; the answer of the finest mesh so far comes with it.
        InputError
            If supports contradict each other, a direct solver is not installed, or the start is
            of another shell.
        """
        from shellbench.solvers.fem import solving

        begin = self.load(start) if isinstance(start, Path) else start
        return solving.solve(case, settings, begin, progress)

    def load(self, path: Path) -> FemSolution | MotionSolution:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        from shellbench.problems.shell.solution import read_solution
        from shellbench.solvers.fem.derivatives.answer import FemAnswer
        from shellbench.solvers.fem.mechanics.solution import FORMATS
        from shellbench.solvers.fem.motion.motion_solution import MotionSolution

        def kind(case: Case) -> type[FemSolution | MotionSolution]:
            return FemAnswer if case.dynamics is None else MotionSolution

        return read_solution(path, FORMATS, kind)
