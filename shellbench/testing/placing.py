"""A case elsewhere in space: turned and shifted as a whole, loads and supports with it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import COMPONENTS
from shellbench.testing.rewriting import combined, substituted

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
        if quantity["kind"] == "torque":
            quantity["centre"] = self.point(quantity.get("centre", (0.0, 0.0, 0.0)))
