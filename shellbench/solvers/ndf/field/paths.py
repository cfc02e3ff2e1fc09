"""Which cases are paths, and which of them a field can't follow."""

from __future__ import annotations

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.quantities import CriticalPoint
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS, Value
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.solvers.ndf.field.factors import turns, why_not_turned

RIGID = 1e-6  # component of a rotation among the rigid motions left free that is rounding


def why_not_followed(case: Case) -> str | None:
    """Return why a field can't follow a non-linear case, as one clause, or None if it can."""
    if case.obstacles and (reason := _why_not_touched(case)) is not None:
        return reason
    for support in case.supports:
        if support.clamped and isinstance(support.motion, Value):
            return f"it can't tell how far the clamped support '{support.name}' turns"
    if (reason := why_not_turned(case)) is not None:
        return reason
    moved = next((support for support in case.supports if support.motion is not None), None)
    if case.path.quantity is not None and moved is not None:
        return f"it can't move support '{moved.name}' on a path with control = '{case.path.control}'"
    free = free_motions(case)
    if case.following and (case.path.quantity is not None or case.path.after_buckling == "follow"):
        return "it follows a pressure along the deformed normal by load steps before buckling only"
    if case.following and free.size:
        return "it needs supports against all rigid motions where a pressure follows the shell"
    if free.size and np.abs(free[3:]).max() > RIGID:
        name = RIGID_MOTIONS[3 + int(np.argmax(np.abs(free[3:]).max(axis=1)))]
        return f"it needs supports against {name} at finite strain"
    return None


def _why_not_touched(case: Case) -> str | None:
    if case.path.control != "load" or case.path.after_buckling == "follow":
        return "it touches obstacles by load steps before buckling only"
    if any(isinstance(q, CriticalPoint) for q in case.quantities):
        return "it tells of no critical points where there are obstacles"
    if case.following or any(isinstance(load, MomentLoad) for load in case.loads) or turns(case):
        return "it touches obstacles at finite strain under dead forces alone, without moments or edges that turn"
    return None


def is_path(case: Case) -> bool:
    """Tell whether a case is solved along a path: in linear theory where all is prescribed, or edge moments act."""
    if not case.linear or any(isinstance(load, MomentLoad) for load in case.loads):
        return True
    return case.prescribed
