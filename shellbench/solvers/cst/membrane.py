"""Constant-strain triangles: St. Venant-Kirchhoff's membrane energy and its derivatives.

With F (3, 2) the gradient of the position in the triangle's own Cartesian coordinates at rest, the strain is
E = (F^T F - 1)/2 and the energy per reference area D/2 ((1 - nu) E:E + nu (tr E)^2), D = E h / (1 - nu^2).
Vectors of strain are (E11, E22, 2 E12).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.conditions import Material
from shellbench.solvers.cst.mesh import TriangleMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Membrane:
    """All triangles of a mesh.

    Attributes
    ----------
    triangles
        (t, 3) vertices.
    areas
        (t,) at rest, m^2.
    gradients
        (t, 3, 2) gradients of the barycentric coordinates in the triangle's Cartesian coordinates, 1/m.
    frames
        (t, 3, 2) unit vectors of these coordinates.
    scales
        (t, 2, 2) derivatives of these coordinates by (xi1, xi2).
    elasticity
        (3, 3) stress resultants, N/m, of unit strains.
    """

    triangles: Integers
    areas: Array
    gradients: Array
    frames: Array
    scales: Array
    elasticity: Array

    @classmethod
    def from_mesh(cls, mesh: TriangleMesh, rest: Array, material: Material) -> Membrane:
        """Make the triangles between vertices at rest (v, 3)."""
        corners = rest[mesh.triangles]
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(first, second)
        twice = np.linalg.norm(normal, axis=1)
        e1 = first / np.linalg.norm(first, axis=1, keepdims=True)
        frames = np.stack([e1, np.cross(normal / twice[:, None], e1)], axis=-1)
        sides = np.einsum("tik,tia->tak", np.stack([first, second], axis=-1), frames)
        inverse = np.linalg.inv(sides)
        chart = np.diff(mesh.corners, axis=1, prepend=mesh.corners[:, :1])[:, 1:]
        chart = np.stack([chart[:, 0], chart[:, 0] + chart[:, 1]], axis=-1)
        nu = material.poissons_ratio
        return cls(
            triangles=mesh.triangles,
            areas=twice / 2,
            gradients=np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1),
            frames=frames,
            scales=sides @ np.linalg.inv(chart),
            elasticity=material.membrane_stiffness * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]]),
        )

    def deformation(self, positions: Array) -> Array:
        """Return F (t, 3, 2) at vertex positions (v, 3)."""
        return np.asarray(np.einsum("tai,tak->tik", positions[self.triangles], self.gradients))

    def strain(self, positions: Array) -> Array:
        """Return the strain (t, 3)."""
        f = self.deformation(positions)
        metric = np.einsum("tia,tib->tab", f, f)
        return np.stack([(metric[:, 0, 0] - 1) / 2, (metric[:, 1, 1] - 1) / 2, metric[:, 0, 1]], axis=-1)

    @cached_property
    def rest_operator(self) -> Array:
        """(t, 3, 9) linearised strain of unit displacements of the corners."""
        return self._operator(self.frames)

    def linear_strain(self, displacement: Array) -> Array:
        """Return the linearised strain (t, 3) of vertex displacements (v, 3)."""
        return np.asarray(np.einsum("tsk,tk->ts", self.rest_operator, displacement[self.triangles].reshape(-1, 9)))

    def _operator(self, f: Array) -> Array:
        """Return the derivative (t, 3, 9) of the strain by the corners at deformation gradients F."""
        g = self.gradients
        first = np.einsum("ta,ti->tai", g[..., 0], f[..., 0])
        second = np.einsum("ta,ti->tai", g[..., 1], f[..., 1])
        shear = np.einsum("ta,ti->tai", g[..., 1], f[..., 0]) + np.einsum("ta,ti->tai", g[..., 0], f[..., 1])
        return np.stack([first, second, shear], axis=1).reshape(-1, 3, 9)

    def energy(self, strain: Array) -> Array:
        """Return the energy (t,) of each triangle, J, at strains (t, 3)."""
        return np.asarray(self.areas / 2 * np.einsum("ts,sr,tr->t", strain, self.elasticity, strain))

    def gradient(self, positions: Array) -> Array:
        """Return the derivative (t, 9) of each triangle's energy by its corners, N."""
        stress = self.strain(positions) @ self.elasticity
        operator = self._operator(self.deformation(positions))
        return np.asarray(np.einsum("t,tsk,ts->tk", self.areas, operator, stress))

    def hessian(self, positions: Array, definite: bool = False) -> Array:
        """Return the second derivative (t, 9, 9), N/m.

        If it must be `definite`, the compressive part of the stress is left out of its geometric term: what remains
        is a sum of squares.
        """
        operator = self._operator(self.deformation(positions))
        voigt = self.strain(positions) @ self.elasticity
        stress = voigt[:, [[0, 2], [2, 1]]]
        if definite:
            values, axes = np.linalg.eigh(stress)
            stress = np.einsum("tak,tk,tbk->tab", axes, np.maximum(values, 0.0), axes)
        geometric = np.einsum("tak,tkl,tbl->tab", self.gradients, stress, self.gradients)
        material = np.swapaxes(operator, 1, 2) @ (self.elasticity @ operator)
        blocks = material + np.einsum("tab,ij->taibj", geometric, np.eye(3)).reshape(-1, 9, 9)
        return np.asarray(self.areas[:, None, None] * blocks)

    def covariant(self, strain: Array) -> Array:
        """Return strains (t, 3) as covariant components 11, 22, 12 in the surface's coordinates."""
        tensor = strain[:, [[0, 2], [2, 1]]] * np.array([[1, 0.5], [0.5, 1]])
        turned = np.einsum("tka,tkl,tlb->tab", self.scales, tensor, self.scales)
        return np.stack([turned[:, 0, 0], turned[:, 1, 1], turned[:, 0, 1]], axis=-1)
