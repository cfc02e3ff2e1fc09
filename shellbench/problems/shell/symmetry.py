"""Symmetry of a case: its planes, the part of its shell that they leave to be solved, and its axis of revolution.

A reflection of one coordinate, xi_k -> 2 a - xi_k, is a symmetry where it carries the surface, the loads and the
supports into their mirror images in a Cartesian plane with unit normal e,

    x(xi') = R x(xi) + 2 d e,    f(xi') = R f(xi),    R = 1 - 2 e e^T.

The solution is then its own mirror image, u(xi') = R u(xi), but for rigid motions that are taken from it. That a case
is symmetric is never assumed: it is looked at, at points of a solver's own choice and their images (`Sight`).

This is the question, not its mechanics. The part is a case of its own (`Part.case`), in the words of every case: its
cut edges lie in planes of symmetry, and it has its share of what lies on them. How a solver makes a mesh of the part,
and how it imposes what its supports say, is the solver's own affair.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import (
    COMPONENTS,
    EdgeLoad,
    Formula,
    Load,
    MomentLoad,
    PointLoad,
    RigidMotion,
    Support,
    VectorFormula,
)
from shellbench.problems.shell.directions import in_space
from shellbench.problems.shell.measure import load_density
from shellbench.problems.shell.places import SIDES, Edge, Place, Point, Side, Whole
from shellbench.problems.shell.quantities import EnergyQuantity
from shellbench.problems.shell.surface import COORDINATES, Domain
from shellbench.problems.shell.surfaces import SurfaceModel

Array = NDArray[np.float64]

SAME = 1e-9  # of the domain's side: points that are no further apart are one
REVOLVED = 9  # points a side at which a surface of revolution is known
GOLDEN, PLASTIC = 0.6180339887498949, 0.7548776662466927  # steps of sequences in no rhythm
SAMPLES = 1009  # points of the shell; loads may act on a small part of it
EDGE_SAMPLES = 61
ROUNDING = 1e-9  # relative difference of two mirror images that is rounding, unless a solver knows better
ON_THE_WAY = 0.37  # of a path's end: where loads and motions are looked at beside the states that a case asks for
ASKED = EnergyQuantity(name="strain_energy", kind="strain_energy", primary=True)  # a case must ask for something


@dataclass(frozen=True)
class Sight:
    """Where a case is looked at, and what is taken for rounding there.

    Attributes
    ----------
    points
        (n, 2) of the shell.
    along
        Values of xi1 and of xi2, of points on the edges that run along each.
    order
        Highest derivative of the surface and of supports' motions that is compared.
    rounding
        Relative difference of two mirror images that is none.
    """

    points: Array
    along: tuple[Array, Array]
    order: int = 0
    rounding: float = ROUNDING

    @classmethod
    def spread(cls, domain: Domain) -> Sight:
        """Return points over the whole rectangle in no rhythm that a formula might have."""
        lower, size, number = np.asarray(domain.lower), np.asarray(domain.size), np.arange(1, SAMPLES + 1)
        unit = np.stack([number * GOLDEN % 1, number * PLASTIC % 1], axis=-1)
        first, second = (low + side * unit[:EDGE_SAMPLES, 0] for low, side in zip(lower, size, strict=True))
        return cls(lower + unit * size, (first, second))

    def alike(self, one: Array, other: Array, scale: float | None = None) -> bool:
        """Whether two arrays differ by rounding only, relative to their largest magnitude unless it is given."""
        if scale is None:
            scale = max(float(np.abs(one).max(initial=0.0)), float(np.abs(other).max(initial=0.0)))
        return bool(np.abs(one - other).max(initial=0.0) <= self.rounding * scale)


@dataclass(frozen=True)
class Mirror:
    """A reflection of the shell.

    Attributes
    ----------
    axis, at
        It leaves the line xi_axis = at where it is (axis 0 or 1; radians for angles).
    normal, offset
        The plane of symmetry is x_normal = offset, m.
    """

    axis: int
    at: float
    normal: int
    offset: float = 0.0

    @property
    def signs(self) -> Array:
        """Factors (3,) of the components of a reflected vector: the diagonal of R."""
        return np.where(np.arange(len(COMPONENTS)) == self.normal, -1.0, 1.0)

    def image(self, points: ArrayLike) -> Array:
        """Return the mirror images (..., 2) of points, in coordinates."""
        xi = np.array(points, dtype=float)
        xi[..., self.axis] = 2 * self.at - xi[..., self.axis]
        return xi

    def place(self, place: Place) -> Place:
        """Return the mirror image of a place."""
        if isinstance(place, Point):
            first, second = self.image(place.xi)
            return Point(place.name, (float(first), float(second)))
        if not isinstance(place, Edge) or place.axis != self.axis:
            return place
        side = SIDES[1 - SIDES.index(place.side)]
        return Edge(f"{COORDINATES[place.axis]}_{side}", place.axis, side)

    def reflected(self, positions: Array) -> Array:
        """Return the mirror images (..., 3) of positions in space, m."""
        return np.asarray(positions * self.signs + np.where(self.signs < 0, 2 * self.offset, 0.0))


Ends = tuple[Mirror | None, Mirror | None]  # of a part along a coordinate


def mirror_of(case: Case, axis: int, at: float, sight: Sight) -> Mirror | None:
    """Return the mirror that leaves a coordinate line where it is, if the case has one."""
    if case.edge_parts:  # which are not looked at
        return None
    domain = case.surface.domain
    here, there = domain.wrap(sight.points), domain.wrap(Mirror(axis, at, 0).image(sight.points))
    x, image = (case.surface.derivatives(points, sight.order) for points in (here, there))
    gap = np.abs(image[0, 0] - x[0, 0]).max(axis=0)
    normal = int(np.argmax(gap))  # images differ along the normal alone
    twice = image[0, 0][:, normal] + x[0, 0][:, normal]
    if not max(np.delete(gap, normal).max(), np.ptp(twice)) <= sight.rounding * gap[normal]:
        return None
    mirror = Mirror(axis, at, normal, float(twice.mean() / 2))
    for key in x.keys() - {(0, 0)}:
        if not sight.alike(image[key], (-1) ** key[axis] * mirror.signs * x[key]):
            return None
    if not _stiffness_agrees(case, here, there, sight):
        return None
    for t in _times(case):
        if not sight.alike(load_density(case, there, t), mirror.signs * load_density(case, here, t)):
            return None
        if not (_edge_loads_agree(case, mirror, sight, t) and _point_loads_agree(case, mirror, sight, t)):
            return None
    return mirror if _supports_agree(case, mirror, sight) else None


def _stiffness_agrees(case: Case, here: Array, there: Array, sight: Sight) -> bool:
    if case.springs:  # which are not looked at
        return False
    if case.material.uniform:
        return True
    constants = case.surface.named_constants
    factors = (case.material.factors(points, constants) for points in (here, there))
    return all(sight.alike(one, other) for one, other in zip(*factors, strict=True))


def _times(case: Case) -> tuple[float, ...]:
    return case.states if case.linear else (*case.states, ON_THE_WAY * case.path.until)


def _on_edge(domain: Domain, edge: Edge, mirror: Mirror, sight: Sight) -> tuple[Array, Edge, Array]:
    """Return points (n, 2) of an edge, the edge's image, and theirs on it."""
    points, image = edge.points(domain, sight.along[1 - edge.axis]), mirror.place(edge)
    assert isinstance(image, Edge)
    return points, image, image.project(domain, domain.wrap(mirror.image(points)))


def _edge_loads_agree(case: Case, mirror: Mirror, sight: Sight, t: float) -> bool:
    if not any(isinstance(load, EdgeLoad | MomentLoad) for load in case.loads):
        return True
    for edge in (place for place in case.places.values() if isinstance(place, Edge)):
        points, image, images = _on_edge(case.surface.domain, edge, mirror, sight)
        here, there = _edge_densities(case, edge, points, t), _edge_densities(case, image, images, t)
        # a moment is an axial vector
        if not (sight.alike(there[0], mirror.signs * here[0]) and sight.alike(there[1], -mirror.signs * here[1])):
            return False
    return True


def _edge_densities(case: Case, edge: Edge, points: Array, t: float) -> tuple[Array, Array]:
    """Return forces and moments (n, 3) per length at points (n, 2) of an edge."""
    force, moment = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    for load in case.loads:
        if isinstance(load, EdgeLoad):
            given = case.evaluate(load.vector, points, t)[0, 0]
            force += load.on.count(edge.name) * (
                given if load.frame == "global" else in_space(case.surface, given, points, edge)
            )
        elif isinstance(load, MomentLoad):
            axis = np.asarray(load.axis) / np.linalg.norm(load.axis)
            values = case.formula(load.value).derivatives(points, 0, t)[0, 0]
            moment += load.on.count(edge.name) * values[:, None] * axis
    return force, moment


def point_forces(case: Case, t: float) -> list[tuple[tuple[float, float], Array]]:
    """Return the point and the force (3,) of each point load, N."""
    found = []
    for load in case.loads:
        for name in load.on if isinstance(load, PointLoad) else ():
            place = case.places[name]
            assert isinstance(load, PointLoad)
            assert isinstance(place, Point)
            found.append((place.xi, case.evaluate(load.force, np.asarray(place.xi), t)[0, 0]))
    return found


def _point_loads_agree(case: Case, mirror: Mirror, sight: Sight, t: float) -> bool:
    forces = point_forces(case, t)
    scale = max((float(np.abs(force).max()) for _, force in forces), default=0.0)

    def at(point: ArrayLike) -> Array:
        there = (force for xi, force in forces if _same(case.surface.domain, xi, point, sight.rounding))
        return np.asarray(sum(there, start=np.zeros(3)))

    return all(sight.alike(at(mirror.image(xi)), mirror.signs * at(xi), scale) for xi, _ in forces)


def _same(domain: Domain, one: ArrayLike, other: ArrayLike, slack: float) -> bool:
    """Whether two points (2,) are one, round a closed shell too."""
    gap, size = np.subtract(one, other), np.asarray(domain.size)
    gap = np.where(domain.periodic, gap - size * np.round(gap / size), gap)
    return bool(np.all(np.abs(gap) <= slack * size))


def _coincide(domain: Domain, one: Place, other: Place, slack: float) -> bool:
    if isinstance(one, Point) and isinstance(other, Point):
        return _same(domain, one.xi, other.xi, slack)
    return isinstance(one, Edge) and one == other


def _supports_agree(case: Case, mirror: Mirror, sight: Sight) -> bool:
    """Whether what is held on a place is held on its image, and moves as the image of its motion."""
    domain = case.surface.domain
    held: dict[Place, tuple[frozenset[str], bool]] = {}
    for support, place in case.supported_places():
        if isinstance(place, Whole) or (support.local and support.motion is not None):
            return False
        components, slope = held.get(place, (frozenset(), False))
        held[place] = (components | frozenset(support.held), slope or support.holds_slope)
    for place, what in held.items():
        image = mirror.place(place)
        found = [p for p in held if held[p] == what and _coincide(domain, p, image, sight.rounding)]
        if not found or not all(_motions_agree(case, mirror, sight, place, found[0], t) for t in _times(case)):
            return False
    return True


def _motions_agree(case: Case, mirror: Mirror, sight: Sight, place: Place, image: Place, t: float) -> bool:
    if isinstance(place, Edge):
        points, _, images = _on_edge(case.surface.domain, place, mirror, sight)
    else:
        assert isinstance(place, Point)
        assert isinstance(image, Point)
        points, images = np.array([place.xi]), np.array([image.xi])
    here, there = (_moved(case, *on, t, sight.order) for on in ((place, points), (image, images)))
    return all(sight.alike((-1) ** key[mirror.axis] * there[key], mirror.signs * here[key]) for key in here)


def _moved(case: Case, place: Place, points: Array, t: float, order: int) -> dict[tuple[int, int], Array]:
    """Return how supports move a place, with derivatives: what they hold, and all of it where they hold the slope."""
    keys = [(i, j) for i, j in product(range(order + 1), repeat=2) if i + j <= order]
    total = {key: np.zeros((len(points), 3)) for key in keys}
    for support, other in case.supported_places():
        if other == place and support.motion is not None:
            counted = [c in support.held or support.holds_slope for c in COMPONENTS]
            for key, u in case.motion(support, place, case.surface.domain.wrap(points), t, order).items():
                total[key] += u * counted
    return total


def mirrored_supports(case: Case, mirror: Mirror) -> tuple[int, ...] | None:
    """Return for each support the number of the one that is its mirror image; None if a support has none."""

    def carried(support: Support, other: Support) -> bool:
        alike = set(support.held) == set(other.held) and support.clamped == other.clamped
        if not alike or support.symmetry != other.symmetry or len(support.on) != len(other.on):
            return False
        candidates = [case.places[name] for name in other.on]
        images = [mirror.place(case.places[name]) for name in support.on]
        return all(any(_coincide(case.surface.domain, p, image, SAME) for p in candidates) for image in images)

    found = [
        next((number for number, other in enumerate(case.supports) if carried(support, other)), -1)
        for support in case.supports
    ]
    return None if -1 in found else tuple(found)


@dataclass(frozen=True)
class Folded:
    """Points of the whole shell, brought into the part.

    Attributes
    ----------
    points
        (..., 2) in the part.
    signs
        (..., 3) by which a vector there is multiplied to be the one at the point it came from.
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
        For each coordinate what mirrors the part at its lower and at its upper bound; None where nothing does. A closed
        coordinate has one mirror at both ends of half a turn, or two a quarter of a turn apart; an open one has one, at
        the upper end.
    """

    whole: Case
    lower: tuple[float, float]
    upper: tuple[float, float]
    ends: tuple[Ends, Ends] = ((None, None), (None, None))

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        """Those that make the whole of the part."""
        return tuple(dict.fromkeys(mirror for ends in self.ends for mirror in ends if mirror is not None))

    @property
    def planes(self) -> Mapping[tuple[int, Side], int]:
        """(axis, side) -> normal: edges of the part in planes of symmetry, and the direction (0, 1, 2) across."""
        sides = ((axis, side, end) for axis in (0, 1) for side, end in zip(SIDES, self.ends[axis], strict=True))
        return {(axis, side): end.normal for axis, side, end in sides if end is not None}

    @property
    def copies(self) -> int:
        """How many times the part is in the whole."""
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
            # the mirror at the lower end of a quarter also leaves the line half a turn away where it is
            half_a_turn = (first, self.lower[axis] + domain.size[axis] / 2)
            for mirror, line in ((half_a_turn,) if first is not last else ()) + ((last, self.upper[axis]),):
                if mirror is not None:
                    beyond = xi[..., axis] > line
                    xi[..., axis] = np.where(beyond, 2 * line - xi[..., axis], xi[..., axis])
                    signs[..., mirror.normal] *= np.where(beyond, -1.0, 1.0)
                    turned[..., axis] *= np.where(beyond, -1.0, 1.0)
        return Folded(xi, signs, turned)

    def place(self, point: tuple[float, float]) -> tuple[tuple[float, float], int] | None:
        """Return a point of the whole as a point of the part, and how many copies of the part share it.

        They are two for each plane of symmetry through the point; None if the point is outside the part.
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

    def seen(self, place: Place) -> Place | None:
        """Return a place of the whole as one of the part; None if it is outside the part."""
        if isinstance(place, Point):
            found = self.place(place.xi)
            return None if found is None else Point(place.name, found[0])
        return None if isinstance(place, Edge) and (place.axis, place.side) in self.planes else place

    def supported(self, mirrors: tuple[Mirror, ...] = ()) -> Iterator[tuple[int, Support, Place]]:
        """Yield number, support and place for what supports of the whole hold of the copy to which mirrors lead.

        The place is the one of the part of which it is the image.
        """
        for number, support in enumerate(self.whole.supports):
            for name in support.on:
                place = self.whole.places[name]
                for mirror in mirrors:
                    place = mirror.place(place)
                found = self.seen(place)
                if found is not None:
                    yield number, support, found

    def holds(self, motion: RigidMotion) -> bool:
        """Whether planes of symmetry exclude a rigid motion.

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
            remove_rigid_motions=tuple(m for m in whole.remove_rigid_motions if not self.holds(m)),
            loads=tuple(self._loads()),
            quantities=(ASKED,),
        )

    def _names(self, places: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of the named places that lie on the part."""
        return tuple(name for name in places if self.seen(self.whole.places[name]) is not None)

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
            point = self.seen(self.whole.places[name])
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
                        yield load.model_copy(update={"on": (name,), "force": _divided(load.force, found[1])})
            else:
                yield load


def _divided(force: VectorFormula, by: int) -> VectorFormula:
    def divide(formula: Formula) -> Formula:
        return f"({formula})/{by}" if isinstance(formula, str) else formula / by

    first, second, third = (divide(component) for component in force)
    return first, second, third


def whole_of(case: Case) -> Part:
    """Return the whole of a case's shell as its own part, without a look at its symmetry."""
    return Part(case, case.surface.domain.lower, case.surface.domain.upper)


def part_of(case: Case) -> Part:
    """Return the smallest part of a case's shell that its planes of symmetry allow; the whole if it has none."""
    domain, sight = case.surface.domain, Sight.spread(case.surface.domain)
    bounds: list[tuple[float, float]] = []
    ends: list[Ends] = []
    for axis in (0, 1):
        lower, size = domain.lower[axis], domain.size[axis]
        mirrors = _mirrors_of_a_turn(case, axis, sight) if domain.periodic[axis] else []
        middle = None if domain.periodic[axis] else mirror_of(case, axis, (lower + domain.upper[axis]) / 2, sight)
        if middle:
            bounds.append((lower, middle.at))
            ends.append((None, middle))
        elif mirrors:
            width = size / (2 * len(mirrors))
            # formulas of a closed surface and its loads may hold inside the domain only: one of the copies is there
            starts = [lower + (mirrors[0].at + n * width - lower) % size for n in range(2 * len(mirrors))]
            number = next(n for n, start in enumerate(starts) if start + width <= domain.upper[axis] + SAME * size)
            bounds.append((starts[number], starts[number] + width))
            ends.append((mirrors[number % len(mirrors)], mirrors[(number + 1) % len(mirrors)]))
        else:
            bounds.append((lower, domain.upper[axis]))
            ends.append((None, None))
    (low1, high1), (low2, high2) = bounds
    return Part(case, (low1, low2), (high1, high2), (ends[0], ends[1]))


def _mirrors_of_a_turn(case: Case, axis: int, sight: Sight) -> list[Mirror]:
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
            if gap > ROUNDING * (1 + np.abs(moved[0, 0]).max()):
                return None
    return axis


def _axis(position: Array, tangent: Array) -> Array | None:
    """Return e of x,1 = e cross x + d, from positions and tangents (n, 3); None if there is none."""
    crossed = np.stack([np.cross(unit, position) for unit in np.eye(3)], axis=-1)
    shifted = np.broadcast_to(np.eye(3), crossed.shape)
    matrix = np.concatenate([crossed, shifted], axis=-1).reshape(-1, 6)
    found, *_ = np.linalg.lstsq(matrix, tangent.ravel(), rcond=None)
    if np.abs(matrix @ found - tangent.ravel()).max() > ROUNDING * np.abs(tangent).max():
        return None
    return np.asarray(found[:3])
