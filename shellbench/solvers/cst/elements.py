"""Triangles that stretch, and hinges between them that bend.

Triangles have a constant strain and St. Venant-Kirchhoff's membrane energy and its derivatives. With F (3, 2) the
gradient of the position in the triangle's own Cartesian coordinates at rest, the strain is E = (F^T F - 1)/2 and the
energy per reference area D/2 ((1 - nu) E:E + nu (tr E)^2), D = E h / (1 - nu^2). Vectors of strain are (E11, E22, 2
E12).

Bending is by hinges: an energy of the angle between the triangles on both sides of each interior edge. The energy of an
edge e between triangles of areas A1 and A2 is k |e|^2/(A1 + A2) (theta - theta0)^2 (Grinspun et al. 2003; Bridson et
al. 2003; ARCSim). On a regular grid with sides p and q, the surface w = kappa x^2/2 folds only the edges across x, by
kappa p each; such an edge, of length q between triangles of areas p q/2, then has the energy k q^2/(p q) (kappa p)^2 =
k kappa^2 p q, and a cell has one of them. The plate has B kappa^2/2 per area: k = B/2.

With this k the energy of a cylinder along either coordinate is exact on any regular grid. An orthotropic shell has A
instead of D, and as B of an edge the stiffness of a cylinder along it, as cloth simulators do. Limits of hinges:

- They have no Poisson's ratio: the material's ratio enters bending through B only.
- They converge to the stiffness of another plate, which depends on the mesh's pattern. Square cells with all diagonals
  to the right tend to the energy per area B/2 ((k11 + k12)^2 + (k22 + k12)^2 + 4 k12^2), by the folds of a quadratic
  surface; to the left with -k12. With alternating diagonals every second vertex gives way by (k11 + k22)/12 times the
  cell's area, and what is left is B/2 (5/6 (k11^2 + k22^2) - k11 k22/3 + 4 k12^2). The isotropic plate without
  Poisson's effect has B/2 (k11^2 + k22^2 + 2 k12^2). No other k, not even one for each direction of edges, removes the
  product of k11 and k12 from the first of these.

A clamped edge has hinges too: between each of its triangles and the fixed tangent plane at rest. Such a hinge is half
of an interior one. The triangle's slope is that of the middle of its cell, p/2 from the wall, so that the surface above
folds it by kappa p/2; the energy is k |e|^2/A1 (theta - theta0)^2, k kappa^2 p q/2 as of half a cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.orthotropic import AnyMaterial, OrthotropicMaterial
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import COORDINATES
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
        (t, 3, 3) stress resultants, N/m, of unit strains.
    warp
        (t,) angles of an orthotropic material's direction 1 in these coordinates, radians; zeros if it is isotropic.
    """

    triangles: Integers
    areas: Array
    gradients: Array
    frames: Array
    scales: Array
    elasticity: Array
    warp: Array

    @classmethod
    def from_mesh(cls, mesh: TriangleMesh, rest: Array, material: AnyMaterial) -> Membrane:
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
        scales, warp, nu = sides @ np.linalg.inv(chart), np.zeros(len(corners)), material.poissons_ratios[0]
        elasticity = material.membrane_stiffness * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
        if isinstance(material, OrthotropicMaterial):
            line = scales[:, :, COORDINATES.index(material.along)]
            warp = np.arctan2(line[:, 1], line[:, 0]) + np.radians(material.angle)
            elasticity = material.turned_by(warp)[0]
        return cls(
            triangles=mesh.triangles,
            areas=twice / 2,
            gradients=np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1),
            frames=frames,
            scales=scales,
            elasticity=np.broadcast_to(elasticity, (len(corners), 3, 3)),
            warp=warp,
        )

    def stresses(self, strain: Array) -> Array:
        """Return the stress resultants (t, 3), N/m, of strains (t, 3)."""
        return np.asarray((strain[:, None] @ self.elasticity)[:, 0])

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
        return np.asarray(self.areas / 2 * np.sum(strain * self.stresses(strain), axis=1))

    def gradient(self, positions: Array) -> Array:
        """Return the derivative (t, 9) of each triangle's energy by its corners, N."""
        stress = self.stresses(self.strain(positions))
        operator = self._operator(self.deformation(positions))
        return np.asarray(np.einsum("t,tsk,ts->tk", self.areas, operator, stress))

    def hessian(self, positions: Array, definite: bool = False) -> Array:
        """Return the second derivative (t, 9, 9), N/m.

        If it must be `definite`, the compressive part of the stress is left out of its geometric term: what remains
        is a sum of squares.
        """
        operator = self._operator(self.deformation(positions))
        voigt = self.stresses(self.strain(positions))
        stress = voigt[:, [[0, 2], [2, 1]]]
        if definite:
            values, axes = np.linalg.eigh(stress)
            stress = np.einsum("tak,tk,tbk->tab", axes, np.maximum(values, 0.0), axes)
        material = np.swapaxes(operator, 1, 2) @ (self.elasticity @ operator)
        return np.asarray(self.areas[:, None, None] * material + self._stress_stiffness(stress))

    def geometric_stiffness(self, strain: Array) -> Array:
        """Return the part (t, 9, 9) of the second derivative that stresses have at rest, N/m, from strains (t, 3)."""
        return self._stress_stiffness(self.stresses(strain)[:, [[0, 2], [2, 1]]])

    def _stress_stiffness(self, stress: Array) -> Array:
        geometric = np.einsum("t,tak,tkl,tbl->tab", self.areas, self.gradients, stress, self.gradients)
        return np.asarray(np.einsum("tab,ij->taibj", geometric, np.eye(3)).reshape(-1, 9, 9))

    def covariant_strain(self, strain: Array) -> Array:
        """Return strains (t, 3) as covariant components 11, 22, 12 in the surface's coordinates."""
        tensor = strain[:, [[0, 2], [2, 1]]] * np.array([[1, 0.5], [0.5, 1]])
        turned = np.einsum("tka,tkl,tlb->tab", self.scales, tensor, self.scales)
        return np.stack([turned[:, 0, 0], turned[:, 1, 1], turned[:, 0, 1]], axis=-1)


@dataclass(frozen=True)
class Walls:
    """Clamped edges of the rectangle, and the directions of the surface's continuation there.

    Attributes
    ----------
    edges
        Edges of the rectangle.
    outward
        (w, 3) vectors in the tangent plane at rest, away from the surface, one for each side of the mesh on them.
    """

    edges: tuple[Edge, ...]
    outward: Array

    @classmethod
    def from_case(cls, case: Case, mesh: TriangleMesh) -> Walls | None:
        """Find the clamped edges of a case; None if there are none."""
        named = [case.places[name] for support in case.supports if support.holds_slope for name in support.on]
        edges = tuple(place for place in dict.fromkeys(named) if isinstance(place, Edge))
        if not edges:
            return None
        outward = []
        for edge in edges:
            middles = mesh.side_middles(edge)
            x = case.surface.derivatives(middles, order=1)
            along, across = (x[0, 1], x[1, 0]) if edge.axis == 0 else (x[1, 0], x[0, 1])
            unit = along / np.linalg.norm(along, axis=-1, keepdims=True)
            normal = across - np.sum(across * unit, axis=-1, keepdims=True) * unit
            outward.append(-normal if edge.side == "min" else normal)
        return cls(edges, np.concatenate(outward))

    def corners(self, rim: Array) -> Array:
        """Return corners (w, 3) of the walls behind the triangles (w, 3, 3) on the rim, as distant as theirs."""
        edge, arm = rim[:, 1] - rim[:, 0], rim[:, 2] - rim[:, 0]
        height = np.linalg.norm(np.cross(edge, arm), axis=1) / np.linalg.norm(edge, axis=1)
        unit = self.outward / np.linalg.norm(self.outward, axis=1, keepdims=True)
        return np.asarray((rim[:, 0] + rim[:, 1]) / 2 + height[:, None] * unit)


@dataclass(frozen=True)
class Hinges:
    """All interior edges of a mesh, and those on walls.

    Attributes
    ----------
    vertices
        (h, 4) both ends of the edge, then the other corners of its first and second triangle. Those from v on are
        corners of walls, which never move.
    sides
        (h, 2) the triangles; at a wall the same one twice.
    stiffness
        (h,) k |e|^2 / (A1 + A2), J; at a wall k |e|^2 / A1.
    rest
        (v + w, 3) positions of all vertices at rest, and of the corners of walls.
    """

    vertices: Integers
    sides: Integers
    stiffness: Array
    rest: Array

    @classmethod
    def from_mesh(
        cls, mesh: TriangleMesh, rest: Array, membrane: Membrane, material: AnyMaterial, walls: Walls | None = None
    ) -> Hinges:
        """Make the hinges between vertices at rest (v, 3), and those at walls."""
        vertices, sides = mesh.hinges
        areas = membrane.areas[sides].sum(axis=1)
        if walls is not None:
            rim, side = mesh.rim_triangles(walls.edges)
            corner = len(rest) + np.arange(len(rim))
            vertices, sides = np.vstack([vertices, np.column_stack([rim, corner])]), np.vstack([sides, side])
            areas = np.append(areas, membrane.areas[side[:, 0]])
            rest = np.vstack([rest, walls.corners(rest[rim])])
        edge = rest[vertices[:, 1]] - rest[vertices[:, 0]]
        bending: float | Array = material.bending_stiffness
        if isinstance(material, OrthotropicMaterial):
            x, y = np.einsum("hi,hia->ah", edge, membrane.frames[sides[:, 0]])
            bending = material.turned_by(membrane.warp[sides[:, 0]] - np.arctan2(-x, y))[1][:, 0, 0]
        return cls(vertices, sides, bending / 2 * np.sum(edge**2, axis=1) / areas, rest)

    def corners(self, positions: Array) -> Array:
        """Return the corners (h, 4, 3) of the hinges at vertex positions (v, 3)."""
        return np.concatenate([positions, self.rest[len(positions) :]])[self.vertices]

    @cached_property
    def rest_angles(self) -> Array:
        """(h,) angles at rest."""
        return fold_angle(self.rest[self.vertices])

    @cached_property
    def rest_gradient(self) -> Array:
        """(h, 12) derivative of the angles at rest."""
        return fold_gradient(self.rest[self.vertices])

    def angle_change(self, positions: Array) -> Array:
        """Return theta - theta0 (h,), radians, at vertex positions (v, 3); within half a turn."""
        difference = fold_angle(self.corners(positions)) - self.rest_angles
        return np.asarray(np.mod(difference + np.pi, 2 * np.pi) - np.pi)

    def linear_angle_change(self, displacement: Array) -> Array:
        """Return the linearised change (h,) of the angles for vertex displacements (v, 3)."""
        moved = np.concatenate([displacement, np.zeros((len(self.rest) - len(displacement), 3))])[self.vertices]
        return np.asarray(np.sum(self.rest_gradient * moved.reshape(-1, 12), axis=1))

    def energy(self, change: Array) -> Array:
        """Return the energy (h,) of each hinge, J."""
        return np.asarray(self.stiffness * change**2)

    def gradient(self, positions: Array) -> Array:
        """Return the derivative (h, 12) of each hinge's energy by its vertices, N."""
        slope = fold_gradient(self.corners(positions))
        return np.asarray((2 * self.stiffness * self.angle_change(positions))[:, None] * slope)

    def hessian(self, positions: Array, definite: bool = False) -> Array:
        """Return the second derivative (h, 12, 12), N/m; if it must be `definite`, its squares alone (Gauss-Newton)."""
        corners = self.corners(positions)
        slope = fold_gradient(corners)
        blocks = 2 * self.stiffness[:, None, None] * slope[:, :, None] * slope[:, None, :]
        if definite:
            return np.asarray(blocks)
        moment = 2 * self.stiffness * self.angle_change(positions)
        return np.asarray(blocks + moment[:, None, None] * fold_hessian(corners))

    def curvature(self, change: Array, membrane: Membrane) -> Array:
        """Return bbar - b (t, 3) of each triangle, in its own Cartesian coordinates: 11, 22 and twice 12.

        It is the sum over the triangle's edges of (theta - theta0)/(2 A |e|) n n, n the edge turned by a right angle
        (the triangle's shape operator of Grinspun, Gingold, Reisman & Zorin 2006). It is exact for every quadratic
        surface on a regular grid whose diagonals are alike; with alternating ones its mean over neighbouring cells is
        exact. Edges on the rim count as unfolded unless they are clamped.
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


def fold_angle(corners: Array) -> Array:
    """Return the angle (h,) from the first triangle's normal to the second's about the edge.

    Parameters
    ----------
    corners
        (h, 4, 3) ends of the edges and the other corners of the first and second triangle.
    """
    _, edge, n1, n2 = _edge_and_normals(corners)
    sine = np.sum(np.cross(n1, n2) * edge, axis=1) / np.linalg.norm(edge, axis=1)
    return np.asarray(np.arctan2(sine, np.sum(n1 * n2, axis=1)))


def _edge_and_normals(x: Array) -> tuple[Array, Array, Array, Array]:
    """Return the corners, the edge and both normals, as long as twice the area."""
    edge = x[:, 1] - x[:, 0]
    return x, edge, np.cross(edge, x[:, 2] - x[:, 0]), np.cross(x[:, 3] - x[:, 0], edge)


def fold_gradient(corners: Array) -> Array:
    """Return the derivative (h, 12) of the angle: a corner at height d over the edge turns its triangle by 1/d.

    The ends of the edge balance this, in the ratio of the heights' feet, so that translations do not change the angle.
    """
    x, edge, n1, n2 = _edge_and_normals(corners)
    length = np.linalg.norm(edge, axis=1, keepdims=True)
    g2 = -length * n1 / np.sum(n1**2, axis=1, keepdims=True)
    g3 = -length * n2 / np.sum(n2**2, axis=1, keepdims=True)
    s2, s3 = (np.sum((x[:, k] - x[:, 0]) * edge, axis=1, keepdims=True) / length**2 for k in (2, 3))
    return np.concatenate([(s2 - 1) * g2 + (s3 - 1) * g3, -s2 * g2 - s3 * g3, g2, g3], axis=1)


def fold_hessian(corners: Array) -> Array:
    """Return the second derivative (h, 12, 12) of the angle: the derivative of `fold_gradient`, term by term."""
    x, edge, n1, n2 = _edge_and_normals(corners)
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
    """Return the matrices (h, 3, 3) of the cross product of vectors (h, 3) with another vector."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
