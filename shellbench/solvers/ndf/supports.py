"""What the supports of a case ask of a field, edge by edge and point by point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import Support
from shellbench.problems.shell.places import SIDES, Edge, Point
from shellbench.solvers.ndf.jets import Array

EDGE_SAMPLES = 33  # points of an edge at which its normal is looked at
TANGENTIAL = 1e-9  # a component of a unit vector below this is zero


@dataclass(frozen=True)
class EdgeSupport:
    """All that the supports on one edge hold.

    Attributes
    ----------
    held
        For each held component (0, 1, 2), the support that holds it.
    slope
        The support that holds u,n . a3, if one does.
    tilted
        Whether the held components have a part along a3, so that they tilt the normal as they leave the edge.
    even
        Whether free components have such a part: their slope is held by letting them depend on the distance from the
        edge through its even powers only.
    """

    edge: Edge
    held: dict[int, Support]
    slope: Support | None
    tilted: bool
    even: bool


@dataclass(frozen=True)
class PointSupport:
    """One component held at one point: the support, where, which component, and its displacement, metres."""

    support: Support
    point: Point
    component: int
    value: float


def edge_supports(case: Case) -> tuple[EdgeSupport, ...]:
    """Return the supported edges of a case."""
    held: dict[Edge, dict[int, Support]] = {}
    slope: dict[Edge, Support] = {}
    for support, place in case.supported_places():
        if isinstance(place, Edge):
            components = held.setdefault(place, {})
            components.update({"xyz".index(c): support for c in support.held})
            if support.holds_slope:
                slope[place] = support
    supports = []
    for edge, components in held.items():
        along = edge_normals(case, edge)
        free = [c for c in range(3) if c not in components]
        supports.append(
            EdgeSupport(
                edge,
                components,
                slope.get(edge),
                tilted=edge in slope and bool(np.abs(along[:, list(components)]).max(initial=0.0) > TANGENTIAL),
                even=edge in slope and bool(np.abs(along[:, free]).max(initial=0.0) > TANGENTIAL),
            )
        )
    return tuple(supports)


def point_supports(case: Case, t: float = 1.0) -> tuple[PointSupport, ...]:
    """Return what is held at points and corners."""
    return tuple(
        PointSupport(support, place, component, float(motion[component]))
        for support, place in case.supported_places()
        if isinstance(place, Point)
        for motion in [case.motion(support, place, np.asarray(place.xi), t)[0, 0]]
        for component in sorted("xyz".index(c) for c in support.held)
    )


def even_sides(supports: tuple[EdgeSupport, ...]) -> tuple[tuple[bool, bool], tuple[bool, bool]]:
    """Tell, for each coordinate, at which of its bounds (lower, upper) inputs must be even."""
    even = {(s.edge.axis, s.edge.side) for s in supports if s.even}
    first, second = (tuple((axis, side) in even for side in SIDES) for axis in (0, 1))
    return (first[0], first[1]), (second[0], second[1])


def edge_samples(case: Case, edge: Edge, count: int = EDGE_SAMPLES) -> Array:
    """Return (count, 2) points along an edge, both its ends included."""
    domain, running = case.surface.domain, 1 - edge.axis
    return edge.points(domain, np.linspace(domain.lower[running], domain.upper[running], count))


def edge_normals(case: Case, edge: Edge) -> Array:
    """Return a3 (n, 3) at samples of an edge."""
    x = case.surface.derivatives(edge_samples(case, edge), 1)
    normal = np.cross(x[1, 0], x[0, 1])
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))
