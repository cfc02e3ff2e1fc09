"""Mirrors of a case: reflections of one coordinate that carry it into itself, found by sampling.

A reflection of one coordinate, xi_k -> 2 a - xi_k, is a symmetry if it carries the surface, the loads and the supports
into their mirror images in a Cartesian plane with unit normal e,

    x(xi') = R x(xi) + 2 d e,    f(xi') = R f(xi),    R = 1 - 2 e e^T.

The solution is then its own mirror image, u(xi') = R u(xi), except for rigid motions that are removed from it. Symmetry
is never assumed: it is checked at points of the solver's choice and their images (`ComparisonPoints`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.quantities.measure import load_density
from shellbench.problems.shell.question.conditions import COMPONENTS, Support
from shellbench.problems.shell.question.directions import in_space
from shellbench.problems.shell.question.loads import EdgeLoad, MomentLoad, PointLoad
from shellbench.problems.shell.question.orthotropic import OrthotropicMaterial
from shellbench.problems.shell.question.places import SIDES, Edge, Place, Point, Whole
from shellbench.problems.shell.question.surface import COORDINATES, Domain

Array = NDArray[np.float64]

SAME = 1e-9  # of the domain's side: points that are no further apart are one
GOLDEN, PLASTIC = 0.6180339887498949, 0.7548776662466927  # steps of sequences that are not periodic
LOOKED_AT = 1009  # points of the shell that are compared; loads may act on a small part of it
EDGE_SAMPLES = 61
PANEL_SAMPLES = 13  # points between kinks: a load between two kinks may act on a tiny part of the shell
IMAGE_ROUNDING = 1e-9  # relative difference of two mirror images that is rounding, unless a solver knows better
FIRST_LOOK = 64  # points of a first check: most reflections that are no symmetry already fail it
ON_THE_WAY = 0.37  # of a path's end: a state at which loads and motions are compared, beside those of the case


@dataclass(frozen=True)
class ComparisonPoints:
    """Points at which a case is compared with its image, and the allowance for rounding.

    Attributes
    ----------
    points
        (n, 2) of the shell.
    along
        Values of xi1 and of xi2, of points on the edges that run along each.
    order
        Highest derivative of the surface and of supports' motions that is compared.
    rounding
        Relative difference of two mirror images that counts as rounding.
    """

    points: Array
    along: tuple[Array, Array]
    order: int = 0
    rounding: float = IMAGE_ROUNDING

    @classmethod
    def spread_over(cls, case: Shell) -> ComparisonPoints:
        """Return points without a period that a formula might share: over the rectangle, and between all kinks."""
        domain, number = case.surface.domain, np.arange(1, LOOKED_AT + 1)
        lower, size = np.asarray(domain.lower), np.asarray(domain.size)
        unit = np.stack([number * GOLDEN % 1, number * PLASTIC % 1], axis=-1)
        bounds = zip(domain.lower, case.kinks, domain.upper, strict=True)
        panels = [(ends[:-1], np.diff(ends)) for ends in (np.unique([low, *kinks, up]) for low, kinks, up in bounds)]
        starts, steps = (
            np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 1, 2)
            for sides in zip(*panels, strict=True)
        )
        between = (starts + steps * unit[:PANEL_SAMPLES]).reshape(-1, 2)
        first, second = (
            np.concatenate(
                [low + side * unit[:EDGE_SAMPLES, 0], np.ravel(at[:, None] + step[:, None] * unit[:PANEL_SAMPLES, 0])]
            )
            for low, side, (at, step) in zip(lower, size, panels, strict=True)
        )
        return cls(np.concatenate([lower + unit * size, between]), (first, second)).with_narrow_cells(case)

    def with_narrow_cells(self, case: Shell) -> ComparisonPoints:
        """Return the same with points in cells in which a formula varies quickly."""
        found = [(feature.edge, feature.division.middles) for feature in case.features]
        quick = [(edge, at[:: 1 + len(at) // LOOKED_AT]) for edge, at in found]
        points = np.concatenate([self.points, *(at for edge, at in quick if edge is None)])
        first, second = (
            np.concatenate([own, *(at[:, a] for edge, at in quick if edge is not None and edge.axis != a)])
            for a, own in enumerate(self.along)
        )
        return replace(self, points=points, along=(first, second))

    def equal(self, one: Array, other: Array, scale: float | None = None) -> bool:
        """Return True if two arrays differ by rounding only, relative to `scale` or else their largest magnitude."""
        if scale is None:
            scale = max(float(np.abs(one).max(initial=0.0)), float(np.abs(other).max(initial=0.0)))
        return bool(np.abs(one - other).max(initial=0.0) <= self.rounding * scale)


@dataclass(frozen=True)
class Mirror:
    """A reflection of the shell.

    Attributes
    ----------
    axis, at
        It leaves the line xi_axis = at in place (axis 0 or 1; radians for angles).
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

    def reflected_positions(self, positions: Array) -> Array:
        """Return the mirror images (..., 3) of positions in space, m."""
        return np.asarray(positions * self.signs + np.where(self.signs < 0, 2 * self.offset, 0.0))


Ends = tuple[Mirror | None, Mirror | None]  # of a part along a coordinate


def mirror_of(case: Shell, axis: int, at: float, sight: ComparisonPoints) -> Mirror | None:
    """Return the mirror that leaves a coordinate line in place; None if the case has none."""
    if case.edge_parts:  # which are not looked at
        return None
    chosen = (np.arange(FIRST_LOOK) * GOLDEN % 1 * len(sight.points)).astype(int)
    if _reflected_in(*_image_derivatives(case, axis, at, sight.points[chosen], 0), 2 * sight.rounding) is None:
        return None
    here, there = _points_and_images(case, axis, at, sight.points)
    x, image = _image_derivatives(case, axis, at, sight.points, sight.order)
    plane = _reflected_in(x, image, sight.rounding)
    if plane is None:
        return None
    mirror = Mirror(axis, at, *plane)
    for key in x.keys() - {(0, 0)}:
        if not sight.equal(image[key], (-1) ** key[axis] * mirror.signs * x[key]):
            return None
    if not _stiffness_agrees(case, here, there, sight):
        return None
    for t in _compared_times(case):
        if not sight.equal(load_density(case, there, t), mirror.signs * load_density(case, here, t)):
            return None
        if not (_edge_loads_agree(case, mirror, sight, t) and _point_loads_agree(case, mirror, sight, t)):
            return None
    return mirror if _supports_agree(case, mirror, sight) else None


Derivatives = dict[tuple[int, int], Array]


def _points_and_images(case: Shell, axis: int, at: float, points: Array) -> tuple[Array, Array]:
    """Return points (n, 2) and their images, within the domain."""
    domain = case.surface.domain
    return domain.wrap(points), domain.wrap(Mirror(axis, at, 0).image(points))


def _image_derivatives(case: Shell, axis: int, at: float, points: Array, order: int) -> tuple[Derivatives, Derivatives]:
    """Return the surface's derivatives at points, and at their images."""
    here, there = _points_and_images(case, axis, at, points)
    return case.surface.derivatives(here, order), case.surface.derivatives(there, order)


def _reflected_in(x: Derivatives, image: Derivatives, rounding: float) -> tuple[int, float] | None:
    """Return normal and offset of the plane that reflects positions into their images; None if there is none."""
    gap = np.abs(image[0, 0] - x[0, 0]).max(axis=0)
    normal = int(np.argmax(gap))  # images differ along the normal alone
    twice = image[0, 0][:, normal] + x[0, 0][:, normal]
    if not max(np.delete(gap, normal).max(), np.ptp(twice)) <= rounding * gap[normal]:
        return None
    return normal, float(twice.mean() / 2)


def _stiffness_agrees(case: Shell, here: Array, there: Array, sight: ComparisonPoints) -> bool:
    if case.springs:  # which are not looked at
        return False
    if isinstance(case.material, OrthotropicMaterial):  # a reflection turns shear round, and nothing else
        if case.material.stiffening is not None and case.material.angle % 90:
            return False
        turn = np.diag([1.0, 1.0, -1.0])
        return all(sight.equal(turn @ one @ turn, one) for one in case.material.turned_stiffnesses)
    if case.material.uniform:
        return True
    constants = case.surface.named_constants
    factors = (case.material.factors(points, constants) for points in (here, there))
    return all(sight.equal(one, other) for one, other in zip(*factors, strict=True))


def _compared_times(case: Shell) -> tuple[float, ...]:
    return case.states if case.linear else (*case.states, ON_THE_WAY * case.path.until)


def _edge_images(domain: Domain, edge: Edge, mirror: Mirror, sight: ComparisonPoints) -> tuple[Array, Edge, Array]:
    """Return points (n, 2) of an edge, the edge's image, and theirs on it."""
    points, image = edge.points(domain, sight.along[1 - edge.axis]), mirror.place(edge)
    assert isinstance(image, Edge)
    return points, image, image.project(domain, domain.wrap(mirror.image(points)))


def _edge_loads_agree(case: Shell, mirror: Mirror, sight: ComparisonPoints, t: float) -> bool:
    if not any(isinstance(load, EdgeLoad | MomentLoad) for load in case.loads):
        return True
    for edge in (place for place in case.places.values() if isinstance(place, Edge)):
        points, image, images = _edge_images(case.surface.domain, edge, mirror, sight)
        here, there = _edge_densities(case, edge, points, t), _edge_densities(case, image, images, t)
        # a moment is an axial vector
        if not (sight.equal(there[0], mirror.signs * here[0]) and sight.equal(there[1], -mirror.signs * here[1])):
            return False
    return True


def _edge_densities(case: Shell, edge: Edge, points: Array, t: float) -> tuple[Array, Array]:
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


def point_forces(case: Shell, t: float) -> list[tuple[tuple[float, float], Array]]:
    """Return the point and the force (3,) of each point load, N."""
    found = []
    for load in case.loads:
        for name in load.on if isinstance(load, PointLoad) else ():
            place = case.places[name]
            assert isinstance(load, PointLoad)
            assert isinstance(place, Point)
            found.append((place.xi, case.evaluate(load.force, np.asarray(place.xi), t)[0, 0]))
    return found


def _point_loads_agree(case: Shell, mirror: Mirror, sight: ComparisonPoints, t: float) -> bool:
    forces = point_forces(case, t)
    scale = max((float(np.abs(force).max()) for _, force in forces), default=0.0)

    def at(point: ArrayLike) -> Array:
        there = (force for xi, force in forces if _points_coincide(case.surface.domain, xi, point, sight.rounding))
        return np.asarray(sum(there, start=np.zeros(3)))

    return all(sight.equal(at(mirror.image(xi)), mirror.signs * at(xi), scale) for xi, _ in forces)


def _points_coincide(domain: Domain, one: ArrayLike, other: ArrayLike, slack: float) -> bool:
    """Return True if two points (2,) coincide; on a closed shell, also across the seam."""
    gap, size = np.subtract(one, other), np.asarray(domain.size)
    gap = np.where(domain.periodic, gap - size * np.round(gap / size), gap)
    return bool(np.all(np.abs(gap) <= slack * size))


def _places_coincide(domain: Domain, one: Place, other: Place, slack: float) -> bool:
    if isinstance(one, Point) and isinstance(other, Point):
        return _points_coincide(domain, one.xi, other.xi, slack)
    return isinstance(one, Edge) and one == other


def _supports_agree(case: Shell, mirror: Mirror, sight: ComparisonPoints) -> bool:
    """Return True if each supported place and its image are held alike, and the image moves as the mirrored motion."""
    domain = case.surface.domain
    held: dict[Place, tuple[frozenset[str], bool]] = {}
    for support, place in case.supported_places():
        if isinstance(place, Whole) or (support.local and support.motion is not None):
            return False
        components, slope = held.get(place, (frozenset(), False))
        held[place] = (components | frozenset(support.held), slope or support.holds_slope)
    for place, what in held.items():
        image = mirror.place(place)
        found = [p for p in held if held[p] == what and _places_coincide(domain, p, image, sight.rounding)]
        if not found or not all(_motions_agree(case, mirror, sight, place, found[0], t) for t in _compared_times(case)):
            return False
    return True


def _motions_agree(case: Shell, mirror: Mirror, sight: ComparisonPoints, place: Place, image: Place, t: float) -> bool:
    if isinstance(place, Edge):
        points, _, images = _edge_images(case.surface.domain, place, mirror, sight)
    else:
        assert isinstance(place, Point)
        assert isinstance(image, Point)
        points, images = np.array([place.xi]), np.array([image.xi])
    here, there = (_motion_of_place(case, *on, t, sight.order) for on in ((place, points), (image, images)))
    return all(sight.equal((-1) ** key[mirror.axis] * there[key], mirror.signs * here[key]) for key in here)


def _motion_of_place(case: Shell, place: Place, points: Array, t: float, order: int) -> dict[tuple[int, int], Array]:
    """Return the motion of a place by its supports, with derivatives: held components; all if they hold the slope."""
    keys = [(i, j) for i, j in product(range(order + 1), repeat=2) if i + j <= order]
    total = {key: np.zeros((len(points), 3)) for key in keys}
    for support, other in case.supported_places():
        if other == place and support.motion is not None:
            counted = [c in support.held or support.holds_slope for c in COMPONENTS]
            for key, u in case.motion(support, place, case.surface.domain.wrap(points), t, order).items():
                total[key] += u * counted
    return total


def mirrored_supports(case: Shell, mirror: Mirror) -> tuple[int, ...] | None:
    """Return the number of each support's mirror image; None if a support has none."""

    def carried(support: Support, other: Support) -> bool:
        alike = set(support.held) == set(other.held) and (support.clamped, support.shear) == (
            other.clamped,
            other.shear,
        )
        if not alike or support.symmetry != other.symmetry or len(support.on) != len(other.on):
            return False
        candidates = [case.places[name] for name in other.on]
        images = [mirror.place(case.places[name]) for name in support.on]
        return all(any(_places_coincide(case.surface.domain, p, image, SAME) for p in candidates) for image in images)

    found = [
        next((number for number, other in enumerate(case.supports) if carried(support, other)), -1)
        for support in case.supports
    ]
    return None if -1 in found else tuple(found)
