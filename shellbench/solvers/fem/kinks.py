"""Kinks of a midsurface: where a tangent jumps, and a C1 element would answer for a rigid corner.

Between two points of a coordinate line the tangent changes by the integral of its own derivative, and by whatever it
jumps. Formulas know the derivative on both sides of a kink and nothing of the kink itself. So intervals whose change is
not the integral are halved until it is, or until they are so short that only a jump is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.surface import ExpressionSurface, Surface
from shellbench.solvers.fem.mesh import gauss_rule

Array = NDArray[np.float64]

INTERVALS = 24  # along each coordinate line, at first
LINES = 7  # of each coordinate
GAUSS_POINTS = 4  # of an interval
SHORTEST = 1e-10  # of the side: a shorter interval holds a jump
SMALLEST = 1e-6  # change of a tangent, relative to its length, that is none of the integral: some 1e-6 rad
MOST = 4096  # intervals that are halved at once; a surface with more to resolve is left to the meshes


@dataclass(frozen=True)
class Kink:
    """A place where a tangent jumps.

    Attributes
    ----------
    xi
        Its curvilinear coordinates, degrees where they are angles.
    degrees
        Angle between the tangents on both sides.
    """

    xi: tuple[float, float]
    degrees: float


def find_kink(surface: Surface) -> Kink | None:
    """Return the sharpest kink along some coordinate lines of both families, or None."""
    if not isinstance(surface, ExpressionSurface):
        return None  # planes and cylinders have none
    found = [kink for axis in (0, 1) for kink in _kinks_along(surface, axis)]
    return max(found, key=lambda kink: kink.degrees, default=None)


def _kinks_along(surface: Surface, axis: int) -> list[Kink]:
    domain = surface.domain
    size = np.array(domain.size)
    # lines at no simple share of the side, so that no line runs along a kink
    across = domain.lower[1 - axis] + size[1 - axis] * ((np.arange(LINES) + 0.5 / np.sqrt(2)) / LINES)
    edges = domain.lower[axis] + size[axis] * np.linspace(0, 1, INTERVALS + 1)
    start, at = (grid.ravel() for grid in np.meshgrid(edges[:-1], across, indexing="ij"))
    stop = np.repeat(edges[1:], LINES)
    while len(start) and len(start) <= MOST:
        jump, length = _jumps(surface, axis, start, stop, at)
        # Written so that what is not a number is not smooth.
        rough = ~(np.linalg.norm(jump, axis=-1) <= SMALLEST * length)
        start, stop, at = start[rough], stop[rough], at[rough]
        if not len(start):
            break
        if np.all(stop - start <= SHORTEST * size[axis]):
            return [_kink(surface, axis, *place) for place in zip(start, stop, at, strict=True)]
        middle = (start + stop) / 2
        start, stop = np.concatenate([start, middle]), np.concatenate([middle, stop])
        at = np.concatenate([at, at])
    return []


def _points(axis: int, along: Array, across: Array) -> Array:
    points = [along, across] if axis == 0 else [across, along]
    return np.stack(np.broadcast_arrays(*points), axis=-1)


def _jumps(surface: Surface, axis: int, start: Array, stop: Array, at: Array) -> tuple[Array, Array]:
    """Return how much tangents (n, 3) change besides the integral of their derivative, and their lengths (n,)."""
    first, second = ((1, 0), (2, 0)) if axis == 0 else ((0, 1), (0, 2))
    x, weights = gauss_rule(GAUSS_POINTS)
    inside = start[:, None] + (stop - start)[:, None] * (x + 1) / 2
    with np.errstate(all="ignore"):
        curving = surface.derivatives(_points(axis, inside, at[:, None]), order=2)[second]
        ends = surface.derivatives(_points(axis, np.stack([start, stop]), at), order=1)[first]
    integral = (weights / 2) @ curving * (stop - start)[:, None]
    return ends[1] - ends[0] - integral, np.linalg.norm(ends, axis=-1).max(axis=0)


def _kink(surface: Surface, axis: int, start: float, stop: float, at: float) -> Kink:
    # a little off the kink, where formulas may not be numbers
    width = 4 * (stop - start)
    sides = _points(axis, np.array([start - width, stop + width]), np.array(at))
    before, after = surface.derivatives(sides, order=1)[(1, 0) if axis == 0 else (0, 1)]
    turn = np.arctan2(np.linalg.norm(np.cross(before, after)), before @ after)
    place = [(start + stop) / 2, at] if axis == 0 else [at, (start + stop) / 2]
    shown = [np.degrees(c) if angle else c for c, angle in zip(place, surface.domain.angle, strict=True)]
    return Kink((float(shown[0]), float(shown[1])), float(np.degrees(turn)))
