"""Prismatic shells of strips and arcs by `linear_splines`: a patch of splines each.

Each patch has its own splines along the frame (e_x, t, n), xi1 = s and xi2 = x, and strains by products of vectors. Patches meet
where one ends and the next begins. There the displacement vector and the rotation w_s + k v about e_x, k the curvature, are
the same for each spline of x, which all patches share: linear equations of coefficients, whose null space is kept. Forces and
moments of the fold are natural.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sparse
from scipy.linalg import null_space
from scipy.sparse.linalg import splu

from .folded_ritz import Wall
from .linear_splines import Field, LinearShell
from .spline_shell import Ends, Splines
from .surface_strains import Array


def _turned(wall: Wall, s: Array, order: int) -> Array:
    """Derivative (points, 2) by s of t along y and z: each turns it by a right angle, times the curvature."""
    phi = wall.direction + wall.curvature * s + order * np.pi / 2
    return wall.curvature**order * np.stack([np.cos(phi), np.sin(phi)], axis=-1)


def _surface(wall: Wall, start: Array) -> Callable[[Array, Array, int, int], Array]:
    """Derivatives of the position of a wall that begins at `start`."""

    def derivative(s: Array, x: Array, i: int, j: int) -> Array:
        found = np.zeros((len(s), 3))
        if j == 0:
            found[:, 1:] = _turned(wall, s, i - 1) if i else start + _along(wall, s)
        if (i, j) == (0, 0):
            found[:, 0] = x
        if (i, j) == (0, 1):
            found[:, 0] = 1.0
        return found

    return derivative


def _along(wall: Wall, s: Array) -> Array:
    """Position (points, 2) relative to the wall's start."""
    if wall.curvature == 0:
        return np.asarray(s)[:, None] * wall.frame(0.0)[0]
    turn = wall.direction + wall.curvature * np.asarray(s)
    return (
        np.stack([np.sin(turn) - np.sin(wall.direction), np.cos(wall.direction) - np.cos(turn)], axis=-1)
        / wall.curvature
    )


def _carried(moved: Callable[[Array, Array, int], Array], surface: Field, s: Array, x: Array, i: int, j: int) -> Array:
    """Derivative (points, 3) of a displacement that is linear in the place."""
    return moved(surface(s, x, i, 0)[:, 1:], x, j)


def _frame(wall: Wall) -> Callable[[Array, Array, int, int], Array]:
    def derivative(s: Array, x: Array, i: int, j: int) -> Array:
        found = np.zeros((len(s), 3, 3))
        if j == 0:
            found[:, 0, 0] = 1.0 if i == 0 else 0.0
            found[:, 1, 1:] = _turned(wall, s, i)
            turned = Wall(wall.start, wall.end, wall.direction + np.pi / 2, wall.width, wall.curvature)
            found[:, 2, 1:] = _turned(turned, s, i)
        return found

    return derivative


@dataclass(frozen=True)
class Chain:
    """Walls one after the other, what the first and the last end of s and both ends of x hold of (u, v, w), and material."""

    walls: tuple[Wall, ...]
    breaks: tuple[Array, ...]
    """Breaks of s on each wall."""
    lengthwise: Array
    degree: int
    ends: tuple[Sequence[str], Sequence[str]]
    along: Sequence[Ends]
    material: tuple[float, float, float]
    """Young's modulus, Poisson's ratio and thickness."""
    start: tuple[float, float] = (0.0, 0.0)
    """Where the first wall begins."""
    moved: Callable[[Array, Array, int], Array] | None = None
    """Derivative by x of a displacement (points, 3) that splines are added to, linear in the place (points, 2)."""

    @cached_property
    def patches(self) -> list[LinearShell]:
        """A patch for each wall."""
        found, start = [], np.array(self.start)
        splines = Splines(self.lengthwise, self.degree)
        for number, (wall, breaks) in enumerate(zip(self.walls, self.breaks, strict=True)):
            first = self.ends[0] if number == 0 else ("free",) * 3
            last = self.ends[1] if number == len(self.walls) - 1 else ("free",) * 3
            ends = [((a, b), c) for a, b, c in zip(first, last, self.along, strict=True)]
            pair = Splines(breaks, self.degree), splines
            surface = _surface(wall, start)
            moved = self.moved and partial(_carried, self.moved, surface)
            found.append(LinearShell(surface, _frame(wall), pair, ends, *self.material, moved=moved))
            start = start + _along(wall, np.array([wall.width]))[0]
        return found

    @cached_property
    def offsets(self) -> Array:
        """Number of the first free coefficient of each patch, and of all."""
        return np.concatenate([[0], np.cumsum([patch.reduction.shape[1] for patch in self.patches])])

    def row(self, patch: int, local: Array) -> Array:
        """Row over the free coefficients of all patches from one over all coefficients of a patch."""
        found = np.zeros(self.offsets[-1])
        found[self.offsets[patch] : self.offsets[patch + 1]] = self.patches[patch].reduction.T @ local
        return found

    def place(self, patch: int, component: int, s: float, x: float, orders: tuple[int, int] = (0, 0)) -> Array:
        """Row of u, v or w, or of a derivative, at a point."""
        first, second = self.patches[patch].splines
        part = np.kron(first.matrix(np.array([s]), orders[0])[0], second.matrix(np.array([x]), orders[1])[0])
        local = np.zeros((3, part.size))
        local[component] = part
        return self.row(patch, local.ravel())

    @cached_property
    def joints(self) -> sparse.csr_array:
        """Equations of the joints: displacement along e_x and along t and n of the first patch, and rotation."""
        rows = []
        for number in range(len(self.walls) - 1):
            sides = ((number, self.walls[number].width), (number + 1, 0.0))
            axes = self.walls[number].frame(self.walls[number].width)
            parts = []
            for patch, s in sides:
                spline, wall = self.patches[patch].splines[0], self.walls[patch]
                value, slope = (spline.matrix(np.array([s]), order)[0] for order in (0, 1))
                turned = axes @ wall.frame(s).T  # components of this wall's t and n along the axes
                zero = np.zeros_like(value)
                parts.append(
                    [
                        [value, zero, zero],
                        [zero, turned[0, 0] * value, turned[0, 1] * value],
                        [zero, turned[1, 0] * value, turned[1, 1] * value],
                        [zero, wall.curvature * value, slope],
                    ]
                )
            for first, second in zip(*parts, strict=True):
                blocks = []
                for patch in range(len(self.walls)):
                    if patch not in (number, number + 1):
                        blocks.append(sparse.csr_array((self._width, self.patches[patch].reduction.shape[1])))
                        continue
                    equation, sign = (first, 1.0) if patch == number else (second, -1.0)
                    whole = sparse.kron(sign * np.concatenate(equation)[None], sparse.eye_array(self._width))
                    blocks.append(sparse.csr_array(whole @ self.patches[patch].reduction))
                rows.append(sparse.hstack(blocks))
        found = sparse.csr_array(sparse.vstack(rows))
        found.data[np.abs(found.data) < 1e-13] = 0.0
        found.eliminate_zeros()
        return found

    @cached_property
    def joined(self) -> sparse.csr_array:
        """Matrix from independent coefficients to the free ones that meet the equations of the joints.

        Coefficients away from joints are kept as they are; the others are an orthonormal basis of the null space.
        """
        beside = np.unique(self.joints.indices)
        apart = np.setdiff1d(np.arange(self.offsets[-1]), beside)
        basis = null_space(self.joints[:, beside].toarray(), rcond=1e-10)
        order = sparse.eye_array(self.offsets[-1], format="csr")
        found = sparse.hstack([order[:, apart], order[:, beside] @ sparse.csr_array(basis)])
        return sparse.csr_array(found)

    @property
    def _width(self) -> int:
        return self.patches[0].splines[1].count

    def solve(self, load: Array) -> tuple[Array, float, float]:
        """Coefficients under a load on the free ones, and the energies of stretching and of bending, J."""
        systems = [patch.system for patch in self.patches]
        membrane, bending = (
            sparse.csr_array(sparse.block_diag([getattr(system, part) for system in systems]))
            for part in ("membrane", "bending")
        )
        whole = self.joined.T @ (membrane + bending) @ self.joined
        scale = sparse.diags_array(1 / np.sqrt(whole.diagonal()))
        pulled = np.concatenate([system.pulled for system in systems], axis=1)
        stored = np.sum([system.stored for system in systems], axis=0)
        matrix, right = (scale @ whole @ scale).tocsc(), scale @ (self.joined.T @ (load - pulled.sum(axis=0)))
        factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        found = factor.solve(right)
        found += factor.solve(right - matrix @ found)
        free = self.joined @ (scale @ found)
        parts = zip((membrane, bending), pulled, stored, strict=True)
        stretched, bent = (float(free @ (k @ free) / 2 + p @ free + e) for k, p, e in parts)
        return free, stretched, bent
