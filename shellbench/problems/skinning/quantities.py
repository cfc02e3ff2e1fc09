"""Quantities of skinned meshes: their distance from the simulation, and the part of them that is in the body.

A solution has `meshes` and `bones`, of the held-out frames, and `fitted`, of the training frames.
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


class FineError(Quantity):
    """The part of `error` that is finer than the bones, m: what no bilinear interpolation between bones could be.

    Its square and that of `coarse_error` add up to that of `error`.
    """

    is_an_error = True

    kind: Literal["fine_error", "coarse_error"]

    def measure(self, solution: Any) -> float:
        """Return the root mean square of its projection, m."""
        case = solution.case
        apart = solution.meshes - solution.clips.meshes[case.held_out]
        down, across = (np.linalg.qr(hats)[0] for hats in bone_hats(case))
        coarse = np.einsum("ri,si,ck,dk,nsdx->nrcx", down, down, across, across, apart, optimize=True)
        found = coarse if self.kind == "coarse_error" else apart - coarse
        return float(np.sqrt((found**2).sum(-1).mean()))


def bone_hats(case: Any) -> tuple[Array, Array]:
    """Return weights (rows, nodes) and (columns, chains), piecewise linear between the bones."""
    rows, columns = case.grid
    around = case.cape.columns if case.cape.closed else None
    return hat_weights(rows, case.cape.rows), hat_weights(columns, case.cape.columns, around)


def hat_weights(nodes: Any, count: int, period: int | None = None) -> Array:
    """Return piecewise linear weights (count, nodes)."""
    return np.stack([np.interp(np.arange(count), nodes, unit, period=period) for unit in np.eye(len(nodes))], axis=1)


class EdgeStrain(Quantity):
    """Length of edges along rows and columns over that in the pattern, less one.

    `edge_strain` is the root mean square over edges and frames, `edge_stretch` the largest, `edge_shrink` the
    smallest with its sign changed.
    """

    is_an_error = True

    kind: Literal["edge_strain", "edge_stretch", "edge_shrink"]
    unit: str = ""

    def measure(self, solution: Any) -> float:
        """Return the strain, without unit."""
        cape = solution.case.cape
        pairs = zip(edge_lengths(cape, solution.meshes), edge_lengths(cape, cape.rest()), strict=True)
        found = np.concatenate([(now / rest - 1).ravel() for now, rest in pairs])
        if self.kind == "edge_strain":
            return float(np.sqrt((found**2).mean()))
        return float(found.max() if self.kind == "edge_stretch" else -found.min())


def edge_lengths(cape: Any, places: Array) -> tuple[Array, Array]:
    """Return the lengths, m, of the edges down and around of meshes (..., rows, columns, 3)."""
    around = np.concatenate([places, places[..., :1, :]], axis=-2) if cape.closed else places
    return np.linalg.norm(np.diff(places, axis=-3), axis=-1), np.linalg.norm(np.diff(around, axis=-2), axis=-1)


class BoneDistance(Quantity):
    """Distance of the mesh's vertices that are bones from the bones that the solver used, root mean square, m."""

    is_an_error = True

    kind: Literal["bone_distance"]

    def measure(self, solution: Any) -> float:
        """Return the distance, m."""
        rows, columns = solution.case.grid
        apart = solution.meshes[:, rows[:, None], columns] - solution.bones
        return float(np.sqrt((apart**2).sum(-1).mean()))


class BoneError(Quantity):
    """Distance of the bones that the solver used from those of the simulated mesh, root mean square, m."""

    is_an_error = True

    kind: Literal["bone_error"]

    def measure(self, solution: Any) -> float:
        """Return the distance, m."""
        rows, columns = solution.case.grid
        apart = solution.clips.meshes[solution.case.held_out][:, rows[:, None], columns] - solution.bones
        return float(np.sqrt((apart**2).sum(-1).mean()))


class Jitter(Quantity):
    """Change of the frame-to-frame step, |x_{n+1} - 2 x_n + x_{n-1}|, root mean square, m, in the frame of the neck.

    `jitter` is of all vertices, `bone_jitter` of the bones that the solver used.
    """

    is_an_error = True

    kind: Literal["jitter", "bone_jitter"]

    def measure(self, solution: Any) -> float:
        """Return the change, m."""
        places = solution.meshes if self.kind == "jitter" else solution.bones
        clips = places.reshape(-1, solution.case.cape.frames, *places.shape[1:])
        return float(np.sqrt((np.diff(clips, n=2, axis=1) ** 2).sum(-1).mean()))


SkinningQuantity = Annotated[
    SkinError | PenetrationShare | PenetrationDepth | FineError | EdgeStrain | BoneDistance | BoneError | Jitter,
    Field(discriminator="kind"),
]
