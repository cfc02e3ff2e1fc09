"""Variants of a case with the same answer, and its twins in Naghdi's theory, which have answers of their own.

Known values of variants carry over, and a correct solver gives equal answers. A solver that is right only for the usual
axes, metres, or coordinates along lines of curvature fails on them.

A twin is the same shell with normals that shear. Both limits of a thin shell can then be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from shellbench.errors import InputError
from shellbench.problem import Variant
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.quantities.quantities import CentreOfMass, DerivativeQuantity, PositionQuantity
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.variants import reparametrisation
from shellbench.problems.shell.variants.placing import CYCLE, placed_data, turning
from shellbench.problems.shell.variants.units import KILOMETRES_GRAMS, MILLIMETRES_TONNES, Units, converted_data

SHIFT = (0.3, -0.7, 1.1)  # of the shell's size


def size(case: Shell) -> float:
    """Return the diagonal of the box around a shell, m."""
    x = case.surface.position(case.surface.domain.grid(9, 9)).reshape(-1, 3)
    return float(np.linalg.norm(x.max(axis=0) - x.min(axis=0)))


def _permuted(case: Shell) -> dict[str, Any]:
    return placed_data(case, CYCLE)


def _turned(case: Shell) -> dict[str, Any]:
    """Return the case rotated as generally as its supports allow, and shifted if that moves no value."""
    moves = any(isinstance(q, PositionQuantity | CentreOfMass) for q in case.quantities)
    unit = 0.0 if moves else float(f"{size(case):.1g}")  # one digit, so that it is the same everywhere
    return placed_data(case, turning(case), [part * unit for part in SHIFT])


def _in_units(case: Shell, units: Units) -> dict[str, Any]:
    if case.path.control != "load":
        raise InputError("a displacement in metres marks the states of its path")
    if any(q.parameter(case).powers is None for q in _derivatives(case)):
        raise InputError("it has a derivative by a constant of formulas, whose unit is unknown")
    return converted_data(case, units)


def _derivatives(case: Shell) -> list[DerivativeQuantity]:
    return [q for q in case.quantities if isinstance(q, DerivativeQuantity)]


def _with_shear(case: Shell, soft: bool) -> dict[str, Any]:
    """Return the data of a case whose normals shear; soft supports leave them free to turn along an edge."""
    if case.theory == "naghdi-linear" and not soft:
        raise InputError("its normals shear already")
    reasons = (
        (case.dynamics is not None, "it moves, and Naghdi's theory is one of shells at rest here"),
        (not case.linear, "Naghdi's theory is linear here, and this case is not"),
        (case.modal, "it asks for modes or buckling loads, which Naghdi's theory does not give here"),
        (case.material.kind == "orthotropic", "its material is orthotropic, and moduli of its shear are not given"),
        (bool(case.obstacles), "it touches obstacles, which Naghdi's theory does not know here"),
        (
            any(isinstance(load, PointLoad) for load in case.loads),
            "a force at a point moves it without bound if normals shear, so that there is no limit",
        ),
    )
    for refused, why in reasons:
        if refused:
            raise InputError(why)
    data = case.model_dump(mode="json", exclude_unset=True) | {"theory": "naghdi-linear"}
    if soft:
        held = data.get("supports", [])
        holding = [s for s in held if not (s.get("clamped") or s.get("symmetry") or s.get("shear") == "soft")]
        if not holding:
            raise InputError("it has no support that could be made soft: clamps and planes of symmetry are hard")
        for support in holding:
            support["shear"] = "soft"
    return data


def _in_chart(make: reparametrisation.MakeChart) -> Callable[[Shell], dict[str, Any]]:
    def made(case: Shell) -> dict[str, Any]:
        if any(q.parameter(case).group in ("surface", "points") for q in _derivatives(case)):
            raise InputError("it has a derivative by a number of its surface, which other coordinates do not have")
        return reparametrisation.in_chart(case, make)

    return made


VARIANTS: Mapping[str, Variant] = {
    "axes": Variant("axes permuted", _permuted),
    "turned": Variant("turned and shifted in space", _turned),
    "units": Variant("in mm, t and s", partial(_in_units, units=MILLIMETRES_TONNES)),
    "kilometres": Variant("in km, g and s", partial(_in_units, units=KILOMETRES_GRAMS)),
    "flipped": Variant("xi1 reversed, other normal", _in_chart(reparametrisation.flipped)),
    "swapped": Variant("xi1 and xi2 exchanged, other normal", _in_chart(reparametrisation.swapped)),
    "stretched": Variant("coordinates stretched", _in_chart(reparametrisation.stretched)),
    "warped": Variant("coordinates graded", _in_chart(reparametrisation.warped)),
    "oblique": Variant("coordinates oblique", _in_chart(reparametrisation.oblique)),
    "helical": Variant("coordinate lines wound as helices", _in_chart(reparametrisation.helical)),
}
TWINS: Mapping[str, Variant] = {
    "naghdi": Variant("normals that shear", partial(_with_shear, soft=False)),
    "naghdi_soft": Variant("normals that shear, soft supports", partial(_with_shear, soft=True)),
}
