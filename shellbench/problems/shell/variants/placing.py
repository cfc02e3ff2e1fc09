"""A shell at another place: rotated and shifted as a whole, with its loads and supports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.formula_text import combined, substituted
from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.question.conditions import COMPONENTS, LOCAL

Rotation = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
"""A rotation matrix, by rows. Products are summed by Python, so that they have the same digits everywhere."""

CYCLE: Rotation = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))  # x to y, y to z, z to x
COSINE, SINE = 0.8, 0.6  # of an angle that no symmetry of a case has
# About z by the angle above, then about x by that of the triangle 5, 12, 13.
ASKEW: Rotation = (
    (COSINE, -SINE, 0.0),
    (SINE * 12 / 13, COSINE * 12 / 13, -5 / 13),
    (SINE * 5 / 13, COSINE * 5 / 13, 12 / 13),
)


ABOUT: tuple[Rotation, Rotation, Rotation] = (
    ((1.0, 0.0, 0.0), (0.0, COSINE, -SINE), (0.0, SINE, COSINE)),
    ((COSINE, 0.0, SINE), (0.0, 1.0, 0.0), (-SINE, 0.0, COSINE)),
    ((COSINE, -SINE, 0.0), (SINE, COSINE, 0.0), (0.0, 0.0, 1.0)),
)
"""Rotations about the coordinate axes."""
SAME_AXIS = 1e-13  # cosine of an angle, short of 1, that is rounding


def turning(case: Shell) -> Rotation:
    """Return a rotation after which the case's supports still hold Cartesian components.

    Supports, springs and removed rigid motions that take all components or none follow any rotation. Those that take
    one component, or all but one, follow a rotation about that axis. If they name different axes, axes change places.
    """
    axes = set(_axes(case))
    if not axes:
        return ASKEW
    return ABOUT[axes.pop()] if len(axes) == 1 else CYCLE


def _axes(case: Shell) -> Iterator[int]:
    """Yield the axes that some support, spring or removed motion treats unlike the other two."""
    motions = {kind: [n[-1] for n in case.remove_rigid_motions if n.startswith(kind)] for kind in ("trans", "rot")}
    for held in (
        *(s.held for s in case.supports if not s.local),
        *(s.components for s in case.springs),
        *motions.values(),
    ):
        places = {COMPONENTS.index(name) for name in held}
        if len(places) in (1, 2):
            yield (places if len(places) == 1 else {0, 1, 2} - places).pop()


def keeps_components(case: Shell, rotation: NDArray[np.float64]) -> bool:
    """Return True if the held Cartesian components stay the same ones after a rotation (3, 3) of the shell."""
    return all(rotation[axis, axis] >= 1 - SAME_AXIS for axis in _axes(case))


def placed_data(case: Shell, rotation: Rotation, shift: Sequence[float] = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """Return the data of a case turned about the origin and then shifted, m.

    Its displacement is the rotated displacement, and its quantities keep their values; only positions along a direction
    move with the shift. The surface becomes one of formulas.
    """
    return _Placing(case, rotation, shift).data()


class _Placing:
    def __init__(self, case: Shell, rotation: Rotation, shift: Sequence[float]) -> None:
        self.case, self.rotation, self.shift = case, rotation, shift
        self.constants = {name: repr(value) for name, value in case.surface.named_constants.items()}

    def vector(self, vector: Any) -> list[Any]:
        return [combined(vector, row) for row in self.rotation]

    def point(self, point: Any) -> list[float]:
        return [float(turned) + moved for turned, moved in zip(self.vector(point), self.shift, strict=True)]

    def names(self, names: Any) -> list[str]:
        """Return the components into which the named ones turn."""
        if len(names) in (0, len(COMPONENTS)) or set(names) <= set(LOCAL):
            return list(names)
        columns = np.array(self.rotation)
        return [COMPONENTS[int(np.argmax(columns[:, COMPONENTS.index(name)]))] for name in names]

    def data(self) -> dict[str, Any]:
        data = self.case.model_dump(mode="json", exclude_unset=True)
        data["surface"] = self._surface()
        data["supports"] = [self._support(s) for s in data.get("supports", [])]
        for spring in data.get("springs", []):
            if "components" in spring:
                spring["components"] = self.names(spring["components"])
        for load in data.get("loads", []):
            for name in ("vector", "force", "acceleration", "axis"):
                if name in load and load.get("frame") != "local":
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
        for obstacle in data.get("obstacles", []):
            self._turn_obstacle(obstacle)
        return data

    def _turn_obstacle(self, obstacle: dict[str, Any]) -> None:
        axes = np.abs(np.array(self.rotation))
        if obstacle["kind"] == "formula" or (obstacle["kind"] == "box" and not np.all((axes == 0) | (axes == 1))):
            raise InputError(f"an obstacle of kind '{obstacle['kind']}' does not turn")
        obstacle["centre"] = [
            combined([*obstacle["centre"], float(s)], [*row, 1.0])
            for row, s in zip(self.rotation, self.shift, strict=True)
        ]
        for name in ("normal", "half_axis"):
            if name in obstacle:
                obstacle[name] = self.vector(obstacle[name])
        if "half_sides" in obstacle:
            obstacle["half_sides"] = [abs(float(side)) for side in self.vector(obstacle["half_sides"])]

    def _without_constants(self, formulas: Any) -> Any:
        if isinstance(formulas, list):
            return [substituted(f, self.constants) for f in formulas]
        return substituted(formulas, self.constants)

    def _surface(self) -> dict[str, Any]:
        surface = self.case.surface
        rotated = [
            combined([*surface.formulas, float(s)], [*row, 1.0])
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
            **surface.model_dump(mode="json", include={"folds", "hinges"}, exclude_defaults=True),
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
        if quantity.get("with_respect_to") == "surface.radius":
            quantity["with_respect_to"] = "surface.R"  # the constant of the cylinder's formulas
        for name in ("direction", "axis"):
            if name in quantity:
                given = quantity[name]
                several = isinstance(given[0], list)
                quantity[name] = [self.vector(d) for d in given] if several else self.vector(given)
        if "exact" in quantity:
            quantity["exact"] = self._without_constants(self.vector(quantity["exact"]))
        if quantity["kind"] in ("torque", "drape_coefficient", "folds"):
            quantity["centre"] = self.point(quantity.get("centre", (0.0, 0.0, 0.0)))
