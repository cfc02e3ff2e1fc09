"""The solver `kratos-thin`: Kratos' corotational thin quadrilaterals on one structured mesh.

Its answers converge like the square of the cells' size, once the cells are smaller than the shell's layers. On flat
shells the limit of the linear theory is that of Kirchhoff and Love. On curved ones it is that of a neighbouring theory:
flat elements see the change of curvature as that of the normal's turning alone, so that on a cylinder the part
eps_11 / R is missing from kappa_11. This alters answers by a part of order h / R: 2e-4 on the Scordelis-Lo roof, where
h / R = 0.01, 2e-5 where it is ten times thinner. test_thin_limit.py finds the roof's limit from a series.

On a path the load is prescribed, and stability is not checked: beyond a limit point Newton's method may find a state
far from the last one, which is in balance but not on the path of equilibria from rest.

This module also has the reasons for which the solver declines cases.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from shellbench.problem import Capabilities, ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import why_not_by_load, why_not_plain
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.solution import ShellSolver
from shellbench.problems.shell.symmetry.symmetry import Part
from shellbench.protocol.schema import Finite
from shellbench_kratos.settings import KratosSettings

if TYPE_CHECKING:
    from shellbench_kratos.thin_solution import ThinSolution

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
        """Return the reason why the solver can't take this case, as one clause, or None if it can."""
        return self.declines_with(case, KratosThinSettings())

    def declines_with(self, case: Case, settings: KratosThinSettings) -> str | None:
        """Return the reason why the solver can't take the part of a case to be solved, as one clause, or None."""
        from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of
        from shellbench_kratos.thin_solver import reason

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
        from shellbench_kratos import thin_solving

        return thin_solving.solve(case, settings, progress)

    def load(self, path: Path) -> ThinSolution:
        """Read a solution that `save` wrote; InputError in one sentence for other files."""
        from shellbench_kratos.thin_solution import ThinSolution

        return ThinSolution.load(path)


ALONG = 1e-9  # sine of an angle that is rounding


def reason(part: Part) -> str | None:
    """Return the reason why the solver can't take a part of a case, as one clause; None if it can."""
    from shellbench_kratos.thin_mesh import held_rotations

    case = part.whole
    if refusal := why_not_plain(case):
        return refusal
    if case.dynamics is not None:
        return "it moves in time, and this solver is static"
    if case.prescribed:
        return "it moves the whole surface as prescribed, and leaves nothing to solve for"
    if case.material.bending_factor != 1.0:
        return "its bending stiffness is not that of a homogeneous shell, which this element's section is"
    for support, place in case.supported_places():
        rotations = held_rotations(case, place, support)
        if rotations is None:
            return f"the edge '{place.name}' is clamped, and its tangent is along no coordinate axis"
        if rotations and support.motion is not None and support.motion.kind != "translation":
            return f"the clamped edge '{place.name}' turns"
    if case.following:
        return "its pressure follows the shell, where this solver's loads are dead"
    for load in case.loads:
        if isinstance(load, MomentLoad) and not all(_is_tangent(case, name, load) for name in load.on):
            return "the axis of a moment is not along its edge"
    return None if case.linear else why_not_by_load(case, part.case.remove_rigid_motions)


def _is_tangent(case: Case, name: str, load: MomentLoad) -> bool:
    from shellbench_kratos.thin_mesh import SAMPLES

    edge = case.places[name]
    assert isinstance(edge, Edge)
    domain, running = case.surface.domain, 1 - edge.axis
    points = edge.points(domain, np.linspace(domain.lower[running], domain.upper[running], SAMPLES))
    tangent = case.surface.derivatives(points, order=1)[(0, 1) if running == 1 else (1, 0)]
    crossed = np.linalg.norm(np.cross(tangent, load.axis), axis=-1)
    return bool(np.all(crossed <= ALONG * np.linalg.norm(tangent, axis=-1) * np.linalg.norm(load.axis)))
