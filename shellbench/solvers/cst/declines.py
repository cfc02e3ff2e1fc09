"""What the mesh of triangles and hinges can't take, each with its reason."""

from __future__ import annotations

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import MomentLoad
from shellbench.problems.shell.quantities import LoadQuantity, Unmarked


def reason(case: Case) -> str | None:
    """Return why a case can't be taken, as one clause; None if it can."""
    if case.prescribed:
        return "it moves the whole surface as prescribed, and leaves nothing to solve for"
    if any(support.holds_slope for support in case.supports):
        return "it holds slopes on edges, where this mesh has no hinges"
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return "it has moments on edges, where this mesh has no hinges"
    if case.dynamics is None and not case.linear:
        return _reason_on_a_path(case)
    return None


def _reason_on_a_path(case: Case) -> str | None:
    if case.path.control != "load" or any(isinstance(q, LoadQuantity) for q in case.quantities):
        return "it follows a path by displacement or arc length, and this solver prescribes the load only"
    if case.path.after_buckling == "follow" or any(isinstance(q, Unmarked) for q in case.quantities):
        return "it asks for buckling or turning points, and this solver finds none"
    if any(name.startswith("rotation") for name in case.remove_rigid_motions):
        return "it removes rotations, which are not small in the non-linear theory"
    return None
