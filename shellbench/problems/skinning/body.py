"""The body under a cape: capsules in the frame of the neck, some of which swing, and their signed distance.

The distance phi is negative inside, and its gradient has length one and points outward. x points to the left, y to the
back, z upward; the origin is at the neck.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.protocol.schema import Finite, Flag, Model, Name, Positive, Vector

Array = NDArray[np.float64]
TINY = 1e-30  # keeps directions on an axis finite, in float32 too


class Capsule(Model):
    """A ball swept along a segment; it can swing about the line along x through its first end."""

    name: Name = Field(description="what it stands for")
    start: Vector = Field(description="first end of the segment, about which it swings, m")
    end: Vector = Field(description="other end, m")
    radius: Positive = Field(description="m")
    swings: Flag = Field(False, description="whether the angle of a stride turns it about its start")
    stride: Finite = Field(1.0, description="if it swings: its angle over that of the stride; the other leg has -1")


def segments(body: Sequence[Capsule], stride: Array) -> Array:
    """Return the ends of the capsules' axes (..., c, 2, 3), m, for angles of a stride (...), rad, forward."""
    ends = np.array([(part.start, part.end) for part in body])
    found = np.broadcast_to(ends, (*stride.shape, *ends.shape)).copy()
    for place, part in enumerate(body):
        if part.swings:
            along = ends[place, 1] - ends[place, 0]
            cosine, sine = np.cos(part.stride * stride), np.sin(part.stride * stride)
            found[..., place, 1, 1] = ends[place, 0, 1] + cosine * along[1] + sine * along[2]
            found[..., place, 1, 2] = ends[place, 0, 2] - sine * along[1] + cosine * along[2]
    return found


def distance(places: Array, axes: Array, radii: Array) -> Array:
    """Return phi (..., n), m, at places (..., n, 3) for axes (..., c, 2, 3) and radii (c,), m.

    It uses products of matrices, which are far faster than sums over an axis of three: a training evaluates a million
    places a second.
    """
    start, along = axes[..., 0, :], axes[..., 1, :] - axes[..., 0, :]
    turned = np.swapaxes(places, -1, -2)
    forth = along @ turned - _dot(along, start)[..., None]  # (..., c, n): the way along an axis times its length
    from_start = _dot(places, places)[..., None, :] - 2 * (start @ turned) + _dot(start, start)[..., None]
    square = np.maximum(_dot(along, along), TINY)[..., None]
    share = np.clip(forth / square, 0.0, 1.0)
    apart = np.sqrt(np.maximum(from_start - share * (2 * forth - share * square), 0.0))
    return np.asarray((apart - radii[:, None]).min(axis=-2))


def directions(places: Array, axes: Array) -> Array:
    """Return the direction (..., c, n, 3) from the axis of each capsule to each place (..., n, 3)."""
    apart = np.stack([_from_axis(places, axes[..., part, :, :]) for part in range(axes.shape[-3])], axis=-3)
    return np.asarray(apart / np.maximum(_length(apart)[..., None], TINY))


def pushed_out(places: Array, axes: Array, radii: Array, margin: float, along: Array | None = None) -> Array:
    """Return places (..., n, 3) after those inside are pushed to phi = margin, one capsule after another.

    They move along the gradient of phi, or along given directions (..., c, n, 3), those before they went in.
    """
    for part, radius in enumerate(radii):
        apart = _from_axis(places, axes[..., part, :, :])
        length = _length(apart)[..., None]
        way = apart / np.maximum(length, TINY) if along is None else along[..., part, :, :]
        depth = radius + margin - _dot(apart, way)[..., None]
        places = places + np.where(length < radius + margin, depth, 0.0) * way
    return places


def _from_axis(places: Array, axis: Array) -> Array:
    """Return the vectors (..., n, 3) from the nearest point of a segment (..., 2, 3) to each place (..., n, 3)."""
    start, along = axis[..., None, 0, :], axis[..., None, 1, :] - axis[..., None, 0, :]
    apart = places - start
    share = np.clip(_dot(apart, along) / np.maximum(_dot(along, along), TINY), 0.0, 1.0)
    return np.asarray(apart - share[..., None] * along)


def _dot(one: Array, other: Array) -> Array:
    """Return scalar products (...): far faster than a sum over an axis of three."""
    return np.asarray(np.einsum("...i,...i->...", one, other))


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(_dot(vectors, vectors)))
