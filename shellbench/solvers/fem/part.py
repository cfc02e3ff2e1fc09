"""The part of a symmetric case as a case of its own: with planes of symmetry, and its share of what lies on them.

The rigid motions that are free on the part are those of the whole that are their own mirror images.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import COMPONENTS, EdgeLoad, Formula, Load, PointLoad, Support, VectorFormula
from shellbench.problems.shell.places import SIDES, Edge, Place, Point
from shellbench.problems.shell.quantities import EnergyQuantity
from shellbench.problems.shell.surface import COORDINATES, SurfaceModel
from shellbench.solvers.fem.reflections import SYMMETRIC, Mirror

Array = NDArray[np.float64]
Ends = tuple[Mirror | None, Mirror | None]  # of the part along a coordinate

ASKED = EnergyQuantity(name="strain_energy", kind="strain_energy", primary=True)  # a case must ask for something


def part_case(case: Case, mirrors: tuple[Ends, Ends], lines: tuple[Array, Array]) -> Case:
    """Return the part that lies between the first and last of the mesh lines; its pieces are not checked again."""
    kept = _Kept(case, mirrors, lines)
    supports = [support.model_copy(update={"on": on}) for support in case.supports if (on := kept.names(support.on))]
    planes: list[Support] = []
    for axis, ends in enumerate(mirrors):
        for side, mirror in zip(SIDES, ends, strict=True):
            if mirror is not None:
                edge = f"{COORDINATES[axis]}_{side}"
                planes.append(Support(name=f"mirror_{edge}", on=(edge,), symmetry=COMPONENTS[mirror.normal]))
    normals = {COMPONENTS[m.normal] for ends in mirrors for m in ends if m is not None}
    return Case.model_construct(
        name=case.name,
        title=case.title,
        theory=case.theory,
        surface=_surface(case.surface, mirrors, lines),
        material=case.material,
        points={name: point for name, point in case.points.items() if kept.holds(case.places[name])},
        supports=(*supports, *planes),
        remove_rigid_motions=tuple(m for m in case.remove_rigid_motions if _is_symmetric(m, set(normals))),
        loads=tuple(kept.loads()),
        quantities=(ASKED,),
    )


def _is_symmetric(motion: str, normals: set[str]) -> bool:
    """Tell whether a rigid motion is its own image in planes; a rotation is if they are at right angles to its axis."""
    kind, along = motion.split("_")
    return along not in normals if kind == "translation" else normals <= {along}


def _surface(surface: SurfaceModel, mirrors: tuple[Ends, Ends], lines: tuple[Array, Array]) -> SurfaceModel:
    """Return the surface on the part of its domain, open along a coordinate that is mirrored."""
    data = surface.model_dump()
    for axis, name in enumerate(COORDINATES):
        if mirrors[axis] == (None, None):
            continue
        bounds = lines[axis][[0, -1]]
        data[name] = tuple(float(b) for b in (np.degrees(bounds) if surface.domain.angle[axis] else bounds))
        if "closed" in data:
            data["closed"] = data["closed"] and not surface.domain.periodic[axis]
        if "periodic" in data:
            data["periodic"] = tuple(other for other in data["periodic"] if other != name)
    return type(surface).model_construct(**data)


@dataclass(frozen=True)
class _Kept:
    """What of a case lies on the part."""

    case: Case
    mirrors: tuple[Ends, Ends]
    lines: tuple[Array, Array]

    def holds(self, place: Place) -> bool:
        """Tell whether a place lies on the part."""
        if isinstance(place, Edge):
            return self.mirrors[place.axis][SIDES.index(place.side)] is None
        return not isinstance(place, Point) or self.share(place) > 0

    def names(self, places: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of the named places that lie on the part."""
        return tuple(name for name in places if self.holds(self.case.places[name]))

    def share(self, point: Point) -> int:
        """Return how many images of the part a point belongs to; 0 if it does not lie on the part."""
        domain, images = self.case.surface.domain, 1
        for axis, line in enumerate(self.lines):
            at, size = point.xi[axis], domain.size[axis]
            if domain.periodic[axis]:
                at -= size * np.round((at - (line[0] + line[-1]) / 2) / size)
            slack = SYMMETRIC * size
            if not line[0] - slack <= at <= line[-1] + slack:
                return 0
            for mirror, end in zip(self.mirrors[axis], line[[0, -1]], strict=True):
                images *= 2 if mirror is not None and abs(at - end) <= slack else 1
        return images

    def loads(self) -> Iterator[Load]:
        """Yield the loads of the part."""
        for load in self.case.loads:
            if isinstance(load, PointLoad):
                for name in load.on:
                    place = self.case.places[name]
                    if isinstance(place, Point) and (share := self.share(place)):
                        yield load.model_copy(update={"on": (name,), "force": _divided(load.force, share)})
            elif isinstance(load, EdgeLoad):
                if on := self.names(load.on):
                    yield load.model_copy(update={"on": on})
            else:
                yield load


def _divided(force: VectorFormula, by: int) -> VectorFormula:
    def divide(formula: Formula) -> Formula:
        return f"({formula})/{by}" if isinstance(formula, str) else formula / by

    first, second, third = (divide(component) for component in force)
    return first, second, third
