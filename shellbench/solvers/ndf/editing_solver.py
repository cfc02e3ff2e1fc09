"""The solvers `ndf-edit` and `ndf-ritz-edit`: fields for a shell and then for an edit of it."""

from __future__ import annotations

from typing import ClassVar

from shellbench.problem import Capabilities, Settings, Solution
from shellbench.problems.series.edited import EditingCase
from shellbench.problems.series.edited_answer import THEORIES, EditingSolver
from shellbench.problems.solving import CheckedSolver
from shellbench.solvers.ndf.linear.ritz_settings import RitzSettings
from shellbench.solvers.ndf.ritz_solver import RitzSolver
from shellbench.solvers.ndf.trainer_solver import NdfSolver
from shellbench.solvers.ndf.training.trainer_settings import TrainerSettings


class NdfEditSolver(EditingSolver):
    """A trained field that keeps its hidden layers over an edit, compared with a training from scratch."""

    name: ClassVar[str] = "ndf-edit"
    capabilities: ClassVar[Capabilities] = Capabilities(THEORIES, "ndf, its hidden layers kept over an edit")
    settings_type: ClassVar[type[Settings]] = TrainerSettings
    shells: ClassVar[type[CheckedSolver]] = NdfSolver

    def energy(self, solution: Solution) -> float:
        """Return the energy on the finest quadrature."""
        return float(solution.diagnostics["certified_energy"])


class NdfRitzEditSolver(NdfEditSolver):
    """A field of random features that continues from an earlier path's states, compared with a path from scratch."""

    name: ClassVar[str] = "ndf-ritz-edit"
    capabilities: ClassVar[Capabilities] = Capabilities(THEORIES, "ndf-ritz, from the path before an edit")
    settings_type: ClassVar[type[Settings]] = RitzSettings
    shells: ClassVar[type[CheckedSolver]] = RitzSolver

    def goes_on(self, case: EditingCase) -> str | None:
        """Return the reason that an earlier solution is of no use, or None: linear shells need no training."""
        return "it trains nothing that a linear shell's edit could keep" if case.edited.linear else None
