"""The solver `kratos-thin`: Kratos' corotational thin quadrilaterals on one structured mesh.

Its answers converge like the square of the cells' size, once the cells are smaller than the shell's layers. On flat
shells the limit of the linear theory is that of Kirchhoff and Love. On curved ones it is that of a neighbouring theory:
flat elements see the change of curvature as that of the normal's turning alone, so that on a cylinder the part
eps_11 / R is missing from kappa_11. This alters answers by a part of order h / R: 2e-4 on the Scordelis-Lo roof, where
h / R = 0.01, 2e-5 where it is ten times thinner. test_thin_limit.py finds the roof's limit from a series.

On a path the load is prescribed, and whether a state is stable is not looked at: beyond a limit point Newton's method
may find a state far from the last one, which is in balance but not where the path from rest leads by equilibria.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from shellbench.model import Finite
from shellbench.problem import Capabilities, ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import ShellSolver
from shellbench.solvers.kratos.settings import KratosSettings

if TYPE_CHECKING:
    from shellbench.solvers.kratos.thin_solution import ThinSolution

STEPS = 4  # load steps of a path
MOST_STEPS = 10_000
TOLERANCE = 1e-8  # of Newton's last step, relative to the shell's size


class KratosThinSettings(KratosSettings):
    """Settings of `KratosThinSolver`."""

    cells: tuple[int, int] | None = Field(
        None, description="cells along xi1 and xi2 of the part that is solved; None: see `usual_cells`"
    )
    symmetry: bool = Field(True, description="whether to solve only the part that planes of symmetry leave")
    steps: int = Field(STEPS, ge=1, le=MOST_STEPS, description="load steps of a path, at least; linear cases have none")
    tolerance: Finite = Field(TOLERANCE, gt=0, le=1e-2, description="Newton's last step, relative to the shell's size")


class KratosThinSolver(ShellSolver):
    """`ShellThinElementCorotational3D4N`: ANDES membrane and discrete Kirchhoff bending in a corotating frame.

    In the linear theory Kratos' stiffness of the shell at rest is all that is used of it.
    """

    name: ClassVar[str] = "kratos-thin"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"),
        label="Kratos Multiphysics: flat thin quadrilaterals (ANDES, DKQ), corotational, small strains",
    )
    settings_type: ClassVar[type[KratosThinSettings]] = KratosThinSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = (
        {"cells": (16, 16)},
        {"cells": (32, 32)},
        {"cells": (64, 64)},
    )

    def declines(self, case: Case) -> str | None:
        """Return why the solver can't take this case, as one clause, or None if it can."""
        return self.declines_with(case, KratosThinSettings())

    def declines_with(self, case: Case, settings: KratosThinSettings) -> str | None:
        """Return why the solver can't take the part of a case that is to be solved, as one clause, or None."""
        from shellbench.problems.shell.symmetry import part_of, whole_of
        from shellbench.solvers.kratos.thin_declines import reason

        return reason(part_of(case) if settings.symmetry else whole_of(case))

    def answer(
        self, case: Case, settings: KratosThinSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> ThinSolution:
        """Solve a case on one mesh.

        Raises
        ------
        SolveFailure
            If a matrix is singular, loads are not in balance, or Newton's method fails; the states that were found
            come with it.
        InputError
            If the mesh does not fit the case.
        """
        from shellbench.solvers.kratos import thin_solving

        return thin_solving.solve(case, settings, progress)

    def load(self, path: Path) -> ThinSolution:
        """Read a solution that `save` wrote; InputError in one sentence if it is none."""
        from shellbench.solvers.kratos.thin_solution import ThinSolution

        return ThinSolution.load(path)
