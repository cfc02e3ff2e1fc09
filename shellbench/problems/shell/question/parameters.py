"""Parameters of a shell: the numbers of its case by which a quantity can be differentiated.

    material.youngs_modulus, .poissons_ratio, .bending_poissons_ratio, .thickness, .areal_density, .bending_factor
    loads.1, loads.2, ...      factor of a load, by its number in the file; its value is 1
    springs.NAME               factor of a spring; its value is 1
    surface.radius             radius of a cylinder
    surface.NAME               a constant of the surface's formulas
    surface.xi1_min, ...       a bound of a coordinate, as in the file: degrees for angles
    points.NAME.xi1, ...       a coordinate of a named point, as in the file

All other numbers stay as they are. Material points and mesh lines move with the bounds; named points do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from shellbench.problems.formula_text import times

UNITS: dict[str, tuple[str, tuple[int, int]]] = {
    "youngs_modulus": ("Pa", (-2, 1)),
    "thickness": ("m", (1, 0)),
    "areal_density": ("kg/m^2", (-3, 1)),
    "poissons_ratio": ("", (0, 0)),
    "bending_poissons_ratio": ("", (0, 0)),
    "bending_factor": ("", (0, 0)),
}
"""Unit, and powers of length and force, of each parameter of the material."""
AXES = ("xi1", "xi2")
BOUNDS = {f"{axis}_{side}": (axis, k) for axis in AXES for k, side in enumerate(("min", "max"))}
MEASURES = ("vector", "value", "force", "acceleration", "stiffness")  # fields that give the strength of loads, springs


@dataclass(frozen=True)
class Parameter:
    """A number of a case.

    Attributes
    ----------
    name
        Its name, such as "material.thickness".
    value, unit
        Its value as in the file, and the unit of that.
    powers
        Powers of length and of force in its unit; None of a constant of formulas, whose unit is unknown.
    """

    name: str
    value: float
    unit: str = ""
    powers: tuple[int, int] | None = (0, 0)

    @property
    def group(self) -> str:
        """First part of the name: material, loads, springs, surface or points."""
        return self.name.partition(".")[0]

    @property
    def key(self) -> str:
        """The rest of the name."""
        return self.name.partition(".")[2]

    @property
    def bound(self) -> tuple[int, int] | None:
        """Number of the coordinate and of its end (0, 1) if it is a bound of the surface; else None."""
        axis, end = BOUNDS.get(self.key, ("", 0)) if self.group == "surface" else ("", 0)
        return (AXES.index(axis), end) if axis else None

    @property
    def point(self) -> tuple[str, int] | None:
        """Name of the point and number of the coordinate if it is a coordinate of a point; else None."""
        name, _, axis = self.key.rpartition(".")
        return (name, AXES.index(axis)) if self.group == "points" else None


def parameters_of(shell: Any) -> dict[str, Parameter]:
    """Return all parameters of a shell by name."""
    found = []
    for name, (unit, powers) in UNITS.items() if shell.material.kind == "isotropic" else ():
        value = getattr(shell.material, name)
        if value is not None and not (name == "areal_density" and value == 0):
            found.append(Parameter(f"material.{name}", value, unit, powers))
    found += [Parameter(f"loads.{number}", 1.0) for number in range(1, len(shell.loads) + 1)]
    found += [Parameter(f"springs.{spring.name}", 1.0) for spring in shell.springs]
    surface, angle = shell.surface, shell.surface.domain.angle
    coordinate = [("deg", (0, 0)) if is_angle else ("m", (1, 0)) for is_angle in angle]
    if surface.kind == "cylinder":
        found.append(Parameter("surface.radius", surface.radius, "m", (1, 0)))
    for name, value in getattr(surface, "constants", {}).items():
        found.append(Parameter(f"surface.{name}", value, "", None))
    for name, (axis, end) in BOUNDS.items() if surface.kind != "mesh" else ():
        number = AXES.index(axis)
        if not surface.domain.periodic[number]:
            found.append(Parameter(f"surface.{name}", getattr(surface, axis)[end], *coordinate[number]))
    for name, xi in shell.points.items():
        found += [Parameter(f"points.{name}.{AXES[k]}", xi[k], *coordinate[k]) for k in (0, 1)]
    return {parameter.name: parameter for parameter in found}


def changed(shell: Any, parameter: Parameter, value: Any) -> Any:
    """Return an unchecked copy of a shell with another value of a parameter, which may be a complex number.

    The factor of a load or spring has to be real. `type(shell).model_validate(copy.data())` checks the copy.
    """
    group, key = parameter.group, parameter.key
    if group == "material":
        return _copy(shell, material=_copy(shell.material, **{key: value}))
    if group in ("loads", "springs"):
        parts = list(getattr(shell, group))
        number = int(key) - 1 if group == "loads" else [s.name for s in parts].index(key)
        parts[number] = scaled(parts[number], value)
        return _copy(shell, **{group: tuple(parts)})
    if parameter.point:
        name, axis = parameter.point
        xi = list(shell.points[name])
        xi[axis] = value
        return _copy(shell, points={**shell.points, name: tuple(xi)})
    surface = shell.surface
    if parameter.bound:
        axis, end = parameter.bound
        bounds = list(getattr(surface, AXES[axis]))
        bounds[end] = value
        return _copy(shell, surface=_copy(surface, **{AXES[axis]: tuple(bounds)}))
    if key == "radius" and surface.kind == "cylinder":
        return _copy(shell, surface=_copy(surface, radius=value))
    return _copy(shell, surface=_copy(surface, constants={**surface.constants, key: value}))


def scaled(part: Any, factor: float) -> Any:
    """Return a load or a spring times a factor."""
    fields = {name: getattr(part, name) for name in MEASURES if name in type(part).model_fields}
    return _copy(part, **{n: _times(value, factor) for n, value in fields.items()})


def _times(value: Any, factor: float) -> Any:
    return tuple(times(f, factor) for f in value) if isinstance(value, tuple) else times(value, factor)


def _copy(model: Any, **changes: Any) -> Any:
    """Return a copy of a model without what it has cached."""
    copy = model.model_copy(update=changes)
    for name in vars(copy).keys() - type(copy).model_fields.keys():
        del vars(copy)[name]
    return copy
