"""The body under a cape: capsules in the frame of the neck, some of which swing, and their signed distance.

The distance phi is negative inside, and its gradient has length one and points outward. x points to the left, y to the
back, z upward; the origin is at the neck.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.model import Model, Name, Positive, Vector

Array = NDArray[np.float64]
TINY = 1e-30  # keeps directions on an axis finite, in float32 too


class Capsule(Model):
    """A ball that is drawn along a segment; it can swing about the line along x through its first end."""

    name: Name = Field(description="what it stands for")
    start: Vector = Field(description="first end of the segment, about which it swings, m")
    end: Vector = Field(description="other end, m")
    radius: Positive = Field(description="m")
    swings: bool = Field(False, strict=True, description="whether the angle of a stride turns it about its start")


def segments(body: Sequence[Capsule], stride: Array) -> Array:
    """Return the ends of the capsules' axes (..., c, 2, 3), m, for angles of a stride (...), rad, forward."""
    ends = np.array([(part.start, part.end) for part in body])
    found = np.broadcast_to(ends, (*stride.shape, *ends.shape)).copy()
    for place, part in enumerate(body):
        if part.swings:
            along = ends[place, 1] - ends[place, 0]
            found[..., place, 1, 1] = ends[place, 0, 1] + np.cos(stride) * along[1] + np.sin(stride) * along[2]
            found[..., place, 1, 2] = ends[place, 0, 2] - np.sin(stride) * along[1] + np.cos(stride) * along[2]
    return found


def distance(places: Array, axes: Array, radii: Array) -> Array:
    """Return phi (..., n), m, at places (..., n, 3) for axes (..., c, 2, 3) and radii (c,), m."""
    nearest = np.full(places.shape[:-1], np.inf, dtype=places.dtype)
    for part, radius in enumerate(radii):
        nearest = np.minimum(nearest, np.linalg.norm(_from_axis(places, axes[..., part, :, :]), axis=-1) - radius)
    return np.asarray(nearest)


def directions(places: Array, axes: Array) -> Array:
    """Return the direction (..., c, n, 3) from the axis of each capsule to each place (..., n, 3)."""
    apart = np.stack([_from_axis(places, axes[..., part, :, :]) for part in range(axes.shape[-3])], axis=-3)
    return np.asarray(apart / np.maximum(np.linalg.norm(apart, axis=-1, keepdims=True), TINY))


def pushed_out(places: Array, axes: Array, radii: Array, margin: float, along: Array | None = None) -> Array:
    """Return places (..., n, 3) after those inside are pushed to phi = margin, one capsule after another.

    They go along the gradient of phi, or along directions (..., c, n, 3) that were found before they went in.
    """
    for part, radius in enumerate(radii):
        apart = _from_axis(places, axes[..., part, :, :])
        length = np.linalg.norm(apart, axis=-1, keepdims=True)
        way = apart / np.maximum(length, TINY) if along is None else along[..., part, :, :]
        depth = radius + margin - (apart * way).sum(-1, keepdims=True)
        places = places + np.where(length < radius + margin, depth, 0.0) * way
    return places


def _from_axis(places: Array, axis: Array) -> Array:
    """Return what leads from the nearest point of a segment (..., 2, 3) to each place (..., n, 3)."""
    start, along = axis[..., None, 0, :], axis[..., None, 1, :] - axis[..., None, 0, :]
    share = ((places - start) * along).sum(-1, keepdims=True) / np.maximum((along**2).sum(-1, keepdims=True), TINY)
    return np.asarray(places - start - np.clip(share, 0.0, 1.0) * along)
