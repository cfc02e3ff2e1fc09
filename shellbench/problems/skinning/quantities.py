"""Quantities of skinned meshes: their distance from the simulation, and the part of them that is in the body.

A solution has `meshes`, of the held-out frames, and `fitted`, of the training frames.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from shellbench.problem import Quantity
from shellbench.problems.skinning.body import distance

Array = NDArray[np.float64]


def errors(solution: Any) -> Array:
    """Return the root mean square over the vertices of each frame that is held out, (n,), m."""
    return frame_errors(solution.meshes, solution.clips.meshes[solution.case.held_out])


def frame_errors(meshes: Array, truth: Array) -> Array:
    """Return the root mean square over the vertices of meshes (n, ..., 3), (n,), m."""
    return np.asarray(np.sqrt(((meshes - truth) ** 2).sum(-1).reshape(len(meshes), -1).mean(1)))


def depths(solution: Any) -> Array:
    """Return the depth in the body, m, of each vertex of each held-out frame (n, v); 0 outside.

    The upper row is left out, since the body holds it.
    """
    held, clips = solution.case.held_out, solution.clips
    free = solution.meshes[:, 1:].reshape(len(held), -1, 3)
    return np.maximum(-distance(free, clips.axes[held], clips.radii), 0.0)


class SkinError(Quantity):
    """The distance of vertices from the simulation, over frames that are held out, or that were seen, m.

    `error` and `fitted_error` are root mean squares over all vertices and frames, `worst_error` that of the worst
    frame.
    """

    is_an_error = True

    kind: Literal["error", "worst_error", "fitted_error"]

    def measure(self, solution: Any) -> float:
        """Return the error, m."""
        if self.kind == "fitted_error":
            found = frame_errors(solution.fitted, solution.clips.meshes[solution.case.seen])
        else:
            found = errors(solution)
        return float(found.max() if self.kind == "worst_error" else np.sqrt((found**2).mean()))


class PenetrationShare(Quantity):
    """The share of vertices that are inside the body."""

    is_an_error = True

    kind: Literal["penetration_share"]
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the share, from 0 to 1."""
        return float((depths(solution) > 0).mean())


class PenetrationDepth(Quantity):
    """Depth of vertices in the body, m: the root mean square over all vertices, of which most are outside."""

    is_an_error = True

    kind: Literal["penetration_depth", "deepest"]

    def measure(self, solution: Any) -> float:
        """Return the depth, m; the largest of all as `deepest`."""
        found = depths(solution)
        return float(found.max() if self.kind == "deepest" else np.sqrt((found**2).mean()))


SkinningQuantity = Annotated[SkinError | PenetrationShare | PenetrationDepth, Field(discriminator="kind")]
