"""Rigid motions of a shell, and those of them that the supports leave free."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.posed.shell import Shell
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS
from shellbench.problems.shell.question.directions import held_directions
from shellbench.problems.shell.question.places import Edge, Place, Point
from shellbench.problems.shell.question.surface import Surface

Array = NDArray[np.float64]

SAMPLES_A_SIDE = 9  # of the grid that gives the middle and the size of a surface
EDGE_SAMPLES = 17  # points on an edge at which its supports are applied to the rigid motions
RANK_TOLERANCE = 1e-9  # singular values below this, relative to the largest, are zero


def rigid_modes(surface: Surface, points: ArrayLike, order: int = 0) -> dict[tuple[int, int], Array]:
    """Return the six infinitesimal rigid motions and their derivatives.

    Rotations are about the middle of the surface and divided by its size, so that all six have like magnitude.

    Parameters
    ----------
    surface
        The midsurface.
    points
        (..., 2) curvilinear coordinates.
    order
        Highest order of derivatives.

    Returns
    -------
    dict
        (i, j) -> (..., 3, 6), in the order of `RIGID_MOTIONS`.
    """
    centre, size = middle_and_size(surface)
    modes = {}
    for key, x in surface.derivatives(points, order).items():
        arm = (x - centre if key == (0, 0) else x) / size
        modes[key] = motions_of(arm, key == (0, 0))
    return modes


def middle_and_size(surface: Surface) -> tuple[Array, float]:
    """Return the middle (3,) of a surface, and the largest distance from it, m."""
    sample = surface.position(surface.domain.grid(SAMPLES_A_SIDE, SAMPLES_A_SIDE)).reshape(-1, 3)
    centre = (sample.max(axis=0) + sample.min(axis=0)) / 2
    return centre, float(np.linalg.norm(sample - centre, axis=1).max())


def motions_of(arms: Array, translated: bool) -> Array:
    """Return the rigid motions (..., 3, 6) of points to which arms (..., 3) lead from the middle, in units of the size.

    The motions are linear in the arms. Therefore derivatives of the arms give the same derivatives of the motions, in
    which translations count only if `translated`.
    """
    modes = np.zeros((*arms.shape, len(RIGID_MOTIONS)))
    if translated:
        modes[..., :3] = np.eye(3)
    for k in range(3):  # the rotation about e_k moves by e_k x arm
        i, j = (k + 1) % 3, (k + 2) % 3
        modes[..., j, 3 + k] = arms[..., i]
        modes[..., i, 3 + k] = -arms[..., j]
    return modes


def free_motions(case: Shell) -> Array:
    """Return an orthonormal basis (6, n) of the rigid motions that no support, and at rest no spring, resists."""
    return free_of(rows for _, rows in held_rows(case))


def held_rows(case: Shell) -> Iterator[tuple[Place | None, Array]]:
    """Yield the places that supports hold, and the displacements there of rigid motions in held directions (n, 6).

    Springs of a shell at rest come last, with no place.
    """
    for support, place in case.supported_places():
        if isinstance(place, Edge):
            points = place.samples(case.surface.domain, EDGE_SAMPLES)
        elif isinstance(place, Point):
            points = np.asarray([place.xi])
        else:
            points = case.surface.domain.grid(SAMPLES_A_SIDE, SAMPLES_A_SIDE).reshape(-1, 2)
        modes = rigid_modes(case.surface, points)
        yield place, (held_directions(case.surface, support, place, points) @ modes[0, 0]).reshape(-1, 6)
        if support.holds_slope and isinstance(place, Edge):
            x = case.surface.derivatives(points, order=1)
            tangent = (x[0, 1], x[1, 0])[place.axis]
            normal = np.cross(x[1, 0], x[0, 1])
            normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
            # the rotation about the edge's tangent, which a held slope prevents
            tilt = np.cross(tangent, normal) / np.linalg.norm(tangent, axis=-1, keepdims=True)
            spin = np.stack([np.cross(axis, tilt) for axis in np.eye(3)], axis=-1)
            yield place, np.concatenate([np.zeros((len(points), 3)), np.einsum("pi,pik->pk", normal, spin)], axis=1)
    if case.springs and case.dynamics is None:
        points = case.surface.domain.grid(SAMPLES_A_SIDE, SAMPLES_A_SIDE).reshape(-1, 2)
        stiffness = case.spring_stiffness(points)
        share = np.sqrt(stiffness / max(float(stiffness.max()), np.finfo(float).tiny))
        yield None, (share[..., None] * rigid_modes(case.surface, points)[0, 0]).reshape(-1, 6)


def free_of(rows: Iterable[Array]) -> Array:
    """Return an orthonormal basis (6, n) of the rigid motions to which rows (n, 6) are orthogonal."""
    matrix = np.concatenate([np.zeros((6, 6)), *rows])
    _, values, basis = np.linalg.svd(matrix, full_matrices=False)  # of six rows at least, so that its basis is whole
    held = np.count_nonzero(values > RANK_TOLERANCE * max(1.0, values.max()))
    return basis[held:].T


def check_held(case: Shell) -> None:
    """Check that supports and removed rigid motions together hold the shell.

    Raises
    ------
    ValueError
        If a rigid motion is left free, or a removed one is already held by supports.
    """
    free = free_motions(case)
    removed = np.eye(6)[:, [RIGID_MOTIONS.index(name) for name in case.remove_rigid_motions]]
    for name, motion in zip(case.remove_rigid_motions, removed.T, strict=True):
        if np.linalg.norm(free.T @ motion) < 1e-6:
            raise ValueError(f"remove_rigid_motions names {name}, which the supports already hold")
    loose = free - removed @ (removed.T @ free)
    if free.size and np.linalg.norm(loose) > 1e-6:
        strongest = RIGID_MOTIONS[int(np.argmax(np.linalg.norm(loose, axis=1)))]
        raise ValueError(
            f"the problem is singular: nothing holds the shell against {strongest};"
            " add a support, or name the motion in remove_rigid_motions if the loads are in balance"
        )
