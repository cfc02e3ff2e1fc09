"""The solver `kratos-iga`: Kirchhoff-Love NURBS shells of Kratos' IgaApplication.

This module also has the reasons for which the solver declines cases.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field

from shellbench.problem import Capabilities, ProgressCallback, Settings, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import why_not_plain
from shellbench.problems.shell.quantities.quantities import CriticalPoint, DisplacementQuantity
from shellbench.problems.shell.question.loads import MomentLoad, PointLoad
from shellbench.problems.shell.question.places import Edge, Point, Whole
from shellbench.problems.shell.solution import ShellSolver
from shellbench.problems.shell.symmetry.symmetry import Part, part_of
from shellbench.protocol.schema import Finite
from shellbench_kratos.iga_conditions import corner_of, tied_by
from shellbench_kratos.settings import KratosSettings

if TYPE_CHECKING:
    from shellbench_kratos.iga_solution import IgaSolution


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
        """Return the reason why the solver can't take this case, as one clause, or None if it can."""
        return reason(case)

    def declines_with(self, case: Case, settings: KratosIgaSettings) -> str | None:
        """Return the reason why the solver can't take the part of a case to be solved, as one clause, or None."""
        from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of

        return reason(case, part_of(case) if settings.symmetry else whole_of(case))

    def answer(
        self, case: Case, settings: KratosIgaSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> IgaSolution:
        """Solve a case on one patch.

        Raises
        ------
        SolveFailure
            If Kratos gives up, Newton's method fails, or forces are not in balance; it carries the states found before.
        """
        from shellbench_kratos import iga_solving

        return iga_solving.solve(case, settings, progress)

    def load(self, path: Path) -> IgaSolution:
        """Read a solution that `save` wrote; InputError in one sentence for other files."""
        from shellbench_kratos.iga_solution import IgaSolution

        return IgaSolution.load(path)


def reason(case: Case, part: Part | None = None) -> str | None:
    """Return the reason why a case can't be taken, as one clause; None if it can. `part` is computed if it is None."""
    if refusal := why_not_plain(case):
        return refusal
    if case.dynamics is not None:
        return "it moves by Newton's law, and this solver takes static cases"
    if any(isinstance(place, Whole) for _, place in case.supported_places()):
        return "it prescribes the whole surface, or a component of it, and this solver holds edges and corners"
    if any(support.motion is not None for support in case.supports):
        return "its supports move, and this solver holds them still"
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return "it has moments on edges, which Kratos' element without rotations does not take"
    if case.following:
        return "its pressure follows the shell, where this solver's loads are dead"
    if case.material.bending_factor != 1.0:
        return "its bending stiffness is scaled, and Kratos' element derives it from the thickness"
    part = part or part_of(case)
    return _reason_of_the_part(part.case) or (None if case.linear else _reason_on_a_path(part))


def _reason_of_the_part(case: Case) -> str | None:
    for axis, closed in enumerate(case.surface.domain.periodic):
        if closed:
            return f"it is closed in xi{axis + 1}, and no plane of symmetry cuts it open"
    if case.remove_rigid_motions:
        return f"it removes the rigid motion {case.remove_rigid_motions[0]}, which no plane of symmetry holds"
    for support, place in case.supported_places():
        if isinstance(place, Edge) and tied_by(case, support, place) is None:
            return (
                f"support '{support.name}' holds the slope on {place.name}, which is not in a Cartesian plane, or"
                " oblique to the coordinate lines"
            )
        if isinstance(place, Point) and corner_of(case, place.xi) is None:
            return f"support '{support.name}' holds {place.name}, which is no corner of the part that is solved"
    return None


def _reason_on_a_path(part: Part) -> str | None:
    case = part.whole
    if case.path.control == "arc_length":
        return "it follows a path by arc length, which Kratos' strategy for it does not with tied control points"
    if case.path.after_buckling == "follow" or any(isinstance(q, CriticalPoint) for q in case.quantities):
        return "it asks for buckling, and this solver looks at no stability"
    if any(name.startswith("rotation") for name in case.remove_rigid_motions):
        return "it removes rotations, which are not small in the non-linear theory"
    if case.path.control == "displacement" and controlled(part) is None:
        return "it follows a path by a displacement that is not the one under its only load, a point load at a corner"
    return None


def controlled(part: Part) -> tuple[int, tuple[int, int], float] | None:
    """Return the component of the corner that is displaced along a path by displacement, if the only load acts there.

    Returns
    -------
    tuple or None
        Component, control point, and the sign with which the component enters the path's quantity.
    """
    case = part.whole
    quantity = next((q for q in case.quantities if q.name == case.path.quantity), None)
    if not isinstance(quantity, DisplacementQuantity) or len(case.loads) != 1:
        return None
    load = case.loads[0]
    if not isinstance(load, PointLoad) or len(load.on) != 1 or quantity.points != load.on:
        return None
    place = part.place_on_part(case.places[load.on[0]])
    corner = corner_of(part.case, place.xi) if isinstance(place, Point) else None
    components = [c for c in range(3) if quantity.directions[0][c] != 0]
    acting = [c for c in range(3) if case.scalar(load.force[c], 1.0) != 0]
    if corner is None or len(components) != 1 or components != acting:
        return None
    return components[0], corner, 1.0 if quantity.directions[0][components[0]] > 0 else -1.0
