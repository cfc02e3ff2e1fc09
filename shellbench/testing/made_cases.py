"""Cases that the examination makes of others: louder, carried along by their supports, or cut short.

Also here: formulas of a case in other variables: text in, text out, so that a made case is data like any other.

Also here: a case elsewhere in space, turned and shifted as a whole, loads and supports with it.

Also here: a case in other units, every number of it changed as its dimension says, so that the physics stay.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.bench.catalog import named_case
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import COMPONENTS, Formula
from shellbench.problems.shell.surface import COORDINATES


def substituted(formula: Formula, values: Mapping[str, str]) -> Formula:
    """Return a formula with names replaced by expressions; a number stays as it is."""
    if not isinstance(formula, str) or not values:
        return formula
    names = "|".join(map(re.escape, sorted(values, key=len, reverse=True)))
    return re.sub(rf"(?<![\w.])({names})(?!\w)", lambda match: f"({values[match[1]]})", formula)


def times(formula: Formula, factor: float) -> Formula:
    """Return a formula times a number."""
    if factor == 1:
        return formula
    return f"{factor!r}*({formula})" if isinstance(formula, str) else formula * factor


def combined(formulas: Sequence[Formula], weights: Sequence[float]) -> Formula:
    """Return the sum of formulas times numbers."""
    if not any(isinstance(f, str) for f in formulas):
        return sum(float(f) * w for f, w in zip(formulas, weights, strict=True))
    terms = [times(f, w) for f, w in zip(formulas, weights, strict=True) if w != 0 and f != 0]
    return " + ".join(f"({term})" if isinstance(term, str) else f"({term!r})" for term in terms) or 0.0


Array = NDArray[np.float64]

CYCLE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # x to y, y to z, z to x
AXIS, ANGLE = np.array([1.0, 2.0, 3.0]) / math.sqrt(14), math.radians(40)  # of no symmetry that a case might have
SHIFT = (0.3, -0.7, 1.1)  # of the shell's size


def turning(case: Case) -> Array:
    """Return a rotation (3, 3) that the case can be turned by.

    Supports hold Cartesian components. Where some hold a part of them, the axes change places in turn; else the
    rotation is one about an axis askew.
    """
    whole = all(s.symmetry is None and len(s.components) in (0, len(COMPONENTS)) for s in case.supports)
    whole = whole and all(len(s.components) == len(COMPONENTS) for s in case.springs)
    if not whole or case.remove_rigid_motions:
        return CYCLE
    cross = np.cross(np.eye(3), AXIS).T
    return np.eye(3) + math.sin(ANGLE) * cross + (1 - math.cos(ANGLE)) * cross @ cross


def size(case: Case) -> float:
    """Return the diagonal of the box around a shell, m."""
    x = case.surface.position(case.surface.domain.grid(9, 9)).reshape(-1, 3)
    return float(np.linalg.norm(x.max(axis=0) - x.min(axis=0)))


def placed(case: Case, rotation: Array, shift: Array) -> Case:
    """Return the case turned about the origin and then shifted; its displacement is the turned displacement.

    The surface becomes one of formulas. Quantities stay as they are named, and are asked for by nobody.
    """
    return Case.model_validate(_Placing(case, rotation, shift).data())


class _Placing:
    def __init__(self, case: Case, rotation: Array, shift: Array) -> None:
        self.case, self.rotation, self.shift = case, rotation, shift
        self.constants = {name: repr(value) for name, value in case.surface.named_constants.items()}

    def vector(self, vector: Any) -> list[Any]:
        return [combined(vector, [float(w) for w in row]) for row in self.rotation]

    def point(self, point: Any) -> list[float]:
        return (self.rotation @ np.asarray(point, dtype=float) + self.shift).tolist()  # type: ignore[no-any-return]

    def names(self, names: Any) -> list[str]:
        """Return the components that the named ones have become."""
        if len(names) in (0, len(COMPONENTS)):
            return list(names)
        return [COMPONENTS[int(np.argmax(self.rotation[:, COMPONENTS.index(name)]))] for name in names]

    def data(self) -> dict[str, Any]:
        data = self.case.model_dump(mode="json", exclude_unset=True)
        data |= {"name": f"{self.case.name[:53]}_turned", "suites": [], "surface": self._surface()}
        data["supports"] = [self._support(s) for s in data.get("supports", [])]
        for spring in data.get("springs", []):
            if "components" in spring:
                spring["components"] = self.names(spring["components"])
        for load in data.get("loads", []):
            for name in ("vector", "force", "acceleration", "axis"):
                if name in load:
                    load[name] = self.vector(load[name])
            for name in ("vector", "value", "acceleration"):
                if name in load:
                    load[name] = self._without_constants(load[name])
        data["remove_rigid_motions"] = [
            f"{kind}_{self.names([axis])[0]}"
            for kind, _, axis in (name.partition("_") for name in data.get("remove_rigid_motions", []))
        ]
        for quantity in data["quantities"]:
            self._turn_quantity(quantity)
        return data

    def _without_constants(self, formulas: Any) -> Any:
        if isinstance(formulas, list):
            return [substituted(f, self.constants) for f in formulas]
        return substituted(formulas, self.constants)

    def _surface(self) -> dict[str, Any]:
        surface = self.case.surface
        rotated = [
            combined([*surface.formulas, float(s)], [*map(float, row), 1.0])
            for row, s in zip(self.rotation, self.shift, strict=True)
        ]
        return {
            "kind": "expression",
            **dict(zip("xyz", map(str, rotated), strict=True)),
            "xi1": list(surface.xi1),
            "xi2": list(surface.xi2),
            "constants": dict(surface.named_constants),
            "periodic": list(surface.periodic_coordinates),
            "angles": list(surface.angle_coordinates),
        }

    def _support(self, support: Mapping[str, Any]) -> dict[str, Any]:
        result = dict(support)
        if "components" in result:
            result["components"] = self.names(result["components"])
        if result.get("symmetry"):
            result["symmetry"] = self.names([result["symmetry"]])[0]
        motion = dict(result.get("motion") or {})
        if motion:
            if motion["kind"] == "value":
                moved = self.vector([motion.get(c, 0.0) for c in "xyz"])
                motion |= dict(zip("xyz", self._without_constants(moved), strict=True))
            for name in ("vector", "axis"):
                if name in motion:
                    motion[name] = self.vector(motion[name])
            if motion["kind"] == "rotation":
                motion["centre"] = self.point(motion.get("centre", (0.0, 0.0, 0.0)))
            result["motion"] = motion
        return result

    def _turn_quantity(self, quantity: dict[str, Any]) -> None:
        for name in ("direction", "axis"):
            if name in quantity:
                given = quantity[name]
                several = isinstance(given[0], list)
                quantity[name] = [self.vector(d) for d in given] if several else self.vector(given)
        if "exact" in quantity:
            quantity["exact"] = self._without_constants(self.vector(quantity["exact"]))
        if quantity["kind"] == "torque":
            quantity["centre"] = self.point(quantity.get("centre", (0.0, 0.0, 0.0)))


STATIC = (
    "square_plate",
    "scordelis_lo",
    "sleeve_torque",
    "square_plate_nonlinear",
    "cantilever_shear",
    "rigid_rotation",
)
"""Cheap static cases, the first of which that a solver takes it is examined on."""

MOVING = ("napkin_fixed_edges", "napkin_plane", "napkin_soft_pin", "napkin_corner", "pendulum_strip", "free_fall")
"""The same of motions, cut short."""

CLOSED = ("sleeve_torque", "pinched_cylinder_diaphragm", "sleeve_twist", "sleeve_compression")
"""Cases on a closed surface, for the seam."""

SHORT = 0.1  # s: of a motion, long enough that a napkin under gravity has moved by 5 cm
CARRIED = 0.01  # of the shell's size: distance of the centre of the supports' rotation from the middle
TURNED, TURNED_FAR = 0.5, 20.0  # degrees that supports turn the shell by, in the linear and the non-linear theory
FALL = "free_fall"


def short_motion(name: str) -> Case:
    """Return a motion of the suite cut short; its headline is what it asks for first, at the end."""
    case = named_case(name)
    data = case.model_dump(mode="json", exclude_unset=True)
    spatial = [q for q in data["quantities"] if q["kind"] in ("displacement", "position", "centre_of_mass")]
    headline = {**spatial[0], "name": "headline", "at": SHORT, "primary": True}
    for field in ("tolerance", "absolute", "open_finding"):
        headline.pop(field, None)
    data |= {"name": f"{name}_short", "suites": [], "quantities": [headline], "dynamics": {"until": SHORT}}
    return Case.model_validate(data)


def louder(case: Case, factor: float) -> Case:
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


def carried(case: Case) -> Case | None:
    """Return a static case without loads whose supports turn it as a rigid body; None if they can't.

    They can if each can be moved, and together they leave no rigid motion to be removed.
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


@dataclass(frozen=True)
class Units:
    """How many new units there are in the old one: 1000 millimetres in a metre.

    Attributes
    ----------
    length, force
        Of metres and newtons. The unit of time stays.
    """

    length: float
    force: float
    words: str


MILLIMETRES = Units(1000.0, 1e-3, "millimetres and kilonewtons")


def converted(case: Case, units: Units) -> Case:
    """Return the case in other units. Load factors, times and angles are what they were."""
    return Case.model_validate(_Conversion(case, units).data())


def converted_points(case: Case, units: Units, points: Array) -> Array:
    """Return points (..., 2) of a case as points of the converted one."""
    return points * [1.0 if angle else units.length for angle in case.surface.domain.angle]


class _Conversion:
    def __init__(self, case: Case, units: Units) -> None:
        self.case, self.units = case, units
        surface = case.surface
        self.names = {name: repr(value) for name, value in surface.named_constants.items()}
        for name, angle in zip(COORDINATES, surface.domain.angle, strict=True):
            if not angle:
                self.names[name] = f"{name}/{units.length!r}"

    def formula(self, formula: Formula, length: int, force: int = 0) -> Formula:
        """Convert what has the dimension length**length force**force (mass is force time^2 / length)."""
        return times(substituted(formula, self.names), self.factor(length, force))

    def factor(self, length: int, force: int = 0) -> float:
        return self.units.length**length * self.units.force**force

    def vector(self, vector: Any, length: int, force: int = 0) -> list[Formula]:
        return [self.formula(f, length, force) for f in vector]

    def data(self) -> dict[str, Any]:
        data = self.case.model_dump(mode="json", exclude_unset=True)
        data |= {"name": self.case.name, "units": self.units.words, "suites": []}
        data["surface"] = self._surface(data["surface"])
        material = data["material"]
        material["youngs_modulus"] *= self.factor(-2, 1)
        material["thickness"] *= self.units.length
        if "areal_density" in material:
            material["areal_density"] *= self.factor(-3, 1)
        data["points"] = {
            name: converted_points(self.case, self.units, np.asarray(xi, dtype=float)).tolist()
            for name, xi in data.get("points", {}).items()
        }
        data["supports"] = [self._support(s) for s in data.get("supports", [])]
        data["springs"] = [{**s, "stiffness": self.formula(s["stiffness"], -3, 1)} for s in data.get("springs", [])]
        data["loads"] = [self._load(load) for load in data.get("loads", [])]
        marks = self.units.length if self.case.path.control != "load" else 1.0  # a path may be marked by displacements
        if "path" in data:
            for name in ("until", "states"):
                if name in data["path"]:
                    data["path"][name] = (np.asarray(data["path"][name]) * marks).tolist()
        for quantity in data["quantities"]:
            if "at" in quantity:
                quantity["at"] *= marks
            if "centre" in quantity:
                quantity["centre"] = self.vector(quantity["centre"], 1)
            if "exact" in quantity:
                quantity["exact"] = self.vector(quantity["exact"], 1)
        return data

    def _surface(self, surface: Mapping[str, Any]) -> dict[str, Any]:
        result = dict(surface)
        for name, angle in zip(COORDINATES, self.case.surface.domain.angle, strict=True):
            if not angle:
                result[name] = [bound * self.units.length for bound in surface[name]]
        if "radius" in result:
            result["radius"] *= self.units.length
        if surface["kind"] == "expression":
            result |= {c: self.formula(surface[c], 1) for c in "xyz"} | {"constants": {}}
        return result

    def _support(self, support: Mapping[str, Any]) -> dict[str, Any]:
        motion = support.get("motion")
        if motion is None:
            return dict(support)
        moved = dict(motion)
        for name in "xyz":
            if name in moved:
                moved[name] = self.formula(moved[name], 1)
        for name in ("vector", "centre"):
            if name in moved:
                moved[name] = self.vector(moved[name], 1)
        if "angle" in moved:
            moved["angle"] = self.formula(moved["angle"], 0)
        return {**support, "motion": moved}

    def _load(self, load: Mapping[str, Any]) -> dict[str, Any]:
        match load["kind"]:
            case "area":
                return {**load, "vector": self.vector(load["vector"], -2, 1)}
            case "pressure":
                return {**load, "value": self.formula(load["value"], -2, 1)}
            case "gravity":
                return {**load, "acceleration": self.vector(load["acceleration"], 1)}
            case "edge":
                return {**load, "vector": self.vector(load["vector"], -1, 1)}
            case "point":
                return {**load, "force": self.vector(load["force"], 0, 1)}
        return {**load, "value": self.formula(load["value"], 0, 1)}
