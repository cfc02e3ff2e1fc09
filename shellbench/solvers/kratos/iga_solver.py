"""The solver `kratos-iga`: Kirchhoff-Love NURBS shells of Kratos' IgaApplication, put to the questions of the suite."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field

from shellbench.model import Finite
from shellbench.problem import Capabilities, ProgressCallback, Settings, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solver import ShellSolver
from shellbench.solvers.kratos.settings import KratosSettings

if TYPE_CHECKING:
    from shellbench.solvers.kratos.iga_solution import IgaSolution

MOST_CELLS = 256  # along a coordinate: 200 000 unknowns and a million quadrature points, more than is of use here
Spans = Annotated[int, Field(ge=1, le=MOST_CELLS, strict=True)]


class KratosIgaSettings(KratosSettings):
    """Settings of `KratosIgaSolver`."""

    degree: int = Field(3, ge=2, le=5, strict=True, description="of the splines along both coordinates")
    cells: tuple[Spans, Spans] = Field((32, 32), description="spans along xi1 and xi2 of the part that is solved")
    grading: Finite = Field(
        2.0, ge=1, le=4, description="exponent of the knot lines' distances from a point load; 1: uniform"
    )
    symmetry: bool = Field(True, description="whether to solve only the part that planes of symmetry leave")
    rounding: Finite = Field(
        1e-6,
        gt=0,
        le=1e-3,
        description="change of the loads' work by rounding above which a linear answer is corrected",
    )
    load_steps: int = Field(20, ge=1, le=10000, strict=True, description="fewest steps of a non-linear path")


class KratosIgaSolver(ShellSolver):
    """Kratos' rotation-free NURBS shell on one patch, cut down by planes of symmetry."""

    name: ClassVar[str] = "kratos-iga"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"),
        label="Kratos, isogeometric Kirchhoff-Love shell",
    )
    settings_type: ClassVar[type[Settings]] = KratosIgaSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = (
        {"cells": (4, 4)},
        {"cells": (8, 8)},
        {"cells": (16, 16)},
    )

    def declines(self, case: Case) -> str | None:
        """Return why the solver can't take this case, as one clause, or None if it can."""
        from shellbench.solvers.kratos import iga_declines

        return iga_declines.reason(case)

    def declines_with(self, case: Case, settings: KratosIgaSettings) -> str | None:
        """Return why the solver can't take the part of a case that is to be solved, as one clause, or None."""
        from shellbench.problems.shell.symmetry import part_of, whole_of
        from shellbench.solvers.kratos import iga_declines

        return iga_declines.reason(case, part_of(case) if settings.symmetry else whole_of(case))

    def answer(
        self, case: Case, settings: KratosIgaSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> IgaSolution:
        """Solve a case on one patch.

        Raises
        ------
        SolveFailure
            If Kratos gives up, Newton's method fails, or forces are not in balance; the states that were found come
            with it.
        """
        from shellbench.solvers.kratos import iga_solving

        return iga_solving.solve(case, settings, progress)

    def load(self, path: Path) -> IgaSolution:
        """Read a solution that `save` wrote; InputError in one sentence if it is none."""
        from shellbench.solvers.kratos.iga_solution import IgaSolution

        return IgaSolution.load(path)
