"""From a case of shellbench to the few numbers that the series needs, or the reason why it is impossible.

`declines` must be honest: it names the first feature of the case that the mechanics does not have. The reason is shown
as "not applicable: ...", and has no other effect. A wrong answer is a red row.
"""

from __future__ import annotations

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import why_not_plain
from shellbench.problems.shell.question.loads import AreaLoad, PressureLoad

from plate_series.plate import Plate

EDGES = {"xi1_min", "xi1_max", "xi2_min", "xi2_max"}


def declines(case: Case) -> str | None:
    """Return the reason why the series can't take a case, as one clause, or None if it can."""
    if reason := why_not_plain(case):  # modes, contact, stress resultants and what else only some solvers answer
        return reason
    if case.dynamics is not None:
        return "it has no motion in time"
    if case.surface.kind != "plane":
        return "it solves flat plates only"
    if case.springs or case.remove_rigid_motions:
        return "it has no springs and no free rigid motions"
    return _declines_supports(case) or _declines_loads(case)


def _declines_supports(case: Case) -> str | None:
    if len(case.supports) != 1 or set(case.supports[0].on) != EDGES:
        return "it needs one support, on all four edges"
    rim = case.supports[0]
    if set(rim.held) != {"x", "y", "z"} or rim.holds_slope:
        return "it needs a rim that is held and free to turn"
    return "it has no supports that move" if rim.motion is not None else None


def _declines_loads(case: Case) -> str | None:
    for load in case.loads:
        if not isinstance(load, AreaLoad | PressureLoad):
            return f"it has no loads of kind '{load.kind}'"
        numbers = load.vector if isinstance(load, AreaLoad) else (0.0, 0.0, load.value)
        if any(isinstance(number, str) for number in numbers):
            return "it has uniform loads only, given as numbers"
        if any(numbers[:2]):
            return "it has loads along the normal only"
    return None


def plate_of(case: Case) -> Plate:
    """Return the data that the series needs from a case that it does not decline."""
    domain = case.surface.domain
    load = sum(
        float(load.vector[2] if isinstance(load, AreaLoad) else load.value)
        for load in case.loads
        if isinstance(load, AreaLoad | PressureLoad)
    )
    return Plate(
        lower=domain.lower,
        size=domain.size,
        bending_stiffness=case.material.bending_stiffness,
        poissons_ratio=case.material.poissons_ratio,
        load=load,
    )
