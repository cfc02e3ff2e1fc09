"""Skinning without training: bilinear interpolation, rigid bones with fitted weights, ridge regression, PCA.

All methods use a frame's bones, places of some vertices in the frame of the neck; the floor uses the whole mesh.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.skinning.case import SkinningCase
from shellbench.problems.skinning.data import Clips
from shellbench.problems.skinning.quantities import bone_hats
from shellbench.solvers.skinning.driven import bone_grid, bone_places
from shellbench.solvers.skinning.solution import Arrays

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
TINY = 1e-300  # keeps directions finite
NOTHING = 1e-12  # relative: singular values below are rounding, and no modes
PENALTIES = tuple(10.0**power for power in range(-10, 3))  # over the mean variance of a bone's coordinate
RIDGED = 1e-9  # of the mean square: it keeps the matrix of a vertex that is a bone from being singular


def bones(case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return the bones' displacements from rest, (n, 3 b), m, of numbered frames."""
    moved = bone_places(case, clips, frames) - bone_grid(case, clips.rest[None])
    return np.asarray(moved.reshape(len(frames), -1))


# PCA: modes of displacement, to which the ridge and all networks map.


def modes_of(moved: Array, count: int) -> dict[str, Array]:
    """Return the mean (3 v,) and at most so many modes (k, 3 v), orthonormal, of displacements (n, 3 v)."""
    mean = moved.mean(axis=0)
    apart = moved - mean
    squares, vectors = np.linalg.eigh(apart @ apart.T)  # there are fewer frames than coordinates
    order = np.argsort(squares)[::-1][:count]
    order = order[squares[order] > NOTHING * max(float(squares.max()), TINY)]
    modes, _ = np.linalg.qr((vectors[:, order].T @ apart).T)
    return {"mean": mean, "modes": np.ascontiguousarray(modes.T)}


def coefficients(basis: Arrays, moved: Array) -> Array:
    """Return the coefficients (n, k) of displacements (n, 3 v), m: of their best approximation by the modes."""
    return np.asarray((moved - basis["mean"]) @ basis["modes"].T)


def from_modes(basis: Arrays, found: Array) -> Array:
    """Return the displacements (n, 3 v), m, of coefficients (n, k)."""
    return np.asarray(basis["mean"] + found @ basis["modes"])


def floor_skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return the best approximation of the simulation itself by the modes."""
    return from_modes(arrays, coefficients(arrays, clips.moved[frames]))


# Ridge regression from bones to coefficients.


def ridge_fit(given: Array, wanted: Array, groups: Numbers, penalty: float | None) -> tuple[dict[str, Array], float]:
    """Return the map from bones (n, 3 b) to coefficients (n, k), and its penalty.

    Parameters
    ----------
    groups
        (n,): to choose the penalty, each group in turn is predicted from the others.
    penalty
        Over the mean variance of a bone's coordinate; None to choose it.
    """
    if penalty is None:
        each = np.unique(groups)
        penalty = PENALTIES[int(np.argmin(sum(_cross_validation(given, wanted, groups == one) for one in each)))]
    mean, centre, (map_,) = _ridge(given, wanted, (penalty,))
    return {"bones": mean, "centre": centre, "map": map_}, penalty


def _cross_validation(given: Array, wanted: Array, out: NDArray[np.bool_]) -> Array:
    """Return the squared errors (p,) of one group by the others, for each penalty."""
    if out.all():
        return np.zeros(len(PENALTIES))
    mean, centre, maps = _ridge(given[~out], wanted[~out], PENALTIES)
    return np.array([(((given[out] - mean) @ one + centre - wanted[out]) ** 2).sum() for one in maps])


def _ridge(given: Array, wanted: Array, penalties: Sequence[float]) -> tuple[Array, Array, list[Array]]:
    mean, centre = given.mean(axis=0), wanted.mean(axis=0)
    left, sizes, right = np.linalg.svd(given - mean, full_matrices=False)
    turned = left.T @ (wanted - centre)
    unit = float((sizes**2).sum()) / given.shape[1]
    keep = sizes > NOTHING * max(float(sizes.max()), TINY)
    shrunk = [np.where(keep, sizes / np.maximum(sizes**2 + one * unit, TINY), 0.0) for one in penalties]
    return mean, centre, [right.T @ (each[:, None] * turned) for each in shrunk]


def ridge_skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return displacements by the ridge."""
    found = (bones(case, clips, frames) - arrays["bones"]) @ arrays["map"] + arrays["centre"]
    return from_modes(arrays, found)


# Bilinear interpolation of the bones' displacements over the mesh.


def bilinear_skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return displacements between four bones, linear in the row and in the column."""
    down, across = bone_hats(case)
    grid = bones(case, clips, frames).reshape(len(frames), down.shape[1], across.shape[1], 3)
    return np.asarray(np.einsum("ri,cj,nijd->nrcd", down, across, grid, optimize=True).reshape(len(frames), -1))


# Linear blend skinning: bones turn with the chain and the chain beside, and each vertex follows some of them.


def bone_frames(grid: Array) -> Array:
    """Return the rotations' matrices (n, nodes, chains, 3, 3) of bones (n, nodes, chains, 3).

    The first axis is along the chain, the second toward the next chain, across the first.
    """
    along, beside = np.gradient(grid, axis=1), np.gradient(grid, axis=2)
    first = _unit(along)
    second = _unit(beside - (beside * first).sum(-1, keepdims=True) * first)
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), TINY))


def bone_followers(case: SkinningCase, clips: Clips, frames: Numbers, near: Numbers, row: int) -> Array:
    """Return the places of each vertex of a row if it followed one of its bones, (n, columns, near, 3), m."""
    rest, now = bone_grid(case, clips.rest[None]), bone_places(case, clips, frames)
    turns = bone_frames(now) @ bone_frames(rest).swapaxes(-1, -2)
    turns, now = turns.reshape(len(frames), -1, 3, 3)[:, near], now.reshape(len(frames), -1, 3)[:, near]
    arms = clips.rest[row][:, None] - rest.reshape(-1, 3)[near]
    return np.asarray(np.einsum("nvbij,vbj->nvbi", turns, arms) + now)


def blend_fit(case: SkinningCase, clips: Clips, count: int) -> dict[str, NDArray[np.float64] | Numbers]:
    """Return for each vertex (rows, columns, near) its nearest bones at rest and their weights.

    Weights are at least 0 and have the sum 1. They minimise the squared distance; as long as one is negative, the
    bone with the most negative is dropped.
    """
    places = bone_grid(case, clips.rest[None]).reshape(-1, 3)
    apart = np.linalg.norm(clips.rest[:, :, None] - places, axis=-1)
    near = np.argsort(apart, axis=-1, kind="stable")[..., :count]
    weights = np.zeros(near.shape)
    for row in range(case.cape.rows):
        errors = bone_followers(case, clips, case.seen, near[row], row) - clips.meshes[case.seen, row][:, :, None]
        grams = np.einsum("nvbi,nvci->vbc", errors, errors, optimize=True)
        for column, gram in enumerate(grams):
            weights[row, column] = convex_weights(gram)
    return {"near": near, "weights": weights}


def convex_weights(gram: Array) -> Array:
    """Return weights (b,) at least 0, of sum 1, that make w.G.w small for a matrix (b, b) of products of errors."""
    kept = np.arange(len(gram))
    while True:
        part = gram[np.ix_(kept, kept)]
        part = part + (RIDGED * float(np.trace(part)) / len(kept) + TINY) * np.eye(len(kept))
        found = np.linalg.solve(part / np.trace(part), np.ones(len(kept)))
        found /= found.sum()
        if found.min() >= 0:
            break
        kept = np.delete(kept, int(found.argmin()))
    weights = np.zeros(len(gram))
    weights[kept] = found
    return weights


def blend_skin(arrays: Arrays, case: SkinningCase, clips: Clips, frames: Numbers) -> Array:
    """Return displacements of vertices that follow their bones."""
    found = np.empty((len(frames), *clips.rest.shape))
    for row in range(case.cape.rows):
        each = bone_followers(case, clips, frames, arrays["near"][row], row)
        found[:, row] = (arrays["weights"][row][:, :, None] * each).sum(axis=2)
    return np.asarray((found - clips.rest).reshape(len(frames), -1))
