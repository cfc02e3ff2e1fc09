"""The lengths over which a shell's solution varies: around points that carry a force, and along edges.

A shell bends within layers of the length sqrt(h R), R the smallest radius of curvature, far below its size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import PointLoad
from shellbench.problems.shell.places import Point
from shellbench.solvers.ndf.choices import LAYER
from shellbench.solvers.ndf.jets import Array
from shellbench.solvers.ndf.supports import point_supports

SURFACE_SAMPLES = 9  # points a side of the grid on which a surface is looked at

EDGE_LAYER = 1.0  # the same along an edge; between .4 and 1 the certified energy of a hyperbolic paraboloid is flat
WIDEST = 0.12  # l in units of the shell's size at most, and where it is flat
CURVED = 1e-9  # a principal curvature times the size below this is flat: rounding of the shape operator


@dataclass(frozen=True)
class Focus:
    """A point that carries a force, and the lengths of the solution around it.

    Attributes
    ----------
    xi
        (xi1, xi2), radians for angles.
    position, tangents
        (3,), (2, 3): where it is, and an orthonormal basis of the tangent plane; the first along a_1.
    reach
        Length over which the solution is plate-like at all, metres: the smallest radius of curvature or the size.
    layer
        Length of the bending layer l, metres.
    """

    xi: tuple[float, float]
    position: Array
    tangents: Array
    reach: float
    layer: float


def foci(case: Case, layer: float = LAYER) -> tuple[Focus, ...]:
    """Return the points of a case that carry a force: point loads, point supports, and those that it names a focus."""
    loaded = [*case.focus, *(name for load in case.loads if isinstance(load, PointLoad) for name in load.on)]
    places = [case.places[name] for name in loaded] + [s.point for s in point_supports(case)]
    distinct = {place.xi: place for place in places if isinstance(place, Point)}
    return tuple(_focus(case, xi, layer) for xi in distinct)


def _focus(case: Case, xi: tuple[float, float], layer: float) -> Focus:
    x = case.surface.derivatives(np.asarray(xi), 1)
    first = x[1, 0] / np.linalg.norm(x[1, 0])
    second = x[0, 1] - (x[0, 1] @ first) * first
    second /= np.linalg.norm(second)
    size, curvature = surface_size(case), strongest_curvature(case, np.asarray([xi]))
    reach = min(size, 1 / curvature) if curvature else size
    return Focus(xi, x[0, 0], np.stack([first, second]), reach, layer_length(case, curvature, layer, size))


def layer_length(case: Case, curvature: float, layer: float, size: float) -> float:
    """Return `layer` sqrt(h R), metres, or a share of the size where that is less or the shell is flat."""
    if not curvature:
        return WIDEST * size
    return min(layer * math.sqrt(case.material.thickness / curvature), WIDEST * size)


def surface_size(case: Case) -> float:
    """Return the largest distance from the middle of the surface, metres."""
    sample = case.surface.position(case.surface.domain.grid(SURFACE_SAMPLES, SURFACE_SAMPLES)).reshape(-1, 3)
    return float(np.linalg.norm(sample - sample.mean(axis=0), axis=1).max())


def strongest_curvature(case: Case, points: Array | None = None) -> float:
    """Return the largest principal curvature, 1/m, at points (n, 2) or anywhere; zero where the surface is flat."""
    if points is None:
        points = case.surface.domain.grid(SURFACE_SAMPLES, SURFACE_SAMPLES).reshape(-1, 2)
    x = case.surface.derivatives(points, 2)
    a = np.stack([x[1, 0], x[0, 1]], axis=-2)
    normal = np.cross(x[1, 0], x[0, 1])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    b11, b12, b22 = ((x[key] * normal).sum(-1) for key in ((2, 0), (1, 1), (0, 2)))
    b = np.stack([np.stack([b11, b12], axis=-1), np.stack([b12, b22], axis=-1)], axis=-2)
    principal = np.linalg.eigvals(np.linalg.solve(a @ np.swapaxes(a, -1, -2), b))
    strongest = float(np.abs(principal).max())
    return strongest if strongest * surface_size(case) > CURVED else 0.0


def edge_layers(case: Case) -> tuple[float, float] | None:
    """Return the lengths of the layers at the edges of xi1 and of xi2, in those coordinates; None for a flat shell."""
    curvature = strongest_curvature(case)
    if not curvature:
        return None
    domain = case.surface.domain
    middle = [(low + high) / 2 for low, high in zip(domain.lower, domain.upper, strict=True)]
    x = case.surface.derivatives(np.asarray(middle), 1)
    speeds = [float(np.linalg.norm(d)) for d in (x[1, 0], x[0, 1])]
    first, second = (
        layer_length(case, curvature, EDGE_LAYER, speed * size) / speed
        for speed, size in zip(speeds, domain.size, strict=True)
    )
    return first, second
