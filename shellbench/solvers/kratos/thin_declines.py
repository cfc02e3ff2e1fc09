"""What Kratos' thin quadrilaterals can't take as they are set up here, each with its reason."""

from __future__ import annotations

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import MomentLoad
from shellbench.problems.shell.places import Edge
from shellbench.problems.shell.quantities import LoadQuantity, Unmarked
from shellbench.problems.shell.symmetry import Part

ALONG = 1e-9  # sine of an angle that is rounding


def reason(part: Part) -> str | None:
    """Return why a case, of which a part is to be solved, can't be taken, as one clause; None if it can."""
    from shellbench.solvers.kratos.thin_conditions import held_rotations

    case = part.whole
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
    for load in case.loads:
        if isinstance(load, MomentLoad) and not all(_is_tangent(case, name, load) for name in load.on):
            return "the axis of a moment is not along its edge"
    return None if case.linear else _reason_on_a_path(part)


def _reason_on_a_path(part: Part) -> str | None:
    case = part.whole
    if case.path.control != "load" or any(isinstance(q, LoadQuantity) for q in case.quantities):
        return "it follows a path by displacement or arc length, and this solver prescribes the load only"
    if case.path.after_buckling == "follow" or any(isinstance(q, Unmarked) for q in case.quantities):
        return "it asks for buckling or turning points, and this solver finds none"
    if any(name.startswith("rotation") for name in part.case.remove_rigid_motions):
        return "it removes rotations, which are not small in the non-linear theory"
    return None


def _is_tangent(case: Case, name: str, load: MomentLoad) -> bool:
    from shellbench.solvers.kratos.thin_conditions import SAMPLES

    edge = case.places[name]
    assert isinstance(edge, Edge)
    domain, running = case.surface.domain, 1 - edge.axis
    points = edge.points(domain, np.linspace(domain.lower[running], domain.upper[running], SAMPLES))
    tangent = case.surface.derivatives(points, order=1)[(0, 1) if running == 1 else (1, 0)]
    crossed = np.linalg.norm(np.cross(tangent, load.axis), axis=-1)
    return bool(np.all(crossed <= ALONG * np.linalg.norm(tangent, axis=-1) * np.linalg.norm(load.axis)))
