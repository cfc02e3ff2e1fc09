"""The solvers `fem-identify` and `fem-identify-differences`: parameters by `fem`, with two kinds of derivatives."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problem import Capabilities, Settings
from shellbench.problems.series.identification import THEORIES, IdentificationCase, IdentifyingSolver
from shellbench.problems.shell.case import Case
from shellbench.solvers.fem.settings import FemSettings
from shellbench.solvers.fem.solver import FemSolver

Array = NDArray[np.float64]

STEP = 1e-3  # of log p, of central differences: their error is its square


class FemIdentifySolver(IdentifyingSolver):
    """Gauss and Newton with derivatives by the adjoint: one solve of the shell, and one more for each datum."""

    name: ClassVar[str] = "fem-identify"
    capabilities: ClassVar[Capabilities] = Capabilities(THEORIES, "fem, derivatives by the adjoint")
    settings_type: ClassVar[type[Settings]] = FemSettings

    def refuses(self, shell: Case) -> str | None:
        """Return the reason that `fem` declines a shell, or gives no derivative of a datum."""
        from shellbench.solvers.fem.derivatives.answer import why_no_derivative

        reasons = (why_no_derivative(shell, quantity) for quantity in shell.quantities)
        return FemSolver().refusal(shell) or next((reason for reason in reasons if reason), None)

    def values(
        self, case: IdentificationCase, logarithms: Array, settings: Any
    ) -> tuple[Array, Array, dict[str, int], Any]:
        """Return quantities, derivatives, numbers of solves and the solution at log p."""
        solution = self._solved(case, logarithms, settings)
        names, p = list(case.unknowns), np.exp(logarithms)
        slopes = np.array([solution.gradient(q, names) * p for q in solution.case.quantities])
        return _measured(solution), slopes, {"solves": 1, "adjoint_solves": len(slopes)}, solution

    def _solved(self, case: IdentificationCase, logarithms: Array, settings: Any) -> Any:
        return FemSolver().solve(case.shell_with(np.exp(logarithms).tolist()), settings)


class FemDifferencesSolver(FemIdentifySolver):
    """The same with central differences: two further solves of the shell for each unknown."""

    name: ClassVar[str] = "fem-identify-differences"
    capabilities: ClassVar[Capabilities] = Capabilities(THEORIES, "fem, derivatives by differences")

    def values(
        self, case: IdentificationCase, logarithms: Array, settings: Any
    ) -> tuple[Array, Array, dict[str, int], Any]:
        """Return quantities, derivatives, numbers of solves and the solution at log p."""
        solution, columns = self._solved(case, logarithms, settings), []
        for step in STEP * np.eye(len(logarithms)):
            ahead, behind = (_measured(self._solved(case, logarithms + s * step, settings)) for s in (1, -1))
            columns.append((ahead - behind) / (2 * STEP))
        count = 1 + 2 * len(columns)
        return _measured(solution), np.stack(columns, axis=1), {"solves": count, "adjoint_solves": 0}, solution


def _measured(solution: Any) -> Array:
    return np.array([q.measure(solution) for q in solution.case.quantities])
