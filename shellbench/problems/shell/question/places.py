"""Named places on the parametric rectangle: edges, corners, points, and the whole of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.question.surface import COORDINATES, Domain
from shellbench.protocol.schema import Finite, Model

Side = Literal["min", "max"]
SIDES: tuple[Side, Side] = ("min", "max")
SLACK = 1e-9  # of a side: a smaller difference of coordinates counts as none
SHORTEST = 1e-6  # of an edge: no part of it is shorter


class EdgePart(Model):
    """A part of an edge, between two values of the coordinate that runs along it.

    Attributes
    ----------
    edge
        Name of the edge.
    between
        Start and end of the part, the smaller value first; degrees for angles.
    """

    edge: str
    between: tuple[Finite, Finite]


@dataclass(frozen=True)
class Edge:
    """An edge of the rectangle, or a part of one: coordinate number `axis` (0 or 1) at its bound.

    Attributes
    ----------
    between
        Start and end of a part in the running coordinate, angles in radians; None for a whole edge.
    """

    name: str
    axis: int
    side: Side
    between: tuple[float, float] | None = None

    @property
    def whole(self) -> bool:
        """True if it is the whole edge."""
        return self.between is None

    def coordinate(self, domain: Domain) -> float:
        """Return the value of the fixed coordinate."""
        return (domain.lower if self.side == "min" else domain.upper)[self.axis]

    def bounds(self, domain: Domain) -> tuple[float, float]:
        """Return its start and end in the running coordinate."""
        return self.between or (domain.lower[1 - self.axis], domain.upper[1 - self.axis])

    def samples(self, domain: Domain, count: int) -> NDArray[np.float64]:
        """Return so many points (count, 2) of it, evenly, both ends included."""
        return self.points(domain, np.linspace(*self.bounds(domain), count))

    def covers(self, domain: Domain, running: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a mask of values of the running coordinate, in any period of a closed one, on it or at its ends."""
        if self.between is None:
            return np.ones(np.shape(running), dtype=bool)
        start, stop = self.between
        slack = SLACK * domain.size[1 - self.axis]
        beyond = running - start + slack
        if domain.periodic[1 - self.axis]:
            beyond = np.mod(beyond, domain.size[1 - self.axis])
        return np.asarray((beyond >= 0) & (beyond <= stop - start + 2 * slack))

    def overlaps(self, other: Edge, domain: Domain) -> bool:
        """Return True if the two edges have more than a point in common."""
        if (self.axis, self.side) != (other.axis, other.side):
            return False
        (start, stop), (first, last) = self.bounds(domain), other.bounds(domain)
        return min(stop, last) - max(start, first) > SLACK * domain.size[1 - self.axis]

    def points(self, domain: Domain, running: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (n, 2) points of the edge at values (n,) of the running coordinate."""
        xi = np.empty((len(running), 2))
        xi[:, self.axis] = self.coordinate(domain)
        xi[:, 1 - self.axis] = running
        return xi

    def project(self, domain: Domain, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points (..., 2) moved onto the edge along the fixed coordinate."""
        xi = np.array(points, dtype=float)
        xi[..., self.axis] = self.coordinate(domain)
        return xi


@dataclass(frozen=True)
class Point:
    """A point or a corner, (xi1, xi2), angles in radians."""

    name: str
    xi: tuple[float, float]


@dataclass(frozen=True)
class Whole:
    """The whole surface."""

    name: str


WHOLE = Whole("surface")
Place = Edge | Point | Whole


def places_of(
    domain: Domain, named: Mapping[str, tuple[float, float]], parts: Mapping[str, EdgePart] | None = None
) -> dict[str, Place]:
    """Return all places by name: edges and corners of the domain, and the case's own points and parts of edges.

    Edges are called xi1_min, xi1_max, xi2_min, xi2_max (a periodic coordinate has none) and corners
    by their two edges, such as "xi1_min,xi2_max". The whole surface is called "surface".

    Raises
    ------
    InputError
        If a point or a part of an edge lies outside the domain, or takes the name of another place.
    """
    edges = {
        (axis, side): Edge(f"{COORDINATES[axis]}_{side}", axis, side)
        for axis, side in product((0, 1), SIDES)
        if not domain.periodic[axis]
    }
    places: dict[str, Place] = {edge.name: edge for edge in edges.values()}
    places[WHOLE.name] = WHOLE
    if not any(domain.periodic):
        for first, second in product(SIDES, SIDES):
            name = f"xi1_{first},xi2_{second}"
            places[name] = Point(name, (edges[0, first].coordinate(domain), edges[1, second].coordinate(domain)))
    for name, coordinates in named.items():
        if name in places:
            raise InputError(f"field 'points.{name}': this name belongs to an edge, a corner or the surface")
        xi = domain.internal(coordinates)
        if not domain.contains(np.asarray(xi)):
            raise InputError(f"field 'points.{name}': {list(coordinates)} lies outside the domain of the surface")
        places[name] = Point(name, xi)
    for name, part in (parts or {}).items():
        if name in places:
            raise InputError(f"field 'edge_parts.{name}': this name belongs to another place")
        places[name] = _part(domain, name, part, {edge.name: edge for edge in edges.values()})
    return places


def _part(domain: Domain, name: str, part: EdgePart, edges: Mapping[str, Edge]) -> Edge:
    where = f"field 'edge_parts.{name}'"
    if part.edge not in edges:
        known = f"edges are {', '.join(edges)}" if edges else "the surface has none"
        raise InputError(f"{where}: '{part.edge}' is not an edge; {known}")
    edge = edges[part.edge]
    running = 1 - edge.axis
    start, stop = (float(np.radians(x)) if domain.angle[running] else x for x in part.between)
    slack = SLACK * domain.size[running]
    if not domain.lower[running] - slack <= start <= stop <= domain.upper[running] + slack:
        raise InputError(
            f"{where}: between {list(part.between)} is not in order, or lies outside the bounds of"
            f" {COORDINATES[running]}"
        )
    if stop - start < SHORTEST * domain.size[running]:
        raise InputError(f"{where}: between {list(part.between)} is shorter than {SHORTEST:g} of the edge")
    return Edge(name, edge.axis, edge.side, (start, stop))
