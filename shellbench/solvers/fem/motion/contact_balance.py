"""Contact forces at points of a shell, from a compliance: no point enters an obstacle or sticks beyond Coulomb's limit.

A guess of the points that are apart, slip and stick turns all conditions into equations. Points whose answer
contradicts the guess change, until none does.

Júdice & Pires (1994), A block principal pivoting algorithm for large-scale strictly monotone linear complementarity
problems, Computers & Operations Research 21.
Alart & Curnier (1991), A mixed formulation for frictional contact problems prone to Newton like solution methods,
Computer Methods in Applied Mechanics and Engineering 92.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from shellbench.solvers.fem.mesh.basis import COMPONENTS, ROUNDING
from shellbench.solvers.stepping.control import NotConvergedError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Of the largest compliance of a point: a point with less is held by supports, and its compliance is rounding.
HELD = 1e-9
# Change of the direction of friction, rad, that ends rounds.
TURNED = 1e-6
MOST_ROUNDS = 100  # of the sets of points in contact
PATIENCE = 10  # rounds without fewer wrong points, after which one point a round changes
APART, SLIPS, STICKS = 0, 1, 2


@dataclass
class Delassus:
    """A compliance of w points in local axes, and the last factorised part of it.

    Attributes
    ----------
    axes
        (w, d, 3) the normal and, with friction, two directions along the obstacle.
    matrix
        (w, d, w, d) m/N.
    """

    axes: Array
    matrix: Array
    _factored: tuple[bytes, Array, Array] | None = None

    @classmethod
    def from_compliance(cls, compliance: Array, normal: Array, rough: bool) -> Delassus:
        """Turn a compliance (w, 3, w, 3) into axes of normals (w, 3)."""
        axes = normal[:, None]
        if rough:
            first = np.cross(normal, np.eye(COMPONENTS)[np.argmin(np.abs(normal), axis=-1)])
            first /= np.linalg.norm(first, axis=-1, keepdims=True)
            axes = np.stack([normal, first, np.cross(normal, first)], axis=1)
        shape = axes.shape[:2]
        half = (axes @ compliance.reshape(len(axes), COMPONENTS, -1)).reshape(-1, len(axes), COMPONENTS)
        whole = half.transpose(1, 0, 2) @ axes.transpose(0, 2, 1)
        return cls(axes, np.ascontiguousarray(whole.transpose(1, 0, 2)).reshape(*shape, *shape))

    def forces(self, pressed: Integers, stuck: Integers, rubbed: Array, known: Array) -> Array:
        """Return forces (w, d), N, that cancel known displacements (w, d), m: gaps, and slips of points that stick.

        `rubbed` (w, d - 1) is the friction of points that slip, in their pressure.
        """
        count = self.axes.shape[1]
        chosen = np.concatenate([count * pressed, count * stuck + 1, count * stuck + 2] if count > 1 else [pressed])
        key, slips = chosen.tobytes(), bool(np.any(rubbed))
        factored = None if slips else self._factored
        if factored is None or factored[0] != key:
            flat = self.matrix.reshape(known.size, known.size)
            matrix = flat[chosen[:, None], chosen]
            for axis in range(1, count) if slips else ():
                matrix[:, : len(pressed)] += flat[chosen[:, None], count * pressed + axis] * rubbed[pressed, axis - 1]
            factor, pivots, failed = lapack.dgetrf(matrix, overwrite_a=True)
            if failed:
                raise NotConvergedError
            factored = key, factor, pivots
        if not slips:  # sets that stick or lie on a plane recur; directions of slip change
            self._factored = factored
        sizes = np.zeros(known.size)
        sizes[chosen] = lapack.dgetrs(*factored[1:], -known.ravel()[chosen])[0]
        forces = sizes.reshape(known.shape)
        forces[:, 1:] += forces[:, :1] * rubbed
        return forces


@dataclass(frozen=True)
class Balance:
    """Forces at w points, none of which enters an obstacle or sticks beyond Coulomb's limit.

    Attributes
    ----------
    compliance
        (w, 3, w, 3) of the step's end, m/N.
    normal, friction
        (w, 3) and (w,).
    gap, slip
        (w,) and (w, 3) without forces, m; only the part of the slip along the obstacle counts.
    least
        Gap that is rounding, m.
    kept
        `local_compliance` of an earlier one with this compliance, and these normals.
    """

    compliance: Array
    normal: Array
    friction: Array
    gap: Array
    slip: Array
    least: float
    kept: Delassus | None = None

    @cached_property
    def local_compliance(self) -> Delassus:
        """The compliance along normals and, with friction, across them."""
        return self.kept or Delassus.from_compliance(self.compliance, self.normal, bool(np.any(self.friction > 0)))

    def forces(self, before: Array) -> Array:
        """Return the forces (w, 3), N; NotConvergedError if none are found. `before` (w, 3) are a first guess."""
        # 1. Guess the points that are apart, slip and stick: all conditions become equations.
        # 2. Change the points whose answer contradicts the guess (block principal pivoting), one at a time if this does
        #    not reduce their number.
        own = np.einsum("iaia->i", self.compliance)
        able = own > HELD * own.max()  # points that supports hold feel no obstacle
        rough = self.friction > 0
        status = np.where(np.any(before != 0, axis=-1) & able, np.where(rough, STICKS, SLIPS), APART)
        heading = np.zeros_like(self.normal)
        fewest, lives = len(status) + 1, PATIENCE
        for _ in range(MOST_ROUNDS):
            found = self._forces_by_status(status, heading)
            moved = (self.compliance.reshape(found.size, -1) @ found.ravel()).reshape(found.shape)
            pressure = np.sum(self.normal * found, axis=-1)
            # Alart & Curnier: the force less the one that would cancel the slip decides between sticking and slipping
            tried = self._tangential_parts(found - (self.slip + moved) / np.where(able, own, np.inf)[:, None])
            sizes, bound = np.linalg.norm(tried, axis=-1), self.friction * pressure * (1 + ROUNDING)
            pressed = np.where(
                status == APART, self.gap + np.sum(self.normal * moved, axis=-1) < -self.least, pressure >= 0
            )
            after = np.where(pressed & able, np.where(rough & (sizes <= bound), STICKS, SLIPS), APART)
            after[(status == APART) & (after == SLIPS) & rough] = STICKS
            wrong = np.flatnonzero(after != status)
            turns = rough & (after == SLIPS)
            against = tried / np.where(sizes > 0, sizes, 1.0)[:, None]
            turned = np.linalg.norm(against - heading, axis=-1)[turns].max(initial=0.0)
            if not len(wrong) and turned <= TURNED:
                return found
            heading = np.where(turns[:, None], against, heading)
            if len(wrong) < fewest:
                fewest, lives = len(wrong), PATIENCE
            elif len(wrong) and (lives := lives - 1) <= 0:
                wrong = wrong[-1:]
            status[wrong] = after[wrong]
        raise NotConvergedError

    def _tangential_parts(self, vectors: Array) -> Array:
        """Return the parts of vectors (w, 3) along obstacles."""
        return np.asarray(vectors - np.sum(vectors * self.normal, axis=-1, keepdims=True) * self.normal)

    def _forces_by_status(self, status: Integers, heading: Array) -> Array:
        """Return the forces (w, 3) that close all gaps in contact and hold the sticking points."""
        # Unknowns are pressures and, of points that stick, two forces along the obstacle. Friction of points that slip
        # goes with their pressure: it is no unknown, and the matrix has no symmetry.
        pressed, stuck = np.flatnonzero(status != APART), np.flatnonzero(status == STICKS)
        if not len(pressed):
            return np.zeros_like(self.normal)
        axes = self.local_compliance.axes
        rubbed = np.where(status == SLIPS, self.friction, 0.0)[:, None, None] * (axes[:, 1:] @ heading[..., None])
        known = np.zeros(axes.shape[:2])
        known[:, 0], known[:, 1:] = self.gap, (axes[:, 1:] @ self.slip[..., None])[..., 0]
        forces = self.local_compliance.forces(pressed, stuck, rubbed[..., 0], known)
        return np.asarray((forces[:, None] @ axes)[:, 0])
