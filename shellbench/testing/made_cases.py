"""Cases that the checks derive from others: moved, in other units, with scaled loads, rotated, or shortened."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from shellbench.bench.catalogue.catalog import named_case
from shellbench.problems.formula_text import times
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.variants.placing import Rotation, placed_data
from shellbench.problems.shell.variants.units import Units, converted_data
from shellbench.problems.shell.variants.variants import size

STATIC = (
    "square_plate",
    "scordelis_lo",
    "sleeve_torque",
    "square_plate_nonlinear",
    "cantilever_shear",
    "rigid_rotation",
    "scordelis_lo_naghdi",
)
"""Cheap static cases, the first of which that a solver takes it is examined on."""

MOVING = ("napkin_fixed_edges", "napkin_plane", "napkin_soft_pin", "napkin_corner", "pendulum_strip", "free_fall")
"""The same of motions, cut short."""

CLOSED = ("sleeve_torque", "pinched_cylinder_diaphragm", "sleeve_twist", "sleeve_compression")
"""Cases on a closed surface, for the seam."""

SHORT = 0.1  # duration of a motion, s, in which a napkin falls by 5 cm
CARRIED = 0.01  # of the shell's size: distance of the centre of the supports' rotation from the middle
TURNED, TURNED_FAR = 0.5, 20.0  # degrees that supports turn the shell by, in the linear and the non-linear theory
FALL = "free_fall"
ASKS_WHERE = re.compile(r"\bxi[12]\b|\b[xyz]\b *[-+*/^]")  # in data: a formula of the place


def relocated(case: Case, rotation: Rotation, shift: Sequence[float]) -> Case:
    """Return the case turned about the origin and then shifted; its displacement is the turned displacement."""
    named = {"name": f"{case.name[:53]}_turned", "suites": []}
    return Case.model_validate(placed_data(case, rotation, shift) | named)


def shifted(case: Case, by: Sequence[float]) -> Case | None:
    """Return a plane case moved along its plane, m; None if it is not plane, or if formulas depend on the place.

    Its displacement at the moved points is the original one.
    """
    data = case.model_dump(mode="json", exclude_unset=True)
    surface, points = data.pop("surface"), data.pop("points", {})
    edges = {edge for axis in ("xi1", "xi2") for edge in (f"{axis}_min", f"{axis}_max")}
    anywhere = [place for one in (*data.get("supports", []), *data.get("loads", [])) for place in one.get("on", [])]
    if surface["kind"] != "plane" or set(anywhere) - edges - set(points) or ASKS_WHERE.search(json.dumps(data)):
        return None
    for axis, far in zip(("xi1", "xi2"), by, strict=True):
        surface[axis] = [float(end) + far for end in surface[axis]]
    moved = {name: [float(x) + far for x, far in zip(at, by, strict=True)] for name, at in points.items()}
    named = {"name": f"{case.name[:53]}_slid", "suites": [], "surface": surface, "points": moved}
    return Case.model_validate(data | named)


def rescaled(case: Case, units: Units) -> Case:
    """Return the case in other units. Load factors, times and angles are unchanged."""
    return Case.model_validate(converted_data(case, units) | {"suites": []})


def short_motion(name: str) -> Case:
    """Return a shortened motion of the suite; its headline is its first quantity, at the end."""
    case = named_case(name)
    data = case.model_dump(mode="json", exclude_unset=True)
    spatial = [q for q in data["quantities"] if q["kind"] in ("displacement", "position", "centre_of_mass")]
    headline = {**spatial[0], "name": "headline", "at": SHORT, "primary": True}
    for field in ("tolerance", "absolute", "open_finding"):
        headline.pop(field, None)
    data |= {"name": f"{name}_short", "suites": [], "quantities": [headline], "dynamics": {"until": SHORT}}
    return Case.model_validate(data)


def amplified(case: Case, factor: float) -> Case:
    """Return a case with all loads and prescribed motions times a factor, for linear theory."""
    data = case.model_dump(mode="json", exclude_unset=True) | {"name": case.name, "suites": []}
    for load in data.get("loads", []):
        for name in ("vector", "force", "acceleration"):
            if name in load:
                load[name] = [times(f, factor) for f in load[name]]
        if "value" in load:
            load["value"] = times(load["value"], factor)
    for support in data.get("supports", []):
        motion = support.get("motion") or {}
        for name in ("x", "y", "z", "angle"):
            if name in motion:
                motion[name] = times(motion[name], factor)
        if "vector" in motion:
            motion["vector"] = [times(f, factor) for f in motion["vector"]]
    for quantity in data["quantities"]:
        if "exact" in quantity:
            quantity["exact"] = [times(f, factor) for f in quantity["exact"]]
    return Case.model_validate(data)


def rotated(case: Case) -> Case | None:
    """Return a static case without loads whose supports turn it as a rigid body; None if they can't.

    They can if each of them can be moved, and if together they leave no rigid motion to remove.
    """
    if case.dynamics is not None or case.remove_rigid_motions or not case.supports:
        return None
    if any(support.symmetry for support in case.supports):
        return None
    data: dict[str, Any] = case.model_dump(mode="json", exclude_unset=True)
    angle: Any = TURNED if case.linear else f"{TURNED_FAR!r}*t"
    middle = case.surface.position(np.add(case.surface.domain.lower, case.surface.domain.upper) / 2)
    centre = (middle + CARRIED * size(case)).tolist()
    motion = {"kind": "rotation", "axis": [1.0, 2.0, 3.0], "centre": centre, "angle": angle}
    for support in data["supports"]:
        support["motion"] = motion
    data.pop("path", None)
    headline = {"name": "largest", "kind": "largest_displacement", "primary": True}
    data |= {"name": f"{case.name[:53]}_carried", "suites": [], "loads": [], "quantities": [headline]}
    return Case.model_validate(data)
