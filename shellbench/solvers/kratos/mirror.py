"""Reflections of a shell in Cartesian coordinate planes under which a whole case is its own image.

A coordinate has a mirror if xi_k -> 2 a - xi_k turns the surface, its supports and its loads into their reflections.
Nothing is assumed: surface, supports and loads are evaluated at points in no rhythm that a formula might have.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import EdgeLoad, MomentLoad, PointLoad
from shellbench.problems.shell.measure import load_density
from shellbench.problems.shell.places import Edge, Point, Side, Whole

Array = NDArray[np.float64]

ROUNDING = 1e-9  # relative difference of two mirror images that is rounding
GOLDEN, PLASTIC = 0.6180339887498949, 0.7548776662466927  # steps of sequences in no rhythm
SAMPLES = 61  # points at which the surface, and what is on its edges, are held against their images
LOAD_SAMPLES = 1009  # points for loads over the area, which may act on a small part of it
ON_THE_WAY = 0.37  # of a path's end: where loads and motions are looked at beside the states that a case asks for


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
    offset: float

    @property
    def signs(self) -> Array:
        """Factors (3,) of the components of a reflected vector."""
        return np.where(np.arange(3) == self.normal, -1.0, 1.0)

    def image(self, points: ArrayLike) -> Array:
        """Return the mirror images (..., 2) of points."""
        xi = np.array(points, dtype=float)
        xi[..., self.axis] = 2 * self.at - xi[..., self.axis]
        return xi


def _sample(case: Case, count: int = SAMPLES) -> Array:
    """Return points (n, 2) spread over the rectangle in no rhythm."""
    number = np.arange(1, count + 1)
    unit = np.stack([number * GOLDEN % 1, number * PLASTIC % 1], axis=-1)
    sample: Array = np.asarray(case.surface.domain.lower) + unit * np.asarray(case.surface.domain.size)
    return sample


def mirror_of(case: Case, axis: int, at: float) -> Mirror | None:
    """Return the mirror that leaves a coordinate line where it is, if the case has one."""
    points = _sample(case)
    x = case.surface.position(points)
    size = np.ptp(x, axis=0).max()
    for normal in range(3):
        mirror = Mirror(axis, at, normal, 0.0)
        images = case.surface.position(case.surface.domain.wrap(mirror.image(points)))
        others = [c for c in range(3) if c != normal]
        middles = (x[:, normal] + images[:, normal]) / 2
        if np.abs(images[:, others] - x[:, others]).max() > ROUNDING * size or np.ptp(middles) > ROUNDING * size:
            continue
        if np.ptp(x[:, normal]) <= ROUNDING * size:
            continue  # a plane is its own image in itself, but no coordinate line is left where it is by that
        mirror = Mirror(axis, at, normal, float(middles.mean()))
        if _supports_agree(case, mirror) and _loads_agree(case, mirror):
            return mirror
    return None


def _edge_image(edge: Edge, mirror: Mirror) -> Edge:
    if edge.axis != mirror.axis:
        return edge
    side: Side = "max" if edge.side == "min" else "min"
    return Edge(f"xi{edge.axis + 1}_{side}", edge.axis, side)


def _along(case: Case, edge: Edge) -> Array:
    """Return points (n, 2) of an edge in no rhythm."""
    domain, running = case.surface.domain, 1 - edge.axis
    unit = np.arange(1, SAMPLES + 1) * GOLDEN % 1
    return edge.points(domain, np.asarray(domain.lower[running] + unit * domain.size[running]))


def _times(case: Case) -> tuple[float, ...]:
    return case.states if case.linear else (*case.states, ON_THE_WAY * case.path.until)


def _edges(case: Case) -> list[Edge]:
    return [place for place in case.places.values() if isinstance(place, Edge)]


def _same(found: Array, wanted: Array, scale: float) -> bool:
    return bool(np.abs(found - wanted).max() <= ROUNDING * scale) if scale > 0 else True


def _supports_agree(case: Case, mirror: Mirror) -> bool:
    """Tell whether what is held on a place is held on its image, and moves as the image of its motion."""
    held: dict[str, tuple[set[int], bool]] = {}
    for support, place in case.supported_places():
        if isinstance(place, Whole):
            return False
        components, slope = held.get(place.name, (set(), False))
        held[place.name] = (components | {"xyz".index(c) for c in support.held}, slope or support.holds_slope)
    points = [(np.asarray(p.xi), held[p.name]) for p in case.places.values() if isinstance(p, Point) and p.name in held]
    for edge in _edges(case):
        if held.get(edge.name) != held.get(_edge_image(edge, mirror).name):
            return False
    for xi, what in points:
        if not any(other == what and _is_at(case, mirror.image(xi), there) for there, other in points):
            return False
    return all(_motions_agree(case, mirror, t) for t in _times(case))


def _motions_agree(case: Case, mirror: Mirror, t: float) -> bool:
    moves: dict[str, Callable[[Array], Array]] = {}
    for support, place in case.supported_places():
        if support.motion is None:
            continue
        if isinstance(place, Point):
            return False  # none of our cases moves a point; without this, images of points would have to be paired
        columns = np.isin(np.arange(3), ["xyz".index(c) for c in support.held])
        before = moves.get(place.name)
        moves[place.name] = lambda xi, s=support, p=place, c=columns, b=before: (  # type: ignore[misc]
            case.motion(s, p, xi, t)[0, 0] * c + (b(xi) if b else 0.0)
        )
    for edge in _edges(case):
        here, there = moves.get(edge.name), moves.get(_edge_image(edge, mirror).name)
        if here is None and there is None:
            continue
        points = _along(case, edge)
        images = case.surface.domain.wrap(mirror.image(points))
        first = here(points) * mirror.signs if here else np.zeros((len(points), 3))
        second = there(images) if there else np.zeros((len(points), 3))
        if not _same(second, first, float(np.abs(first).max() + np.abs(second).max())):
            return False
    return True


def _is_at(case: Case, point: Array, other: Array) -> bool:
    """Tell whether two points are one, round a closed shell too."""
    domain = case.surface.domain
    for axis in (0, 1):
        gap = abs(point[axis] - other[axis])
        if domain.periodic[axis]:
            gap %= domain.size[axis]
            gap = min(gap, domain.size[axis] - gap)
        if gap > ROUNDING * domain.size[axis]:
            return False
    return True


def _loads_agree(case: Case, mirror: Mirror) -> bool:
    """Tell whether all loads at a point are the reflections of those at its image."""
    points = _sample(case, LOAD_SAMPLES)
    images = case.surface.domain.wrap(mirror.image(points))
    for t in _times(case):
        here, there = load_density(case, points, t), load_density(case, images, t)
        if not _same(there, here * mirror.signs, float(np.abs(here).max() + np.abs(there).max())):
            return False
        for edge in _edges(case):
            along = _along(case, edge)
            other, image = _edge_image(edge, mirror), case.surface.domain.wrap(mirror.image(along))
            if other.axis == mirror.axis:  # wrapping must not leave the edge
                image = other.project(case.surface.domain, image)
            for kind, flip in ((EdgeLoad, 1.0), (MomentLoad, -1.0)):  # a moment is an axial vector
                here, there = _edge_density(case, edge, along, t, kind), _edge_density(case, other, image, t, kind)
                if not _same(there, flip * here * mirror.signs, float(np.abs(here).max() + np.abs(there).max())):
                    return False
        forces = point_forces(case, t)
        scale = max((float(np.abs(force).max()) for _, force in forces), default=0.0)
        for xi, _ in forces:
            here = _force_at(case, forces, xi)
            if not _same(_force_at(case, forces, mirror.image(xi)), here * mirror.signs, scale):
                return False
    return True


def _edge_density(case: Case, edge: Edge, points: Array, t: float, kind: type) -> Array:
    """Return line loads or moments (n, 3) per length at points (n, 2) of an edge."""
    total = np.zeros((len(points), 3))
    for load in case.loads:
        if not isinstance(load, kind) or not isinstance(load, EdgeLoad | MomentLoad):
            continue
        times = load.on.count(edge.name)
        if times and isinstance(load, EdgeLoad):
            total += times * case.evaluate(load.vector, points, t)[0, 0]
        elif times and isinstance(load, MomentLoad):
            axis = np.asarray(load.axis) / np.linalg.norm(load.axis)
            total += times * case.formula(load.value).derivatives(points, 0, t)[0, 0][:, None] * axis
    return total


def point_forces(case: Case, t: float) -> list[tuple[Array, Array]]:
    """Return the point (2,) and the force (3,) of each point load, N."""
    found = []
    for load in case.loads:
        if isinstance(load, PointLoad):
            for name in load.on:
                place = case.places[name]
                assert isinstance(place, Point)
                xi = np.asarray(place.xi)
                found.append((xi, case.evaluate(load.force, xi, t)[0, 0]))
    return found


def _force_at(case: Case, forces: list[tuple[Array, Array]], point: Array) -> Array:
    total = np.zeros(3)
    for xi, force in forces:
        if _is_at(case, xi, point):
            total += force
    return total
