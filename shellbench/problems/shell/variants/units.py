"""A shell in other units: every number of its case is scaled by its dimension, so that the physics stay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.formula_text import Formula, substituted, times
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import COORDINATES

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Units:
    """Number of new units in the old one, such as 1000 millimetres in a metre.

    Attributes
    ----------
    length, force
        Factors of metres and newtons. The unit of time stays.
    """

    length: float
    force: float
    words: str

    def factor(self, length: int, force: int = 0) -> float:
        """Return the factor of a number of dimension length**length force**force."""
        return self.length**length * self.force**force


MILLIMETRES_KILONEWTONS = Units(1000.0, 1e-3, "millimetres and kilonewtons")
MILLIMETRES_TONNES = Units(1000.0, 1.0, "mm, t, s")  # whose unit of force is the newton
KILOMETRES_GRAMS = Units(1e-3, 1.0, "km, g, s")  # whose unit of force is the newton, too


def converted_data(case: Shell, units: Units) -> dict[str, Any]:
    """Return the data of a case in other units. Load factors, times and angles stay."""
    return _Conversion(case, units).data()


def converted_points(case: Shell, units: Units, points: Array) -> Array:
    """Return points (..., 2) of a case as points of the converted one."""
    return points * [1.0 if angle else units.length for angle in case.surface.domain.angle]


class _Conversion:
    def __init__(self, case: Shell, units: Units) -> None:
        self.case, self.units = case, units
        surface = case.surface
        self.names = {name: repr(value) for name, value in surface.named_constants.items()}
        for name, angle in zip(COORDINATES, surface.domain.angle, strict=True):
            if not angle:
                self.names[name] = f"{name}/{units.length!r}"

    def formula(self, formula: Formula, length: int, force: int = 0) -> Formula:
        """Convert a formula of the dimension length**length force**force (mass is force time^2 / length)."""
        return times(substituted(formula, self.names), self.units.factor(length, force))

    def vector(self, vector: Any, length: int, force: int = 0) -> list[Formula]:
        return [self.formula(f, length, force) for f in vector]

    def data(self) -> dict[str, Any]:
        factor = self.units.factor
        data = self.case.model_dump(mode="json", exclude_unset=True)
        data |= {"units": self.units.words, "surface": self._surface(data["surface"])}
        material = data["material"]
        for name, powers in (
            ("youngs_modulus", (-2, 1)),
            ("shear_modulus", (-2, 1)),
            ("membrane", (-1, 1)),
            ("bending", (1, 1)),
        ):
            if name in material:
                material[name] = (factor(*powers) * np.asarray(material[name])).tolist()
        material["thickness"] *= self.units.length
        for name in ("modulus_factor", "thickness_factor"):
            if name in material:
                material[name] = self.formula(material[name], 0)
        if "areal_density" in material:
            material["areal_density"] *= factor(-3, 1)
        data["points"] = {
            name: converted_points(self.case, self.units, np.asarray(xi, dtype=float)).tolist()
            for name, xi in data.get("points", {}).items()
        }
        for name, part in data.get("edge_parts", {}).items():
            edge = self.case.places[name]
            if isinstance(edge, Edge) and not self.case.surface.domain.angle[1 - edge.axis]:
                part["between"] = [x * self.units.length for x in part["between"]]
        data["supports"] = [self._support(s) for s in data.get("supports", [])]
        data["springs"] = [{**s, "stiffness": self.formula(s["stiffness"], -3, 1)} for s in data.get("springs", [])]
        data["loads"] = [self._load(load) for load in data.get("loads", [])]
        marks = self.units.length if self.case.path.control != "load" else 1.0  # a path may be marked by displacements
        if "path" in data:
            for name in ("until", "states"):
                if name in data["path"]:
                    data["path"][name] = (np.asarray(data["path"][name]) * marks).tolist()
        for obstacle in data.get("obstacles", []):
            if obstacle["kind"] == "formula":
                raise InputError("an obstacle of kind 'formula' stays in its units")
            for name in ("centre", "half_axis", "half_sides"):
                if name in obstacle:
                    obstacle[name] = self.vector(obstacle[name], 1)
            for name in ("radius", "half_thickness"):
                if name in obstacle:
                    obstacle[name] *= self.units.length
        for quantity, asked in zip(data["quantities"], self.case.quantities, strict=True):
            if "at" in quantity:
                quantity["at"] *= marks
            if "centre" in quantity:
                quantity["centre"] = self.vector(quantity["centre"], 1)
            if "exact" in quantity:
                quantity["exact"] = self.vector(quantity["exact"], 1)
            back = 1 / factor(*asked.dimension(self.case))
            if back != 1:
                quantity["factor"] = asked.factor * back
        return data

    def _surface(self, surface: Mapping[str, Any]) -> dict[str, Any]:
        if surface["kind"] == "mesh":
            raise InputError("its surface is a mesh, which stays in the units of its file")
        result = dict(surface)
        for name, angle in zip(COORDINATES, self.case.surface.domain.angle, strict=True):
            if not angle:
                result[name] = [bound * self.units.length for bound in surface[name]]
                for kind in ("folds", "hinges"):
                    if name in surface.get(kind, {}):
                        result[kind] = {name: [at * self.units.length for at in surface[kind][name]]}
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
