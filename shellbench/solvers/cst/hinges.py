"""Bending by hinges: an energy of the angle between the triangles on both sides of each interior edge.

The energy of an edge e between triangles of areas A1 and A2 is k |e|^2/(A1 + A2) (theta - theta0)^2 (Grinspun et al.
2003; Bridson et al. 2003; ARCSim). On a regular grid with sides p and q, the surface w = kappa x^2/2 folds only the
edges across x, by kappa p each; such an edge, of length q between triangles of areas p q/2, then has the energy
k q^2/(p q) (kappa p)^2 = k kappa^2 p q, and a cell has one of them. The plate has B kappa^2/2 per area: k = B/2.

With this k the energy of a cylinder along either coordinate is exact on any regular grid. What hinges can't do:

- They know no Poisson's ratio: the material's own has no say in bending but through B.
- They bend as another plate does, which depends on the mesh and stays so however fine it is. Square cells with all
  diagonals to the right tend to the energy per area B/2 ((k11 + k12)^2 + (k22 + k12)^2 + 4 k12^2), by the folds of a
  quadratic surface; to the left with -k12. With alternating diagonals every second vertex gives way by
  (k11 + k22)/12 times the cell's area, and what is left is B/2 (5/6 (k11^2 + k22^2) - k11 k22/3 + 4 k12^2).
  The isotropic plate without Poisson's effect has B/2 (k11^2 + k22^2 + 2 k12^2). No other k, not even one for each
  direction of edges, takes the product of k11 and k12 out of the first of these.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.conditions import Material
from shellbench.solvers.cst.membrane import Membrane
from shellbench.solvers.cst.mesh import TriangleMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Hinges:
    """All interior edges of a mesh.

    Attributes
    ----------
    vertices
        (h, 4) both ends of the edge, then the other corners of its first and second triangle.
    sides
        (h, 2) the triangles.
    stiffness
        (h,) k |e|^2 / (A1 + A2), J.
    rest
        (v, 3) positions of all vertices at rest.
    """

    vertices: Integers
    sides: Integers
    stiffness: Array
    rest: Array

    @classmethod
    def from_mesh(cls, mesh: TriangleMesh, rest: Array, membrane: Membrane, material: Material) -> Hinges:
        """Make the hinges between vertices at rest (v, 3)."""
        vertices, sides = mesh.hinges
        squared = np.sum((rest[vertices[:, 1]] - rest[vertices[:, 0]]) ** 2, axis=1)
        k = material.bending_stiffness / 2
        return cls(vertices, sides, k * squared / membrane.areas[sides].sum(axis=1), rest)

    @cached_property
    def rest_angles(self) -> Array:
        """(h,) angles at rest."""
        return fold(self.rest[self.vertices])

    @cached_property
    def rest_gradient(self) -> Array:
        """(h, 12) derivative of the angles at rest."""
        return fold_gradient(self.rest[self.vertices])

    def change(self, positions: Array) -> Array:
        """Return theta - theta0 (h,), radians, at vertex positions (v, 3); within half a turn."""
        difference = fold(positions[self.vertices]) - self.rest_angles
        return np.asarray(np.mod(difference + np.pi, 2 * np.pi) - np.pi)

    def linear_change(self, displacement: Array) -> Array:
        """Return the linearised change (h,) of the angles for vertex displacements (v, 3)."""
        return np.asarray(np.sum(self.rest_gradient * displacement[self.vertices].reshape(-1, 12), axis=1))

    def energy(self, change: Array) -> Array:
        """Return the energy (h,) of each hinge, J."""
        return np.asarray(self.stiffness * change**2)

    def gradient(self, positions: Array) -> Array:
        """Return the derivative (h, 12) of each hinge's energy by its vertices, N."""
        slope = fold_gradient(positions[self.vertices])
        return np.asarray((2 * self.stiffness * self.change(positions))[:, None] * slope)

    def hessian(self, positions: Array, definite: bool = False) -> Array:
        """Return the second derivative (h, 12, 12), N/m; if it must be `definite`, its squares alone (Gauss-Newton)."""
        corners = positions[self.vertices]
        slope = fold_gradient(corners)
        blocks = 2 * self.stiffness[:, None, None] * slope[:, :, None] * slope[:, None, :]
        if definite:
            return np.asarray(blocks)
        moment = 2 * self.stiffness * self.change(positions)
        return np.asarray(blocks + moment[:, None, None] * fold_hessian(corners))

    def curvature(self, change: Array, membrane: Membrane) -> Array:
        """Return bbar - b (t, 3) of each triangle, in its own Cartesian coordinates: 11, 22 and twice 12.

        It is the sum over the triangle's edges of (theta - theta0)/(2 A |e|) n n, n the edge turned by a right angle
        (the triangle's shape operator of Grinspun, Gingold, Reisman & Zorin 2006). It is right for every quadratic
        surface on a regular grid whose diagonals are alike; with alternating ones its mean over neighbouring cells is.
        Edges on the rim have no hinge and count as unfolded.
        """
        edge = self.rest[self.vertices[:, 1]] - self.rest[self.vertices[:, 0]]
        length = np.linalg.norm(edge, axis=1)
        total = np.zeros((len(membrane.areas), 3))
        for side in self.sides.T:
            along = np.einsum("hi,hia->ha", edge, membrane.frames[side])
            n = np.stack([along[:, 1], -along[:, 0]], axis=-1)
            weight = change / (2 * membrane.areas[side] * length)
            products = np.stack([n[:, 0] ** 2, n[:, 1] ** 2, 2 * n[:, 0] * n[:, 1]], axis=-1)
            np.add.at(total, side, weight[:, None] * products)
        return total

    def energy_by_triangle(self, change: Array, membrane: Membrane) -> Array:
        """Return the energy (t,) of each triangle, J: a half of each of its hinges'."""
        total = np.zeros(len(membrane.areas))
        for side in self.sides.T:
            np.add.at(total, side, self.energy(change) / 2)
        return total


def fold(corners: Array) -> Array:
    """Return the angle (h,) from the first triangle's normal to the second's about the edge.

    Parameters
    ----------
    corners
        (h, 4, 3) ends of the edges and the other corners of the first and second triangle.
    """
    _, edge, n1, n2 = _parts(corners)
    sine = np.sum(np.cross(n1, n2) * edge, axis=1) / np.linalg.norm(edge, axis=1)
    return np.asarray(np.arctan2(sine, np.sum(n1 * n2, axis=1)))


def _parts(x: Array) -> tuple[Array, Array, Array, Array]:
    """Return the corners, the edge and both normals, as long as twice the area."""
    edge = x[:, 1] - x[:, 0]
    return x, edge, np.cross(edge, x[:, 2] - x[:, 0]), np.cross(x[:, 3] - x[:, 0], edge)


def fold_gradient(corners: Array) -> Array:
    """Return the derivative (h, 12) of the angle: a corner at height d over the edge turns its triangle by 1/d.

    The ends of the edge take what translations need, in the ratio of the heights' feet.
    """
    x, edge, n1, n2 = _parts(corners)
    length = np.linalg.norm(edge, axis=1, keepdims=True)
    g2 = -length * n1 / np.sum(n1**2, axis=1, keepdims=True)
    g3 = -length * n2 / np.sum(n2**2, axis=1, keepdims=True)
    s2, s3 = (np.sum((x[:, k] - x[:, 0]) * edge, axis=1, keepdims=True) / length**2 for k in (2, 3))
    return np.concatenate([(s2 - 1) * g2 + (s3 - 1) * g3, -s2 * g2 - s3 * g3, g2, g3], axis=1)


def fold_hessian(corners: Array) -> Array:
    """Return the second derivative (h, 12, 12) of the angle: the derivative of `fold_gradient`, term by term."""
    x, edge, n1, n2 = _parts(corners)
    squared = np.sum(edge**2, axis=1)
    length = np.sqrt(squared)
    d = np.eye(12).reshape(4, 3, 12)
    d_edge = d[1] - d[0]
    d_length = (edge @ d_edge) / length[:, None]
    slopes, feet = [], []
    for arm, d_arm, normal, sign in (
        (x[:, 2] - x[:, 0], d[2] - d[0], n1, 1.0),
        (x[:, 3] - x[:, 0], d[3] - d[0], n2, -1.0),
    ):
        d_normal = sign * (_cross(edge) @ d_arm - _cross(arm) @ d_edge)
        size = np.sum(normal**2, axis=1)
        g = -(length / size)[:, None] * normal
        d_size = 2 * np.einsum("hi,hik->hk", normal, d_normal)
        d_g = -(length / size)[:, None, None] * d_normal
        d_g = (
            d_g
            - normal[:, :, None] * ((d_length * size[:, None] - length[:, None] * d_size) / size[:, None] ** 2)[:, None]
        )
        foot = np.sum(arm * edge, axis=1) / squared
        d_foot = (edge @ d_arm + arm @ d_edge - 2 * foot[:, None] * (edge @ d_edge)) / squared[:, None]
        slopes.append((g, d_g))
        feet.append((foot[:, None, None], d_foot[:, None]))
    start, end = np.zeros((len(x), 3, 12)), np.zeros((len(x), 3, 12))
    for (g, d_g), (foot, d_foot) in zip(slopes, feet, strict=True):
        turned = g[:, :, None] * d_foot
        start += (foot - 1) * d_g + turned
        end -= foot * d_g + turned
    return np.concatenate([start, end, slopes[0][1], slopes[1][1]], axis=1)


def _cross(vectors: Array) -> Array:
    """Return the matrices (h, 3, 3) that take the cross product of vectors (h, 3) with what follows."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
