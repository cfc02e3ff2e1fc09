"""Position update, section 5 of the paper: each node moves freely, or turns about the node before it; root to tip."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.solvers.rope.pulls import dot

Array = NDArray[np.float64]
Placing = Literal["rotation", "projection"]
TINY = 1e-300  # keeps directions of nodes at rest finite


def unit(vectors: Array) -> Array:
    """Return vectors (..., 3) at length one."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), TINY))


def move_nodes(places: Array, velocities: Array, before: Array, lengths: Array, step: float, placing: Placing) -> Array:
    """Return the places of nodes (C, 3) after a step, given the new places of the nodes before them: eqs. (10) to (13).

    A node whose free path stays within its link's length follows that path. Another node follows it until it leaves the
    sphere for the last time, or is put on the sphere if it is outside all along. The rest of its path is an arc of the
    great circle.
    """
    offset = places - before
    free = offset + step * velocities
    over = dot(free, free) > lengths**2
    if not over.any():
        return np.asarray(before + free)
    if placing == "projection":
        return np.asarray(before + np.where(over[:, None], lengths[:, None] * unit(free), free))
    square, half = dot(velocities, velocities), dot(offset, velocities)
    excess = dot(offset, offset) - lengths**2
    discriminant = half**2 - square * excess
    with np.errstate(all="ignore"):
        root = (-half + np.sqrt(np.maximum(discriminant, 0.0))) / square
    leaves = (discriminant >= 0) & (root >= 0) & (root <= step)
    root = np.where(leaves, root, 0.0)
    out = unit(np.where(leaves[:, None], offset + root[:, None] * velocities, offset))
    across = velocities - dot(velocities, out)[:, None] * out
    angle = np.linalg.norm(across, axis=-1) * (step - root) / lengths
    turned = np.cos(angle)[:, None] * out + np.sin(angle)[:, None] * unit(across)
    return np.asarray(before + np.where(over[:, None], lengths[:, None] * turned, free))
