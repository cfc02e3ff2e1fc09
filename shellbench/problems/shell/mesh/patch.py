"""One patch of a mesh: its texture coordinates tile a rectangle once, and each of its points has one position.

The checks are, in this order: a texture vertex with two positions, triangles that fold over in (u, v), edges between
more than two triangles, a boundary that is not the rectangle's (a hole, a ragged edge, a seam inside), and sides that
meet in space. Triangles of one orientation within the rectangle's boundary tile it once if their areas sum to its area.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.mesh.file import ON_A_SIDE, MeshFile

Array = NDArray[np.float64]
SLIVER = 1e-9  # of the mean area: a triangle as small as this, in (u, v), has none
MEET = 1e-6  # of the mesh's size: sides that are nearer to each other meet in space
COORDINATES = ("xi1", "xi2")


@dataclass(frozen=True)
class Patch:
    """Points of a surface over a rectangle.

    Attributes
    ----------
    xi, positions
        (n, 2) and (n, 3) of the vertices. A closed patch has the vertices of its seam twice.
    lower, upper
        Bounds of the rectangle.
    counts
        Vertices along each coordinate, on the sides.
    triangles
        (t, 3) indices of vertices, counterclockwise in (u, v).
    inner
        (n,) whether a vertex is off the boundary.
    """

    xi: Array
    positions: Array
    lower: tuple[float, float]
    upper: tuple[float, float]
    counts: tuple[int, int]
    triangles: NDArray[np.int64]
    inner: NDArray[np.bool_]

    @property
    def size(self) -> float:
        """Diagonal of the box around it, m."""
        return float(np.linalg.norm(np.ptp(self.positions, axis=0)))


def patch_of(mesh: MeshFile, periodic: Sequence[str] | None) -> Patch:
    """Check a mesh and return its patch.

    Parameters
    ----------
    periodic
        Coordinates in which it is stated to close; None if nothing is stated, and then it must not close.

    Raises
    ------
    InputError
        As a clause: the property that the mesh lacks, and where.
    """
    used, corners = np.unique(mesh.corners, return_inverse=True)
    corners = corners.reshape(-1, 3)
    xi, owner = mesh.texture[used].copy(), _owners(mesh, corners, len(used))
    lower, upper = xi.min(axis=0), xi.max(axis=0)
    side = upper - lower
    if not np.all(side > 0):
        raise InputError("its texture coordinates fill no rectangle: all have the same u or v")
    for bound in (lower, upper):  # texture coordinates of six digits
        xi = np.where(np.abs(xi - bound) <= ON_A_SIDE * side, bound, xi)
    _check_orientation(xi, corners, float(np.prod(side)))
    edges = _boundary(corners, xi)
    on = np.stack([xi == lower, xi == upper])  # (2 ends, n, 2)
    along = np.any(on[:, edges[:, 0]] & on[:, edges[:, 1]], axis=(0, 2))
    if not np.all(along):
        at = xi[edges[int(np.argmin(along))]].mean(axis=0)
        doubled = len(np.unique(np.round((xi - lower) / side / ON_A_SIDE), axis=0)) < len(xi)
        raise InputError(
            f"its boundary leaves the sides of the rectangle of (u, v), near ({at[0]:.4g}, {at[1]:.4g}): "
            + ("vertices are there twice, at a seam inside it" if doubled else "a hole, or a ragged edge")
        )
    area = _doubled_areas(xi, corners).sum() / 2
    if abs(area / np.prod(side) - 1) > ON_A_SIDE:
        raise InputError(f"its triangles cover the rectangle of (u, v) {area / np.prod(side):.4g} times, not once")
    positions = mesh.positions[owner]
    patch = Patch(
        xi=xi,
        positions=positions,
        lower=(float(lower[0]), float(lower[1])),
        upper=(float(upper[0]), float(upper[1])),
        counts=(_number(on[:, :, 1]), _number(on[:, :, 0])),
        triangles=corners,
        inner=~np.any(on, axis=(0, 2)),
    )
    _check_closure(patch, periodic)
    return patch


def _number(sides: NDArray[np.bool_]) -> int:
    """Return the smaller number of vertices on two opposite sides (2, n)."""
    return int(sides.sum(axis=1).min())


def _owners(mesh: MeshFile, corners: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Return the index of the position of each texture vertex."""
    owner = np.full(count, -1, dtype=np.int64)
    owner[corners.ravel()] = mesh.triangles.ravel()
    twice = owner[corners] != mesh.triangles
    if np.any(twice):
        u, v = mesh.texture[mesh.corners[twice][0]]
        raise InputError(f"texture vertex {mesh.corners[twice][0] + 1} at ({u:.4g}, {v:.4g}) has two positions")
    return owner


def _doubled_areas(xi: Array, corners: NDArray[np.int64]) -> Array:
    first, second, third = (xi[corners[:, k]] for k in range(3))
    a, b = second - first, third - first
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _check_orientation(xi: Array, corners: NDArray[np.int64], rectangle: float) -> None:
    doubled = _doubled_areas(xi, corners)
    least = SLIVER * rectangle / len(corners)
    if np.all(doubled < -least):
        raise InputError(
            "all its triangles wind clockwise in (u, v), so that its normals are opposed to the shell's, a1 x a2:"
            " reverse the faces, or exchange u and v"
        )
    if np.any(doubled <= least):
        wrong = doubled <= least
        at = xi[corners[np.argmax(wrong)]].mean(axis=0)
        raise InputError(
            f"{int(wrong.sum())} of {len(corners)} triangles are flipped or have no area in (u, v), the first near"
            f" ({at[0]:.4g}, {at[1]:.4g})"
        )


def _boundary(corners: NDArray[np.int64], xi: Array) -> NDArray[np.int64]:
    """Return the edges (m, 2) that one triangle has alone."""
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    ordered = np.sort(edges, axis=1)
    _, first, count = np.unique(ordered[:, 0] * len(xi) + ordered[:, 1], return_index=True, return_counts=True)
    if count.max() > 2:
        at = xi[edges[first[np.argmax(count)]]].mean(axis=0)
        raise InputError(f"an edge near ({at[0]:.4g}, {at[1]:.4g}) of (u, v) belongs to {count.max()} triangles")
    return np.asarray(edges[first[count == 1]])


def _check_closure(patch: Patch, periodic: Sequence[str] | None) -> None:
    for axis, name in enumerate(COORDINATES):
        gap = _gap(patch, axis)
        if periodic is None and gap is not None and gap <= MEET * patch.size:
            raise InputError(
                f"its sides {'uv'[axis]} = {patch.lower[axis]:g} and {patch.upper[axis]:g} meet in space: say"
                f' periodic = ["{name}"] if it closes there, and periodic = [] if it is slit'
            )
        if periodic is not None and name in periodic and (gap is None or gap > MEET * patch.size):
            far = "have other vertices" if gap is None else f"are {gap:.3g} apart"
            raise InputError(f"it is said to be periodic in {name}, but its sides across {'uv'[axis]} {far}")


def _gap(patch: Patch, axis: int) -> float | None:
    """Return the largest distance between two opposite sides in space; None if their vertices do not match."""
    ends = []
    for bound in (patch.lower[axis], patch.upper[axis]):
        (there,) = np.nonzero(patch.xi[:, axis] == bound)
        ends.append(there[np.argsort(patch.xi[there, 1 - axis])])
    first, last = ends
    other = 1 - axis
    slack = ON_A_SIDE * (patch.upper[other] - patch.lower[other])
    if len(first) != len(last) or np.abs(patch.xi[first, other] - patch.xi[last, other]).max() > slack:
        return None
    return float(np.linalg.norm(patch.positions[first] - patch.positions[last], axis=1).max())
