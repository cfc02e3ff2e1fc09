"""What the solver on Kratos' shell element can't take, each with its reason."""

from __future__ import annotations

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import MomentLoad, PointLoad
from shellbench.problems.shell.places import Edge, Point, Whole
from shellbench.problems.shell.quantities import CriticalPoint, DisplacementQuantity
from shellbench.problems.shell.symmetry import Part, part_of
from shellbench.solvers.kratos.iga_conditions import corner_of, tied_by


def reason(case: Case, part: Part | None = None) -> str | None:
    """Return why a case can't be taken, as one clause; None if it can. `part` is found if it is not given."""
    if case.dynamics is not None:
        return "it moves by Newton's law, and this solver takes static cases"
    if any(isinstance(place, Whole) for _, place in case.supported_places()):
        return "it prescribes the whole surface, or a component of it, and this solver holds edges and corners"
    if any(support.motion is not None for support in case.supports):
        return "its supports move, and this solver holds them still"
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return "it has moments on edges, which Kratos' element without rotations does not take"
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
    place = part.seen(case.places[load.on[0]])
    corner = corner_of(part.case, place.xi) if isinstance(place, Point) else None
    components = [c for c in range(3) if quantity.directions[0][c] != 0]
    acting = [c for c in range(3) if case.scalar(load.force[c], 1.0) != 0]
    if corner is None or len(components) != 1 or components != acting:
        return None
    return components[0], corner, 1.0 if quantity.directions[0][components[0]] > 0 else -1.0
