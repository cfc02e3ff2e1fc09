"""The solver `fem-edit`: `fem` for a shell and then for an edit of it."""

from __future__ import annotations

from typing import ClassVar

from shellbench.problem import Capabilities, Settings, Solution
from shellbench.problems.series.edited_answer import THEORIES, EditingSolver
from shellbench.problems.solving import CheckedSolver
from shellbench.solvers.fem.settings import FemSettings
from shellbench.solvers.fem.solver import FemSolver


class FemEditSolver(EditingSolver):
    """Finite elements that start from an earlier solution, compared with a solve from scratch."""

    name: ClassVar[str] = "fem-edit"
    capabilities: ClassVar[Capabilities] = Capabilities(THEORIES, "fem, from the solution before an edit")
    settings_type: ClassVar[type[Settings]] = FemSettings
    shells: ClassVar[type[CheckedSolver]] = FemSolver

    def energy(self, solution: Solution) -> float:
        """Return the potential energy on the last mesh, J: an upper bound, since the elements are conforming."""
        return [step.energy for step in solution.history if step.phase == "solve"][-1]
