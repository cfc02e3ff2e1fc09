"""Seeing a surface in three dimensions: a camera without perspective, light, and painting from back to front.

matplotlib's own 3-D axes sort whole collections, so that a wire and a surface never hide each other rightly;
here every facet and every piece of wire is sorted by its depth, in one collection.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

Array = NDArray[np.float64]
Up = Literal["x", "y", "z"]
AXES_TO_UP: dict[Up, tuple[int, int, int]] = {"z": (0, 1, 2), "y": (2, 0, 1), "x": (1, 2, 0)}
AMBIENT = 0.6  # share of the light that reaches every facet
LIGHT = (-0.35, 0.55, 0.76)  # in the camera's frame: from the upper left, in front


@dataclass(frozen=True)
class Camera:
    """A camera at an infinite distance.

    Attributes
    ----------
    elevation, azimuth
        Degrees, as in matplotlib's 3-D axes.
    up
        The Cartesian axis that points up in the picture.
    """

    elevation: float
    azimuth: float
    up: Up = "z"

    @property
    def axes(self) -> Array:
        """Rows: right, upwards and towards the viewer, as (3, 3) in Cartesian components."""
        e, a = np.radians([self.elevation, self.azimuth])
        right = [-np.sin(a), np.cos(a), 0.0]
        upwards = [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]
        towards = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        turned = np.zeros((3, 3))
        turned[:, list(AXES_TO_UP[self.up])] = np.array([right, upwards, towards])
        return turned

    def look(self, points: Array) -> Array:
        """Return (..., 3): right, up and depth (larger is nearer) of points (..., 3) in metres."""
        return points @ self.axes.T

    def seen_at(self, point: Array) -> tuple[float, float]:
        """Return where in the picture a point (3,) in metres is."""
        right, upwards, _ = self.look(point)
        return float(right), float(upwards)


def facets(grid: Array) -> Array:
    """Return the (m, 4, 3) facets of a grid of points (n1, n2, 3)."""
    corners = (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def facet_means(values: Array) -> Array:
    """Return the mean (m,) over the corners of each facet of values (n1, n2)."""
    corners = values[:-1, :-1] + values[1:, :-1] + values[1:, 1:] + values[:-1, 1:]
    return (corners / 4.0).reshape(-1)


def shading(seen: Array) -> Array:
    """Return the light (m,) in [AMBIENT, 1] on facets (m, 4, 3) in the camera's frame, whichever side is seen."""
    normal = np.cross(seen[:, 2] - seen[:, 0], seen[:, 3] - seen[:, 1])
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    unit = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    unit *= np.where(unit[:, 2:] < 0, -1.0, 1.0)
    direction = np.asarray(LIGHT) / np.linalg.norm(LIGHT)
    lit: Array = AMBIENT + (1.0 - AMBIENT) * np.clip(unit @ direction, 0.0, 1.0)
    return lit


def refined(grid: Array, cells: int) -> Array:
    """Return a grid (n1, n2, 3) of at least `cells` cells a side, by cubic splines through the given points."""
    if min(grid.shape[:2]) < 4 or min(grid.shape[:2]) > cells:
        return grid
    parameters = [np.arange(n, dtype=float) for n in grid.shape[:2]]
    fine = [np.linspace(0.0, p[-1], (len(p) - 1) * -(-cells // (len(p) - 1)) + 1) for p in parameters]
    return np.stack([RectBivariateSpline(*parameters, grid[..., i], s=0)(*fine) for i in range(3)], axis=-1)


def wires(grid: Array, lines: int) -> Array:
    """Return the (m, 2, 3) pieces of coordinate lines about as far apart in one direction as in the other.

    There are `lines` of them on a square surface; edges are always among them.
    """
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=-1).sum(axis).mean() for axis in (0, 1)]
    spacing = max(float(np.sqrt(steps[0] * steps[1])), 1e-300) / (lines - 1)
    pieces = []
    for lattice, length in ((grid, steps[0]), (grid.swapaxes(0, 1), steps[1])):
        number = int(np.clip(round(float(length) / spacing) + 1, 2, len(lattice)))
        chosen = np.unique(np.linspace(0, len(lattice) - 1, number).round().astype(int))
        along = lattice[chosen]
        pieces.append(np.stack([along[:, :-1], along[:, 1:]], axis=2).reshape(-1, 2, 3))
    return np.concatenate(pieces)
