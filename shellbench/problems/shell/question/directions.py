"""Directions local to the surface: along an edge, across it within the surface, and normal to the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.conditions import COMPONENTS, LOCAL, Support
from shellbench.problems.shell.question.places import Edge, Place
from shellbench.problems.shell.question.surface import Surface

Array = NDArray[np.float64]


def local_directions(surface: Surface, points: Array, edge: Edge | None = None) -> Array:
    """Return the unit vectors (n, 3, 3) along, across and normal, in this order, at points (n, 2).

    On an edge, `along` goes as its running coordinate grows, and `across` leaves the surface at right angles to the
    edge. Elsewhere `along` goes as xi1 grows, and `across` = normal x along. The normal is a1 x a2 / |a1 x a2|.
    """
    x = surface.derivatives(points, order=1)
    normal = np.cross(x[1, 0], x[0, 1])
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    along = x[0, 1] if edge is not None and edge.axis == 0 else x[1, 0]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    across = np.cross(normal, along)
    if edge is not None and (edge.axis == 0) == (edge.side == "max"):
        across = -across  # a3 x a2 points to smaller xi1, a3 x a1 to larger xi2
    return np.stack([along, across, normal], axis=-2)


def held_directions(surface: Surface, support: Support, place: Place, points: Array) -> Array:
    """Return the unit vectors (n, held, 3) along which a support holds points (n, 2) of one of its places."""
    if not support.local:
        axes = np.eye(3)[[COMPONENTS.index(name) for name in support.held]]
        return np.broadcast_to(axes, (len(points), *axes.shape))
    frame = local_directions(surface, points, place if isinstance(place, Edge) else None)
    return frame[:, [LOCAL.index(name) for name in support.held]]


def in_space(surface: Surface, vectors: Array, points: Array, edge: Edge | None = None) -> Array:
    """Return vectors (n, 3), given by their parts along, across and normal, as Cartesian ones."""
    return np.asarray(np.einsum("pk,pkc->pc", vectors, local_directions(surface, points, edge)))
