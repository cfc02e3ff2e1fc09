"""The elastic energy of a two-dimensional flex, implemented again for energies and strains.

MuJoCo gives forces, and no energy of a flex. Its manual (XML reference, flex/elasticity) describes the model. The tests
compare the derivative of this energy with the engine's own forces.

Stretching: linear triangles of St. Venant and Kirchhoff's material. With E = (F^T F - 1)/2 the energy per reference
area is D/2 ((1 - nu) E:E + nu (tr E)^2), D = E h/(1 - nu^2).

Bending: each interior edge e between triangles of areas A1 and A2 has the energy B/2 |H|^2/(A1 + A2), where
H = |e| (t1 + t2), and t1 and t2 are the unit vectors in the triangles, at right angles to the edge and away from them.
H is a sum of vertices' positions with constant weights, cotangents of angles at rest (Wardetzky, Bergou, Harmon, Zorin
& Grinspun 2007). Where no triangle stretches, |t1 + t2| = 2 sin(theta/2), theta being the angle of the fold. Cells cut
as here tend to a plate with the energy per area B/2 ((k11 + k12)^2 + (k22 + k12)^2 + 4 k12^2), k being the change of
curvature: that of the isotropic plate for k12 = 0 and without Poisson's effect.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.conditions import Material
from shellbench_mujoco.grid import Grid

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Elasticity:
    """Stretching and bending of the triangles of a grid."""

    grid: Grid

    @property
    def material(self) -> Material:
        """The case's material."""
        return self.grid.case.isotropic

    @cached_property
    def frames(self) -> Array:
        """(t, 3, 3) columns: two unit vectors in each triangle at rest, and its normal."""
        a, b, c = np.moveaxis(self.grid.rest[self.grid.triangles], 1, 0)
        along, normal = b - a, np.cross(b - a, c - a)
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return np.stack([along, np.cross(normal, along), normal], axis=-1)

    @cached_property
    def slopes(self) -> Array:
        """(t, 3, 2) gradients of the three linear shape functions in the triangles' frames, 1/m."""
        corners = np.einsum("tai,tik->tak", self.grid.rest[self.grid.triangles], self.frames[..., :2])
        system = np.concatenate([np.ones((*corners.shape[:2], 1)), corners], axis=-1)
        return np.ascontiguousarray(np.swapaxes(np.linalg.inv(system), 1, 2)[..., 1:])

    def deformation(self, positions: Array) -> Array:
        """Return the deformation gradients F (t, 3, 2) of vertices at positions (v, 3)."""
        return np.asarray(np.swapaxes(positions[self.grid.triangles], 1, 2) @ self.slopes)

    def strain(self, positions: Array) -> Array:
        """Return the Green strains (t, 2, 2) in the triangles' frames."""
        f = self.deformation(positions)
        return np.asarray((np.swapaxes(f, 1, 2) @ f - np.eye(2)) / 2)

    def stress(self, strain: Array) -> Array:
        """Return the second Piola-Kirchhoff stress resultants (t, 2, 2), N/m."""
        nu, trace = self.material.poissons_ratio, np.trace(strain, axis1=1, axis2=2)
        return np.asarray(
            self.material.membrane_stiffness * ((1 - nu) * strain + nu * trace[:, None, None] * np.eye(2))
        )

    def stretching(self, positions: Array) -> Array:
        """Return the energy of stretching (t,) of each triangle, J."""
        strain = self.strain(positions)
        return np.asarray(self.grid.areas / 2 * np.sum(self.stress(strain) * strain, axis=(1, 2)))

    @cached_property
    def _edges(self) -> tuple[Integers, Integers, Array]:
        """Interior edges: vertices (e, 4), the ends and those opposite; triangles (e, 2); weights of H (e, 4)."""
        triangles = self.grid.triangles
        sides = np.concatenate([triangles[:, [1, 2, 0]], triangles[:, [2, 0, 1]], triangles], axis=1).reshape(-1, 3, 3)
        ends = np.moveaxis(sides[:, :2], 1, 2).reshape(-1, 2)  # side k of a triangle is opposite to its corner k
        opposite, owner = triangles.ravel(), np.repeat(np.arange(len(triangles)), 3)
        order = np.lexsort((ends.max(axis=1), ends.min(axis=1)))
        same = np.all(np.sort(ends[order[1:]], axis=1) == np.sort(ends[order[:-1]], axis=1), axis=1)
        one, other = order[:-1][same], order[1:][same]
        vertices = np.column_stack([ends[one], opposite[one], opposite[other]])
        weights = np.zeros((len(vertices), 4))
        for place in (2, 3):
            for end in (0, 1):
                cotangent = self._cotangent(vertices[:, end], vertices[:, 1 - end], vertices[:, place])
                weights[:, 1 - end] += cotangent
                weights[:, place] -= cotangent
        return vertices, np.column_stack([owner[one], owner[other]]), weights

    def _cotangent(self, at: Integers, first: Integers, second: Integers) -> Array:
        """Return the cotangents of the angles at vertices between two others, at rest."""
        u, v = self.grid.rest[first] - self.grid.rest[at], self.grid.rest[second] - self.grid.rest[at]
        return np.asarray(np.sum(u * v, axis=1) / np.linalg.norm(np.cross(u, v), axis=1))

    @cached_property
    def _around(self) -> Array:
        """(e,) areas of both triangles at an edge, m^2."""
        return np.asarray(self.grid.areas[self._edges[1]].sum(axis=1))

    def folds(self, positions: Array) -> Array:
        """Return H (e, 3) of the interior edges, m."""
        vertices, _, weights = self._edges
        return np.asarray(np.einsum("ea,eai->ei", weights, positions[vertices]))

    def bending(self, positions: Array) -> Array:
        """Return the energy of bending (t,) of each triangle, J: half of that of each of its interior edges."""
        edges = self.material.bending_stiffness / 2 * np.sum(self.folds(positions) ** 2, axis=1) / self._around
        energy = np.zeros(len(self.grid.areas))
        np.add.at(energy, self._edges[1], edges[:, None] / 2)
        return energy

    def energies(self, positions: Array) -> tuple[float, float]:
        """Return the energy of stretching and of bending of the whole cloth, J."""
        return float(self.stretching(positions).sum()), float(self.bending(positions).sum())

    def forces(self, positions: Array) -> Array:
        """Return the derivative of the energy by the vertices (v, 3), N: the forces that hold them in place."""
        f = self.deformation(positions)
        pull = self.grid.areas[:, None, None] * (f @ self.stress(self.strain(positions)))
        total = self.grid.scattered(np.einsum("tik,tak->tai", pull, self.slopes))
        vertices, _, weights = self._edges
        moment = self.material.bending_stiffness * self.folds(positions) / self._around[:, None]
        np.add.at(total, vertices, weights[:, :, None] * moment[:, None])
        return total

    def curvature(self, positions: Array) -> Array:
        """Return bbar - b (t, 2, 2), 1/m, in the triangles' frames, of a flat rest and small stretches.

        A triangle's is the sum over its interior edges of (H . n)/(2 A) e' e', n being its normal and e' the unit
        vector in it at right angles to the edge; edges on the rim do not bend.
        """
        vertices, sides, _ = self._edges
        folds, total = self.folds(positions), np.zeros((len(self.grid.areas), 2, 2))
        f = self.deformation(positions)
        normals = np.cross(f[..., 0], f[..., 1])
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        edge = self.grid.rest[vertices[:, 1]] - self.grid.rest[vertices[:, 0]]
        for side in sides.T:
            x, y = np.einsum("ei,eik->ke", edge, self.frames[side][..., :2])
            across = np.stack([y, -x], axis=-1) / np.hypot(x, y)[:, None]
            size = np.sum(folds * normals[side], axis=1) / (2 * self.grid.areas[side])
            np.add.at(total, side, size[:, None, None] * across[:, :, None] * across[:, None, :])
        return total

    def covariant(self, tensors: Array) -> Array:
        """Return tensors (t, 2, 2) of the triangles' frames by components 11, 22, 12 in the surface's coordinates."""
        chart = np.swapaxes(self.grid.points[self.grid.triangles], 1, 2) @ self.slopes
        tangents = np.linalg.inv(chart)
        turned = np.swapaxes(tangents, 1, 2) @ tensors @ tangents
        return np.stack([turned[:, 0, 0], turned[:, 1, 1], turned[:, 0, 1]], axis=-1)
