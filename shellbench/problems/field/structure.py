"""Local structures: four equilateral triangles about a point, and the losses that they measure.

    Shu et al., "Spatially Adaptive Cloth Regression with Implicit Neural Representations", section 3.3

The triangle in the middle has the corners A, B, C; each of the other three shares an edge with it. Strain uses the
edges of the middle triangle, bending its three pairs of faces, gravity the middle, collision all six corners. The paper
does not state how it fits structures to the square.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.field.body import Body

Array = NDArray[np.float64]

EDGES = ((0, 1), (1, 2), (2, 0))
MIDDLE = (0, 1, 2)
OUTER = ((2, 1, 3), (0, 2, 4), (1, 0, 5))  # faces beyond the edges BC, CA, AB, wound as the middle one
WIDEST = 2.0  # extent of a structure over the side, at most
TURN = 2 * math.pi / 3  # after which a structure is the same
LOSSES = ("strain", "bend", "gravity", "collision")


def corners(middles: Array, angles: Array, side: float, count: int = 6, past_edges: bool = False) -> Array:
    """Return the corners (n, count, 2) of structures about points (n, 2), turned by angles (n,).

    The first three are those of the middle triangle. A structure that would leave the square is moved inward until
    these corners fit, and no farther: in a margin without edges of structures, a field could stretch at no cost. With
    `past_edges` nothing is moved: the field continues beyond the square.
    """
    turned = angles[:, None] + TURN * np.arange(3)
    inner = side / math.sqrt(3) * np.stack([np.cos(turned), np.sin(turned)], axis=-1)
    around = np.concatenate([inner, -2 * inner], axis=1)[:, :count]
    if past_edges:
        return np.asarray(middles[:, None] + around)
    inside = np.clip(middles, -around.min(axis=1), 1 - around.max(axis=1))
    return np.asarray(np.clip(inside[:, None] + around, 0.0, 1.0))  # by rounding alone


def unit_normals(places: Array, face: tuple[int, int, int]) -> Array:
    """Return the unit normals (n, 3) of a face of structures (n, 6, 3)."""
    a, b, c = (places[:, corner] for corner in face)
    normal = np.cross(b - a, c - a)
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def strain(places: Array, rest: Array) -> Array:
    """Return the strain loss (n,) of structures (n, 6, 3) with rest places (n, 6, 3): eq. (19)."""
    found = np.zeros(len(places))
    for i, j in EDGES:
        length = np.linalg.norm(rest[:, j] - rest[:, i], axis=1)
        found += (np.linalg.norm(places[:, j] - places[:, i], axis=1) / length - 1) ** 2
    return found


def bend(places: Array) -> Array:
    """Return the bending loss (n,) of structures (n, 6, 3): eq. (22)."""
    middle = unit_normals(places, MIDDLE)
    return np.asarray(sum(np.sum((middle - unit_normals(places, face)) ** 2, axis=1) for face in OUTER))


def depths(places: Array, body: Body) -> Array:
    """Return the collision loss (n,) of structures (n, 6, 3) and a body: eq. (26), summed over the corners."""
    distances = body.contact(places.reshape(-1, 3))[0].reshape(places.shape[:-1])
    return np.asarray(np.sum(np.minimum(distances, 0) ** 2, axis=1))


def lattice(count: int) -> Array:
    """Return the midpoints (count^2, 2) of equal cells of the unit square."""
    middles = (np.arange(count) + 0.5) / count
    return np.stack(np.meshgrid(middles, middles, indexing="ij"), axis=-1).reshape(-1, 2)


def weighted(losses: Mapping[str, Array], weights: Mapping[str, float], names: Iterable[str] = LOSSES) -> Array:
    """Return the sum of losses by name times their weights."""
    return np.asarray(sum(weights[name] * losses[name] for name in names if name in losses))
