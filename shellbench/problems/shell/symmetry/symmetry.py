"""Symmetry of a case: the part of its shell that has to be solved, and its axis of revolution.

This module defines the problem, not its mechanics. The part is a complete case of its own (`Part.case`): its cut edges
lie in planes of symmetry (`shellbench.problems.shell.posed.mirrors`), and it has its share of the loads on them. Each
solver makes its own mesh of the part, and imposes the supports in its own way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.mirrors import IMAGE_ROUNDING, SAME, ComparisonPoints, Ends, Mirror, mirror_of
from shellbench.problems.shell.posed.surfaces import SurfaceModel
from shellbench.problems.shell.quantities.quantities import EnergyQuantity
from shellbench.problems.shell.question.conditions import COMPONENTS, Formula, RigidMotion, Support, VectorFormula
from shellbench.problems.shell.question.loads import EdgeLoad, Load, MomentLoad, PointLoad
from shellbench.problems.shell.question.places import SIDES, Edge, Place, Point, Side
from shellbench.problems.shell.question.surface import COORDINATES

Array = NDArray[np.float64]

REVOLVED = 9  # points a side at which a surface of revolution is tested
ASKED = EnergyQuantity(name="strain_energy", kind="strain_energy", primary=True)  # a case must ask for something


@dataclass(frozen=True)
class Folded:
    """Points of the whole shell, brought into the part.

    Attributes
    ----------
    points
        (..., 2) in the part.
    signs
        (..., 3) factors from a vector there to the vector at the original point.
    turned
        (..., 2) -1 where a coordinate runs the other way, else 1.
    """

    points: Array
    signs: Array
    turned: Array


@dataclass(frozen=True)
class Part:
    """The part of a shell that is solved, a rectangle of the coordinates.

    Attributes
    ----------
    whole
        The case that it is a part of.
    lower, upper
        Bounds of the rectangle; within those of the whole.
    ends
        For each coordinate the mirrors of the part at its lower and at its upper bound; None without a mirror. A closed
        coordinate has one mirror at both ends of half a turn, or two a quarter of a turn apart; an open one has one, at
        the upper end.
    """

    whole: Case
    lower: tuple[float, float]
    upper: tuple[float, float]
    ends: tuple[Ends, Ends] = ((None, None), (None, None))

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        """Mirrors that generate the whole from the part."""
        return tuple(dict.fromkeys(mirror for ends in self.ends for mirror in ends if mirror is not None))

    @property
    def planes(self) -> Mapping[tuple[int, Side], int]:
        """(axis, side) -> normal: edges of the part in planes of symmetry, and the direction (0, 1, 2) across."""
        sides = ((axis, side, end) for axis in (0, 1) for side, end in zip(SIDES, self.ends[axis], strict=True))
        return {(axis, side): end.normal for axis, side, end in sides if end is not None}

    @property
    def copies(self) -> int:
        """Number of copies of the part in the whole."""
        return 1 << len(self.mirrors)

    def images(self) -> Iterator[tuple[Mirror, ...]]:
        """Yield for each copy the mirrors that lead from the part to it, the part itself first."""
        for chosen in product((False, True), repeat=len(self.mirrors)):
            yield tuple(m for m, taken in zip(self.mirrors, chosen, strict=True) if taken)

    def fold(self, points: ArrayLike) -> Folded:
        """Bring points (..., 2) of the whole shell into the part."""
        xi = np.array(points, dtype=float)
        signs, turned = np.ones((*xi.shape[:-1], 3)), np.ones_like(xi)
        domain = self.whole.surface.domain
        for axis, (first, last) in enumerate(self.ends):
            if domain.periodic[axis]:
                xi[..., axis] = self.lower[axis] + np.mod(xi[..., axis] - self.lower[axis], domain.size[axis])
            # the mirror at the lower end of a quarter also leaves the line half a turn away in place
            half_a_turn = (first, self.lower[axis] + domain.size[axis] / 2)
            for mirror, line in ((half_a_turn,) if first is not last else ()) + ((last, self.upper[axis]),):
                if mirror is not None:
                    beyond = xi[..., axis] > line
                    xi[..., axis] = np.where(beyond, 2 * line - xi[..., axis], xi[..., axis])
                    signs[..., mirror.normal] *= np.where(beyond, -1.0, 1.0)
                    turned[..., axis] *= np.where(beyond, -1.0, 1.0)
        return Folded(xi, signs, turned)

    def place(self, point: tuple[float, float]) -> tuple[tuple[float, float], int] | None:
        """Return a point of the whole as a point of the part, and the number of copies of the part that share it.

        The number doubles with each plane of symmetry through the point. None if the point is outside the part.
        """
        domain = self.whole.surface.domain
        found, sharing = [], 1
        for axis in (0, 1):
            value, lower, upper, slack = point[axis], self.lower[axis], self.upper[axis], SAME * domain.size[axis]
            if domain.periodic[axis]:
                offset = (value - lower) % domain.size[axis]
                value = lower + (0.0 if domain.size[axis] - offset < slack else offset)
            if not lower - slack <= value <= upper + slack:
                return None
            value = min(max(value, lower), upper)
            for end, mirror in zip((lower, upper), self.ends[axis], strict=True):
                sharing *= 2 if mirror is not None and abs(value - end) <= slack else 1
            found.append(value)
        return (found[0], found[1]), sharing

    def place_on_part(self, place: Place) -> Place | None:
        """Return a place of the whole as one of the part; None if it is outside the part."""
        if isinstance(place, Point):
            found = self.place(place.xi)
            return None if found is None else Point(place.name, found[0])
        return None if isinstance(place, Edge) and (place.axis, place.side) in self.planes else place

    def supported(self, mirrors: tuple[Mirror, ...] = ()) -> Iterator[tuple[int, Support, Place]]:
        """Yield number, support and place of the supports on the copy of the part to which mirrors lead.

        The place is the one of the part whose image is supported.
        """
        for number, support in enumerate(self.whole.supports):
            for name in support.on:
                place = self.whole.places[name]
                for mirror in mirrors:
                    place = mirror.place(place)
                found = self.place_on_part(place)
                if found is not None:
                    yield number, support, found

    def excludes_motion(self, motion: RigidMotion) -> bool:
        """Return True if planes of symmetry exclude a rigid motion.

        A plane excludes the translation across it and the rotations about axes in it: in the mean over the area a
        symmetric displacement is then orthogonal to the motion.
        """
        normals = {mirror.normal for mirror in self.mirrors}
        kind, _, name = motion.partition("_")
        direction = "xyz".index(name)
        return direction in normals if kind == "translation" else bool(normals - {direction})

    @cached_property
    def case(self) -> Case:
        """The part as a case of its own, its planes of symmetry after its supports; its pieces are not checked again.

        It is asked for nothing: quantities, states and path are the whole's.
        """
        whole = self.whole
        if not self.mirrors:
            return whole
        supports = [s.model_copy(update={"on": on}) for s in whole.supports if (on := self._names(s.on))]
        for (axis, side), normal in self.planes.items():
            edge = f"{COORDINATES[axis]}_{side}"
            supports.append(Support(name=f"mirror_{edge}", on=(edge,), symmetry=COMPONENTS[normal]))
        return Case.model_construct(
            name=whole.name,
            title=whole.title,
            theory=whole.theory,
            surface=self._surface(),
            material=whole.material,
            points=self._points(),
            supports=tuple(supports),
            remove_rigid_motions=tuple(m for m in whole.remove_rigid_motions if not self.excludes_motion(m)),
            loads=tuple(self._loads()),
            quantities=(ASKED,),
        )

    def _names(self, places: tuple[str, ...]) -> tuple[str, ...]:
        """Return the named places that lie on the part."""
        return tuple(name for name in places if self.place_on_part(self.whole.places[name]) is not None)

    def _surface(self) -> SurfaceModel:
        """Return the surface on the part of its domain, open along a coordinate that is mirrored."""
        surface = self.whole.surface
        data = dict(surface)
        for axis, name in enumerate(COORDINATES):
            if self.ends[axis] != (None, None):
                data[name] = self._in_units(axis, self.lower[axis]), self._in_units(axis, self.upper[axis])
                if "closed" in data:
                    data["closed"] = data["closed"] and not surface.domain.periodic[axis]
                if "periodic" in data:
                    data["periodic"] = tuple(other for other in data["periodic"] if other != name)
        return type(surface).model_construct(**data)

    def _in_units(self, axis: int, value: float) -> float:
        return float(np.degrees(value)) if self.whole.surface.domain.angle[axis] else float(value)

    def _points(self) -> dict[str, tuple[float, float]]:
        found = {}
        for name in self.whole.points:
            point = self.place_on_part(self.whole.places[name])
            if isinstance(point, Point):
                found[name] = self._in_units(0, point.xi[0]), self._in_units(1, point.xi[1])
        return found

    def _loads(self) -> Iterator[Load]:
        """Yield the loads of the part, forces at points on its planes of symmetry shared with its images."""
        for load in self.whole.loads:
            if isinstance(load, EdgeLoad | MomentLoad):
                if on := self._names(load.on):
                    yield load.model_copy(update={"on": on})
            elif isinstance(load, PointLoad):
                for name in load.on:
                    place = self.whole.places[name]
                    found = self.place(place.xi) if isinstance(place, Point) else None
                    if found is not None:
                        yield load.model_copy(update={"on": (name,), "force": _divide_force(load.force, found[1])})
            else:
                yield load


def _divide_force(force: VectorFormula, by: int) -> VectorFormula:
    def divide(formula: Formula) -> Formula:
        return f"({formula})/{by}" if isinstance(formula, str) else formula / by

    first, second, third = (divide(component) for component in force)
    return first, second, third


def whole_of(case: Case) -> Part:
    """Return the whole of a case's shell as its own part, without a look at its symmetry."""
    return Part(case, case.surface.domain.lower, case.surface.domain.upper)


def part_of(case: Case) -> Part:
    """Return the smallest part of a case's shell that its planes of symmetry allow; the whole if it has none."""
    domain, sight = case.surface.domain, ComparisonPoints.spread_over(case)
    bounds: list[tuple[float, float]] = []
    ends: list[Ends] = []
    for axis in (0, 1):
        lower, size, closed = domain.lower[axis], domain.size[axis], domain.periodic[axis]
        folded = any(fold.axis == axis for fold in case.surface.fold_lines)  # a part would end on a fold, or lack some
        mirrors = _mirrors_of_a_turn(case, axis, sight) if closed and not folded else []
        middle = None if closed or folded else mirror_of(case, axis, (lower + domain.upper[axis]) / 2, sight)
        if middle:
            bounds.append((lower, middle.at))
            ends.append((None, middle))
        elif mirrors:
            width = size / (2 * len(mirrors))
            # formulas of a closed surface and its loads may be valid inside the domain only: one of the copies is there
            starts = [lower + (mirrors[0].at + n * width - lower) % size for n in range(2 * len(mirrors))]
            number = next(n for n, start in enumerate(starts) if start + width <= domain.upper[axis] + SAME * size)
            bounds.append((starts[number], starts[number] + width))
            ends.append((mirrors[number % len(mirrors)], mirrors[(number + 1) % len(mirrors)]))
        else:
            bounds.append((lower, domain.upper[axis]))
            ends.append((None, None))
    (low1, high1), (low2, high2) = bounds
    return Part(case, (low1, low2), (high1, high2), (ends[0], ends[1]))


def _mirrors_of_a_turn(case: Case, axis: int, sight: ComparisonPoints) -> list[Mirror]:
    """Return two mirrors a quarter of a turn apart, or one, or none."""
    lower, turn = case.surface.domain.lower[axis], case.surface.domain.size[axis]
    named = [p.xi[axis] for p in case.places.values() if isinstance(p, Point)]
    single: list[Mirror] = []
    for start in (lower, 0.0, *named, lower + turn / 4, turn / 4):
        first = mirror_of(case, axis, start, sight)
        if first is None:
            continue
        second = mirror_of(case, axis, start + turn / 4, sight)
        if second and second.normal != first.normal:
            return [first, second]
        single = single or [first]
    return single


def axis_of_revolution(case: Case) -> Array | None:
    """Return the axis e (3,) about which every turn along xi1 leaves a case as it is: x,1 = e cross x + d.

    None if the surface has none, if there are loads or springs, or if supports are not whole edges that turn about it.
    """
    domain = case.surface.domain
    points = domain.grid(REVOLVED, REVOLVED)
    x = case.surface.derivatives(points.reshape(-1, 2), order=1)
    plain = case.material.uniform and not (case.loads or case.springs)
    axis = None if not plain else _axis(x[0, 0], x[1, 0])
    if axis is None:
        return None
    for support, place in case.supported_places():
        if not isinstance(place, Edge) or not place.whole or len(support.held) < len(COMPONENTS):
            return None
        for t in (0.5, 1.0):
            moved = case.motion(support, place, points, t, order=1)
            gap = np.abs(moved[1, 0] - np.cross(axis, moved[0, 0])).max()
            if gap > IMAGE_ROUNDING * (1 + np.abs(moved[0, 0]).max()):
                return None
    return axis


def _axis(position: Array, tangent: Array) -> Array | None:
    """Return e of x,1 = e cross x + d, from positions and tangents (n, 3); None if there is none."""
    crossed = np.stack([np.cross(unit, position) for unit in np.eye(3)], axis=-1)
    shifted = np.broadcast_to(np.eye(3), crossed.shape)
    matrix = np.concatenate([crossed, shifted], axis=-1).reshape(-1, 6)
    found, *_ = np.linalg.lstsq(matrix, tangent.ravel(), rcond=None)
    if np.abs(matrix @ found - tangent.ravel()).max() > IMAGE_ROUNDING * np.abs(tangent).max():
        return None
    return np.asarray(found[:3])
