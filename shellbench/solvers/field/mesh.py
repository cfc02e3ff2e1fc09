"""The mesh of `vertex-mesh`: a lattice of almost equilateral triangles, and the energy of its edges and hinges.

1. Rows of vertices, every other one shifted by half an edge, with half triangles at two sides. The distance of rows is
   that of equilateral triangles, adjusted so that their number is even. A turned mesh, and that of a disc, are cut out
   of a lattice of equilateral triangles and joined to vertices on the rim by Delaunay's triangles.
2. A triangle is flat: all structures within it have the same strain. Their mean over orientations is that of six
   directions.
3. Two faces that share an edge are a pair of a local structure, but of the mesh's size: |n1 - n2|^2 times (s / h)^2 has
   the limit of structures of side s. Departure from the paper, whose mesh bends by its own edges.
4. A vertex has the mean of six corners' collision over its share of the area, and that share of the weight.
5. Newton's method as for grids, with an implementation of its own: the Hessian is clamped and damped until steps are
   small.

The mesh shares no code with grids, since it is their reference.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags, identity, kron
from scipy.sparse.linalg import splu
from scipy.spatial import Delaunay, cKDTree

from shellbench.errors import InputError, SolveFailure
from shellbench.problems.field.case import Disc, FieldCase
from shellbench.problems.field.formulas import evaluated

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
Sparse = Any
DIRECTIONS = 6  # of edges in a triangle: two structures, a sixth of a turn apart
CORNERS = 6  # of a structure that collide
DAMPING, FARTHEST, NEAR, SMALL, MOST = 1e-7, 0.1, 3e-4, 1e-10, 200
EPSILON = 64 * float(np.finfo(float).eps)  # relative error of a place, with a margin
ANCHOR = 1e-12  # stiffness that holds free vertices while pins are extended
TURN = 2 * math.pi
THIN = 1e-6  # area of a triangle in squares of an edge's length, below which it is none: along straight edges
NEIGHBOURS = 12  # triangles among which that about a point is
ON_RIM = 1e-9  # level of a disc
INDEFINITE = 1e-9  # relative size of a negative pivot that is not rounding


@dataclass(frozen=True)
class Lattice:
    """Vertices (n, 2) of the unit square, triangles (t, 3) strip by strip, and strips and columns."""

    points: Array
    triangles: Whole
    strips: int
    columns: int

    @classmethod
    def of(cls, columns: int) -> Lattice:
        """Return the lattice with so many edges along u."""
        strips = 4 * max(1, round(columns / math.sqrt(3) / 2))
        even = np.linspace(0, 1, columns + 1)
        odd = np.concatenate([[0.0], (np.arange(columns) + 0.5) / columns, [1.0]])
        rows = [even if row % 2 == 0 else odd for row in range(strips + 1)]
        starts = np.concatenate([[0], np.cumsum([len(row) for row in rows])])
        points = np.concatenate([np.stack([row, np.full(len(row), j / strips)], axis=1) for j, row in enumerate(rows)])
        i = np.arange(columns)
        found = []
        for j in range(strips):
            low, high = starts[j], starts[j + 1]
            strip = np.zeros((2 * columns + 1, 3), dtype=np.int64)
            if j % 2 == 0:  # the longer row is above
                strip[0::2] = np.stack([low + np.arange(columns + 1)] * 3, axis=1)
                strip[0::2, 1:] = np.stack([high + 1 + np.arange(columns + 1), high + np.arange(columns + 1)], axis=1)
                strip[1::2] = np.stack([low + i, low + i + 1, high + i + 1], axis=1)
            else:
                more = np.arange(columns + 1)
                strip[0::2] = np.stack([low + more, low + more + 1, high + more], axis=1)
                strip[1::2] = np.stack([low + i + 1, high + i + 1, high + i], axis=1)
            found.append(strip)
        return cls(points, np.concatenate(found), strips, columns)

    def within(self, points: Array) -> tuple[Whole, Array]:
        """Return the triangle (n,) about each of points (n, 2), and the shares (n, 3) of its corners."""
        strip = np.minimum((points[:, 1] * self.strips).astype(np.int64), self.strips - 1)
        column = np.minimum((points[:, 0] * self.columns).astype(np.int64), self.columns - 1)
        near = np.clip(2 * column[:, None] + np.arange(-1, 4), 0, 2 * self.columns)
        near += (strip * (2 * self.columns + 1))[:, None]
        return nearest_triangle(self, near, points)


@dataclass(frozen=True)
class Triangulation:
    """Vertices (n, 2) of a turned lattice of equilateral triangles, cut to the cloth, and Delaunay's triangles (t, 3).

    Vertices at the rim are as far apart as those of the lattice, and join it by other triangles.
    """

    points: Array
    triangles: Whole
    columns: int

    @classmethod
    def of(cls, columns: int, turn: float, disc: Disc | None) -> Triangulation:
        """Return the triangles for so many edges along a side, turned by an angle in degrees about the middle."""
        side, reach = 1 / columns, np.arange(-columns, columns + 1)
        row, column = (part.ravel() for part in np.meshgrid(reach, reach))
        middle, angle = np.full(2, 0.5), math.radians(turn)
        across, up = column + (row % 2) / 2, row * math.sqrt(3) / 2
        lattice = middle + side * np.stack(
            [across * math.cos(angle) - up * math.sin(angle), across * math.sin(angle) + up * math.cos(angle)], axis=1
        )
        if disc is None:
            far, along = np.minimum(lattice, 1 - lattice).min(axis=1), np.arange(columns) / columns
            edge = np.stack([along, np.zeros(columns)], axis=1) - middle
            rim = np.concatenate([edge @ [[c, s], [-s, c]] for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))])
        else:
            far, count = disc.radius - np.linalg.norm(lattice - middle, axis=1), math.ceil(TURN * disc.radius / side)
            around = TURN * np.arange(count) / count
            rim = disc.radius * np.stack([np.cos(around), np.sin(around)], axis=1)
        points = np.concatenate([lattice[far > side / 2], middle + rim])
        triangles = Delaunay(points).simplices.astype(np.int64)
        a, b, c = (points[triangles[:, corner]] for corner in range(3))
        size = cross(b - a, c - a)
        triangles[size < 0] = triangles[size < 0][:, ::-1]
        return cls(points, triangles[np.abs(size) > THIN * side**2], columns)

    def within(self, points: Array) -> tuple[Whole, Array]:
        """Return the triangle (n,) about each of points (n, 2), or near it, and the shares (n, 3) of corners."""
        near = cKDTree(self.points[self.triangles].mean(axis=1)).query(points, k=NEIGHBOURS)[1]
        return nearest_triangle(self, near, points)


def nearest_triangle(lattice: Lattice | Triangulation, near: Whole, points: Array) -> tuple[Whole, Array]:
    """Return the near triangle (n,), out of k, about each of points (n, 2), and the shares (n, 3) of its corners."""
    a, b, c = (lattice.points[lattice.triangles[near, corner]] for corner in range(3))
    size, here = cross(b - a, c - a), points[:, None]
    shares = np.stack([cross(b - here, c - here), cross(c - here, a - here), cross(a - here, b - here)], axis=-1)
    shares /= size[..., None]
    best, pick = shares.min(axis=-1).argmax(axis=1), np.arange(len(points))
    return near[pick, best], shares[pick, best]


def cross(one: Array, other: Array) -> Array:
    """Return the cross product (...) of vectors (..., 2)."""
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


class Mesh:
    """A cloth on a lattice: its losses, their slopes and second derivatives for places (n, 3) of vertices."""

    def __init__(self, case: FieldCase, columns: int, directions: int = DIRECTIONS, turn: float | None = None) -> None:
        assert case.cloth is not None
        plain = turn is None and case.disc is None
        self.lattice = Lattice.of(columns) if plain else Triangulation.of(columns, turn or 0.0, case.disc)
        self.case, self.cloth = case, case.cloth
        points, triangles = self.lattice.points, self.lattice.triangles
        self.rest = case.rest(points)
        sides = np.stack([points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2)], axis=2)
        self.areas = np.linalg.det(sides) / 2
        self.areas /= self.areas.sum() if case.disc else 1.0  # losses are means over the cloth
        angles = math.pi * np.arange(directions) / directions
        along = np.linalg.inv(sides) @ np.stack([np.cos(angles), np.sin(angles)])
        self.rows = np.concatenate([-along.sum(axis=1, keepdims=True), along], axis=1)  # (t, 3, directions)
        self.lengths = np.linalg.norm(self.edges(self.rest), axis=-1)
        self.share = np.bincount(triangles.ravel(), np.repeat(self.areas / 3, 3), len(points))
        self.hinges, self.sizes = self._hinges()

    def _hinges(self) -> tuple[Whole, Array]:
        """Return the corners (h, 4) of pairs of faces, the shared edge first, and the areas (h,) of both."""
        corners = self.lattice.triangles[:, [[0, 1, 2], [1, 2, 0], [2, 0, 1]]].reshape(-1, 3)
        keys = np.sort(corners[:, :2], axis=1) @ [len(self.rest), 1]
        order = np.argsort(keys, kind="stable")
        pairs = np.nonzero(np.diff(keys[order]) == 0)[0]
        one, other = order[pairs], order[pairs + 1]
        areas = np.repeat(self.areas, 3)
        return np.column_stack([corners[one], corners[other, 2]]), areas[one] + areas[other]

    def edges(self, places: Array) -> Array:
        """Return vectors (t, directions, 3) that were of length one in the square."""
        return np.asarray(np.einsum("tik,tia->tka", self.rows, places[self.lattice.triangles]))

    def means(self, places: Array) -> dict[str, float]:
        """Return the mean of each loss, without its weight."""
        stretch = np.linalg.norm(self.edges(places), axis=-1) / self.lengths - 1
        one, other = (normals(places, self.hinges[:, faces]) for faces in ([0, 1, 2], [1, 0, 3]))
        scale = (self.cloth.side * self.lattice.columns) ** 2
        found = {
            "strain": float(3 * self.areas @ np.mean(stretch**2, axis=1)),
            "bend": float(scale * self.sizes @ np.sum((one[0] - other[0]) ** 2, axis=1)),
            "gravity": float(self.cloth.mass_gravity * self.share @ places[:, 2]),
        }
        if self.case.body:
            distance = self.case.body.contact(places)[0]
            found["collision"] = float(CORNERS * self.share @ np.minimum(distance, 0) ** 2)
        return found

    def energy(self, places: Array) -> float:
        """Return the energy."""
        return sum(self.cloth.weights[name] * mean for name, mean in self.means(places).items())

    def slopes(self, places: Array, convex: bool) -> tuple[Array, Sparse]:
        """Return the gradient (n, 3) and the Hessian (3 n, 3 n) of the energy, Gauss and Newton's for hinges."""
        parts = [self._strain(places, convex)]
        if self.cloth.bend:
            parts.append(self._bend(places))
        if self.case.body:
            parts.append(self._collision(places, convex))
        gradient, size = np.zeros_like(places), places.size
        gradient[:, 2] = self.cloth.gravity * self.cloth.mass_gravity * self.share
        hessian = 0
        for numbers, slope, second in parts:
            count = 3 * numbers.shape[1]
            np.add.at(gradient, numbers, slope)
            degrees = (3 * numbers[..., None] + np.arange(3)).reshape(-1, count)
            rows, columns = np.repeat(degrees, count, axis=1).ravel(), np.tile(degrees, count).ravel()
            hessian = hessian + coo_matrix((second.ravel(), (rows, columns)), shape=(size, size)).tocsr()
        return gradient, hessian

    def _strain(self, places: Array, convex: bool) -> tuple[Whole, Array, Array]:
        edges = self.edges(places)
        long = np.linalg.norm(edges, axis=-1)
        unit, stretch = edges / long[..., None], long / self.lengths - 1
        weight = 3 * self.cloth.strain * self.areas[:, None] / self.rows.shape[2]
        slope = np.einsum("tik,tka->tia", self.rows, (2 * weight * stretch / self.lengths)[..., None] * unit)
        outer = unit[..., :, None] * unit[..., None, :]
        tension = 1 - self.lengths / long
        tension = np.maximum(tension, 0) if convex else tension
        block = (2 * weight / self.lengths**2)[..., None, None] * (
            outer + tension[..., None, None] * (np.eye(3) - outer)
        )
        second = np.einsum("tik,tkab,tjk->tiajb", self.rows, block, self.rows, optimize=True)
        return self.lattice.triangles, slope, second

    def _bend(self, places: Array) -> tuple[Whole, Array, Array]:
        (one, first), (other, second) = (normals(places, self.hinges[:, faces]) for faces in ([0, 1, 2], [1, 0, 3]))
        turned = np.zeros((len(one), 4, 3, 3))  # of n1 - n2, (corner, component of the place, component)
        turned[:, [0, 1, 2]] += first
        turned[:, [1, 0, 3]] -= second
        weight = self.cloth.bend * (self.cloth.side * self.lattice.columns) ** 2 * self.sizes
        slope = np.einsum("h,hcak,hk->hca", 2 * weight, turned, one - other)
        flat = turned.reshape(len(one), 12, 3)
        return self.hinges, slope, 2 * weight[:, None, None] * (flat @ np.swapaxes(flat, 1, 2))

    def _collision(self, places: Array, convex: bool) -> tuple[Whole, Array, Array]:
        assert self.case.body is not None
        distance, normal = self.case.body.contact(places)
        met = np.nonzero(distance < 0)[0]
        depth, normal = distance[met], normal[met]
        weight = (2 * CORNERS * self.cloth.collision * self.share[met])[:, None]
        outer = normal[:, :, None] * normal[:, None, :]
        if not convex and self.case.body.is_exact:
            outer = outer + depth[:, None, None] * self.case.body.curvature(places[met])
        return met[:, None], (weight * depth[:, None] * normal)[:, None], weight[:, :, None] * outer

    def span(self) -> tuple[Sparse, Array]:
        """Return the sparse map (3 n, k) from free unknowns to places, and the displacement (n, 3) of the pins."""
        points = self.lattice.points
        given, values = np.zeros((len(points), 3), dtype=bool), np.zeros((len(points), 3))
        given[:, ["xyz".index(axis) for axis in self.cloth.confined]] = True
        for pin in self.case.pins:
            held = np.zeros(len(points), dtype=bool)
            for edge in pin.on:
                if self.case.disc:
                    held |= self.case.disc.level(points) < ON_RIM
                else:
                    held |= points[:, "uv".index(edge[0])] == float(edge.endswith("max"))
            for point in pin.at:
                apart = np.linalg.norm(points - point, axis=1)
                if apart.min() > 1e-9:
                    raise InputError(f"{self.case.name}: the pinned point {point} is no vertex of this mesh")
                held[apart.argmin()] = True
            given[held] = True
            values[held] = evaluated(pin.displacement, points[held])
        return identity(given.size, format="csc")[:, ~given.ravel()], values

    def harmonic_extension(self, span: Sparse, values: Array) -> Array:
        """Return places (n, 3) whose displacement extends that of moved pins, each edge a spring of its cotangents.

        The extension is harmonic (Pinkall and Polthier 1993), and affine if the pins' displacement is.
        """
        if not np.any(values):
            return self.rest
        points, triangles = self.lattice.points, self.lattice.triangles
        stiffness: Any = 0
        for corner in range(3):
            i, j, k = (triangles[:, (corner + n) % 3] for n in range(3))
            one, other = points[i] - points[k], points[j] - points[k]
            weight = np.sum(one * other, axis=1) / cross(one, other) / 2
            entries = np.concatenate([weight, weight, -weight, -weight])
            rows, columns = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
            stiffness = stiffness + coo_matrix((entries, (rows, columns)), shape=(len(points),) * 2)
        whole = kron(stiffness.tocsr(), identity(3))
        anchor = ANCHOR * identity(span.shape[1])  # of vertices that no pin moves
        found = factorised(span.T @ whole @ span + anchor).solve(-(span.T @ (whole @ values.ravel())))
        return np.asarray(self.rest + values + (span @ found).reshape(-1, 3))

    def minimise_energy(self) -> Iterator[tuple[float, Array]]:
        """Yield energy and places (n, 3) after each step, until the energy is least; SolveFailure if it is not."""
        span, values = self.span()
        places = self.harmonic_extension(span, values)
        damping = span.T @ diags(DAMPING * np.repeat(self.share, 3)) @ span
        convex = True
        far = EPSILON * float(np.abs(places).max()) * self.lattice.columns  # strain that rounding of places leaves
        idle = 3 * self.cloth.strain * far**2
        for _ in range(MOST):
            energy = self.energy(places)
            gradient, hessian = self.slopes(places, convex)
            factors = factorised(span.T @ hessian @ span + (damping if convex else 0 * damping))
            step = (span @ factors.solve(-(span.T @ gradient.ravel()))).reshape(-1, 3)
            slope = float(np.sum(step * gradient))
            if slope > idle:
                convex = True
                continue
            if -slope <= SMALL * (abs(energy) - slope) + idle:
                if self.case.body is None and indefinite(span.T @ self.slopes(places, False)[1] @ span + damping):
                    raise SolveFailure("the mesh rests at a saddle of the energy: the sheet would buckle from there")
                yield self.energy(places + step), places + step
                return
            share = min(1.0, FARTHEST / float(np.abs(step).max()))
            while self.energy(places + share * step) > energy:
                share /= 2
                if share < 1e-9:
                    raise SolveFailure("Newton's method finds no step that lowers the energy of the mesh")
            convex = not (share == 1.0 and -slope <= NEAR * abs(energy))
            places = places + share * step
            yield self.energy(places), places
        raise SolveFailure(f"the energy of the mesh has not settled after {MOST} steps of Newton's method")


def factorised(matrix: Sparse) -> Any:
    """Return the factors of a symmetric matrix, eliminated without exchange of rows."""
    ordered = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    return splu(matrix.tocsc(), **ordered)


def indefinite(matrix: Sparse) -> bool:
    """Return True if a symmetric matrix has negative eigenvalues beyond rounding, counted by its pivots."""
    pivots = factorised(matrix).U.diagonal()
    return bool(pivots.min() < -INDEFINITE * pivots.max())


def normals(places: Array, faces: Whole) -> tuple[Array, Array]:
    """Return unit normals (n, 3) of faces (n, 3), and their derivatives (n, 3, 3, 3) in places of corners.

    A corner that moves by d out of the face tilts it about the opposite edge e: n changes by (e x n)(n . d) / |2 A|.
    """
    a, b, c = (places[faces[:, corner]] for corner in range(3))
    plain = np.cross(b - a, c - a)
    size = np.linalg.norm(plain, axis=1, keepdims=True)
    normal = plain / size
    tilts = np.stack([np.cross(edge, normal) / size for edge in (c - b, a - c, b - a)], axis=1)
    return normal, normal[:, None, :, None] * tilts[:, :, None, :]
