"""Named places on the parametric rectangle: edges, corners, points, and the whole of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.surface import COORDINATES, Domain

Side = Literal["min", "max"]
SIDES: tuple[Side, Side] = ("min", "max")


@dataclass(frozen=True)
class Edge:
    """An edge of the rectangle: coordinate number `axis` (0 or 1) at its bound."""

    name: str
    axis: int
    side: Side

    def coordinate(self, domain: Domain) -> float:
        """Return the value of the fixed coordinate."""
        return (domain.lower if self.side == "min" else domain.upper)[self.axis]

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


def places_of(domain: Domain, named: Mapping[str, tuple[float, float]]) -> dict[str, Place]:
    """Return all places by name: edges and corners of the domain, and the case's own points.

    Edges are called xi1_min, xi1_max, xi2_min, xi2_max (a periodic coordinate has none) and corners
    by their two edges, such as "xi1_min,xi2_max". The whole surface is called "surface".

    Raises
    ------
    InputError
        If a point lies outside the domain or takes the name of an edge or corner.
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
    return places
