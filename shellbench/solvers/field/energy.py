"""The energy of a grid of splines as the sum over structures, with its gradient and Hessian in the coefficients.

1. The corners of a structure lie in few cells: the splines that are not zero at any of them form a window, a square of
   as many splines for all structures. `Batch` keeps the splines at corners, densely, by structure.
2. A loss has slopes and second derivatives in the places of corners only. The Hessian is exact for strain and an exact
   body, that of Gauss and Newton for bending. A convex Hessian leaves out the negative parts of compression and
   contact.
3. Corners' Hessians become windows' by two small products a structure. Those of one window are summed, row of windows
   by row, and added to a band: for each spline the blocks with its neighbours. No list of entries is sorted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bmat, csr_matrix, diags

from shellbench.problems.field.body import Body
from shellbench.problems.field.case import Cloth, FieldCase
from shellbench.problems.field.quantities import AXES
from shellbench.problems.field.structure import EDGES, MIDDLE, OUTER, TURN, corners, unit_normals
from shellbench.solvers.field.basis import Sparse, matrix, not_zero

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
Face = tuple[int, int, int]  # numbers of its corners
EPSILON = 64 * float(np.finfo(float).eps)  # relative error of a place, with a margin
GOLDEN_TURN = TURN * 0.6180339887498949  # orientations of neighbours: no two alike


@dataclass(frozen=True)
class Batch:
    """Splines at the corners of structures.

    Attributes
    ----------
    side, width
        Splines along a side, of the grid and of a window.
    low
        First row and column (n, 2) of each structure's window.
    splines
        Of the window, at each corner: (n, c, width^2).
    rest
        Places (n, c, 3) without displacement, m.
    """

    side: int
    width: int
    low: Whole
    splines: Array
    rest: Array

    @classmethod
    def of(cls, case: FieldCase, cells: int, degree: int, at: Array) -> Batch:
        """Return the splines at corners (n, c, 2)."""
        count, many = at.shape[:2]
        found = [not_zero(at[..., axis].ravel(), cells, degree, 0) for axis in (0, 1)]
        numbers = np.stack([number.reshape(count, many, -1) for number, _ in found], axis=2)  # (n, c, 2, degree + 1)
        low, high = numbers.min(axis=(1, 3)), numbers.max(axis=(1, 3))
        width, side = int((high - low).max()) + 1, cells + degree
        low = np.minimum(low, side - width)
        window = np.zeros((2, count, many, width))
        for axis, (_, values) in enumerate(found):
            np.put_along_axis(
                window[axis], numbers[:, :, axis] - low[:, None, axis, None], values.reshape(count, many, -1), 2
            )
        splines = window[0][..., :, None] * window[1][..., None, :]
        if case.disc:
            splines *= case.disc.level(at)[..., None, None]
        rest = case.rest(at.reshape(-1, 2)).reshape(count, many, 3)
        return cls(side, width, low, splines.reshape(count, many, width**2), rest)

    @property
    def numbers(self) -> Whole:
        """Numbers (n, width^2) of the windows' splines."""
        steps = np.arange(self.width)
        rows, columns = (self.low[:, axis, None] + steps for axis in (0, 1))
        return np.asarray((rows[:, :, None] * self.side + columns[:, None, :]).reshape(len(self.low), -1))

    def places(self, coefficients: Array) -> Array:
        """Return the corners' places (n, c, 3)."""
        return np.asarray(self.rest + self.splines @ coefficients[self.numbers])

    def gradient(self, slopes: Array) -> Array:
        """Return the gradient (m, 3) of slopes (n, c, 3) in the corners' places."""
        parts = np.swapaxes(self.splines, 1, 2) @ slopes
        numbers = self.numbers.ravel()
        return np.stack([np.bincount(numbers, parts[..., k].ravel(), self.side**2) for k in range(3)], axis=1)

    def hessian(self, blocks: Array) -> Sparse:
        """Return the Hessian of blocks (n, c, k, c, k) in k components of places: sparse, component by component."""
        (many, k), width, side = blocks.shape[1:3], self.width, self.side
        reach = width - 1  # to the farthest neighbour
        band = np.zeros((2 * reach + 1, 2 * reach + 1, side, side, k, k))
        steps = np.arange(width)
        ahead = (steps - steps[:, None] + reach)[:, :, None, None]  # rows from one spline of a window to another
        order = np.lexsort((self.low[:, 1], self.low[:, 0]))
        for chosen in np.split(order, np.nonzero(np.diff(self.low[order, 0]))[0] + 1):
            rows = int(self.low[chosen[0], 0]) + steps[:, None, None, None]
            columns, starts = np.unique(self.low[chosen, 1], return_index=True)
            splines = self.splines[chosen]
            half = np.swapaxes(splines, 1, 2) @ blocks[chosen].reshape(-1, many, k * many * k)
            half = half.reshape(-1, width**2, k, many, k).swapaxes(3, 4).reshape(-1, width**2 * k * k, many)
            found = np.add.reduceat(half @ splines, starts).reshape(-1, width, width, k, k, width, width)
            found = found.transpose(2, 1, 5, 6, 0, 3, 4)  # column, row, row, column, window, k, k
            for c in steps:  # no two of the rest have the same place
                band[ahead, steps[:, None] - c + reach, rows, columns + c] += found[c]
        return self._sparse(band)

    def _sparse(self, band: Array) -> Sparse:
        """Return the matrix of a band (neighbour's row and column, row, column, k, k)."""
        side, reach = self.side, self.width - 1
        offsets, here = np.arange(-reach, reach + 1), np.arange(side)
        there = here[:, None] + offsets  # (row, neighbour)
        valid = (there >= 0) & (there < side)
        mask = valid[:, None, :, None] & valid[None, :, None, :]
        columns = (there[:, None, :, None] * side + there[None, :, None, :])[mask]
        ends = np.concatenate([[0], np.cumsum(mask.reshape(side**2, -1).sum(axis=1))])

        def block(a: int, b: int) -> Sparse:
            return csr_matrix((band[..., a, b].transpose(2, 3, 0, 1)[mask], columns, ends), shape=(side**2, side**2))

        count = band.shape[-1]
        return bmat([[block(a, b) for b in range(count)] for a in range(count)], format="csr")


@dataclass(frozen=True)
class Sampled:
    """Structures at sample points, and the weights (n,) of their losses.

    Attributes
    ----------
    triangles, stars
        The three corners of strain, and the six of bending and collision; None for a loss without weight.
    middles, heights
        Splines at the points, and their heights at rest.
    """

    cloth: Cloth
    body: Body | None
    triangles: Batch | None
    stars: Batch | None
    middles: Sparse
    heights: Array
    weights: Array

    @classmethod
    def of(cls, case: FieldCase, cells: int, degree: int, points: Array, weights: Array) -> Sampled:
        """Return the structures about points (n, 2) whose losses have weights (n,)."""
        cloth = case.cloth
        assert cloth is not None
        angles: Array = np.arange(len(points), dtype=float) * GOLDEN_TURN % TURN

        def of_corners(count: int) -> Batch:
            return Batch.of(case, cells, degree, corners(points, angles, cloth.side, count, cloth.past_edges))

        triangles = of_corners(3) if cloth.strain else None
        stars = of_corners(6) if cloth.bend or cloth.collision else None
        middles, heights = matrix(points, cells, degree), case.rest(points)[:, 2]
        middles = diags(case.disc.level(points)) @ middles if case.disc else middles
        return cls(cloth, case.body, triangles, stars, middles, heights, weights)

    @property
    def axes(self) -> list[int]:
        """Numbers of the components that are free."""
        return [number for number, axis in enumerate(AXES) if axis not in self.cloth.confined]

    def rounding(self, coefficients: Array) -> float:
        """Return the energy of a rigidly moved sheet by rounding of places."""
        if self.triangles is None:
            return 0.0
        far = float(np.abs(self.triangles.places(coefficients)).max())
        return self.cloth.strain * len(EDGES) * (EPSILON * far / self.cloth.side) ** 2

    def energy(self, coefficients: Array) -> float:
        """Return the weighted mean of all losses for coefficients (m, 3)."""
        return self.derivatives(coefficients, order=0)[0]

    def derivatives(self, coefficients: Array, order: int = 2, convex: bool = False) -> tuple[float, Array, Sparse]:
        """Return the energy, its gradient (m, 3) and its Hessian, component by component of those that are free.

        With `order` 0 gradient and Hessian are empty; with `convex` the Hessian has no negative part.
        """
        axes = self.axes
        drop = self.cloth.gravity * self.cloth.mass_gravity * self.weights
        energy = float(drop @ (self.heights + self.middles @ coefficients[:, 2]))
        gradient = np.zeros_like(coefficients)
        gradient[:, 2] = self.middles.T @ drop
        hessian = None
        for batch, losses in ((self.triangles, self._of_triangles), (self.stars, self._of_stars)):
            if batch is None:
                continue
            places = batch.places(coefficients)
            slopes = np.zeros_like(places)
            blocks = np.zeros((*places.shape, *places.shape[1:])) if order else np.zeros(0)
            for value, numbers, slope, second in losses(places, batch.rest, convex, order):
                energy += float(self.weights @ value)
                if order:
                    slopes[:, numbers] += self.weights[:, None, None] * slope
                    for c, one in enumerate(numbers):
                        for d, other in enumerate(numbers):
                            blocks[:, one, :, other] += self.weights[:, None, None] * second[:, c, :, d]
            if order:
                gradient += batch.gradient(slopes)
                part = batch.hessian(blocks[:, :, axes][..., axes])
                hessian = part if hessian is None else hessian + part
        return energy, gradient, hessian

    def _of_triangles(self, places: Array, rest: Array, convex: bool, order: int) -> Iterator[Any]:
        """Yield each edge's loss (n,), its corners, its slopes (n, 2, 3) and second derivatives (n, 2, 3, 2, 3)."""
        signs = np.array([-1.0, 1.0])
        weight = self.cloth.strain
        for i, j in EDGES:
            resting = np.linalg.norm(rest[:, j] - rest[:, i], axis=1)
            value, slope, second = stretch_loss(places[:, j] - places[:, i], resting, convex)
            slopes = signs[:, None] * slope[:, None]
            seconds = np.einsum("c,d,nab->ncadb", signs, signs, second) if order else second
            yield weight * value, [i, j], weight * slopes, weight * seconds

    def _of_stars(self, places: Array, rest: Array, convex: bool, order: int) -> Iterator[Any]:
        """Yield the same data of each pair of faces, with four corners, and of each corner that meets the body."""
        weight = self.cloth.bend
        for face in OUTER if weight else ():
            numbers = [*MIDDLE, next(corner for corner in face if corner > 2)]
            value, slope, second = bend_loss(places, face, numbers, order)
            yield weight * value, numbers, weight * slope, weight * second
        weight = self.cloth.collision
        for corner in range(places.shape[1]) if weight and self.body else ():
            value, slope, second = depth_loss(places[:, corner], self.body, convex)  # type: ignore[arg-type]
            yield weight * value, [corner], weight * slope[:, None], weight * second[:, None, :, None]


def stretch_loss(edge: Array, rest: Array, convex: bool = False) -> tuple[Array, Array, Array]:
    """Return (l/L - 1)^2 (n,) of edges (n, 3) with rest lengths (n,), its gradient (n, 3) and Hessian (n, 3, 3)."""
    length = np.linalg.norm(edge, axis=1)
    along_it = edge / length[:, None]
    excess = length / rest - 1
    outer = along_it[:, :, None] * along_it[:, None, :]
    tension = 1 - rest / length
    across = (np.maximum(tension, 0) if convex else tension)[:, None, None] * (np.eye(3) - outer)
    second = 2 / rest[:, None, None] ** 2 * (outer + across)
    return excess**2, 2 * (excess / rest)[:, None] * along_it, second


def depth_loss(places: Array, body: Body, convex: bool = False) -> tuple[Array, Array, Array]:
    """Return min(d, 0)^2 (n,) of places (n, 3) at signed distances d, its gradient (n, 3) and Hessian (n, 3, 3)."""
    distance, normal = body.contact(places)
    depth = np.minimum(distance, 0.0)
    outer = normal[:, :, None] * normal[:, None, :]
    second = 2 * (depth < 0)[:, None, None] * outer
    if not convex and body.is_exact:  # the normal turns as a place moves along the body
        second = second + 2 * depth[:, None, None] * body.curvature(places)
    return depth**2, 2 * depth[:, None] * normal, second


def normal_with_slopes(places: Array, face: Face, numbers: list[int]) -> tuple[Array, Array]:
    """Return the unit normal (n, 3) of a face, and its derivative (n, 3, c, 3) in the places of corners."""
    a, b, c = (places[:, corner] for corner in face)
    plain = np.cross(b - a, c - a)
    size = np.linalg.norm(plain, axis=1)[:, None]
    normal = plain / size
    slopes = np.zeros((len(places), 3, len(numbers), 3))
    opposite = {face[0]: c - b, face[1]: a - c, face[2]: b - a}  # d plain = opposite x d corner
    for corner, edge in opposite.items():
        turned = np.stack([np.cross(edge, axis) for axis in np.eye(3)], axis=2) / size[:, :, None]
        slopes[:, :, numbers.index(corner)] = (
            turned - normal[:, :, None] * np.einsum("ni,nia->na", normal, turned)[:, None]
        )
    return normal, slopes


def bend_loss(places: Array, face: Face, numbers: list[int], order: int = 2) -> tuple[Array, Array, Array]:
    """Return |n1 - n2|^2 (n,) of the middle face and another, its gradient, and twice the square of the slopes.

    With `order` 0 the last two are empty.
    """
    if not order:
        apart = unit_normals(places, MIDDLE) - unit_normals(places, face)
        return np.sum(apart**2, axis=1), np.zeros(0), np.zeros(0)
    one, one_slopes = normal_with_slopes(places, MIDDLE, numbers)
    other, other_slopes = normal_with_slopes(places, face, numbers)
    apart, slopes = one - other, (one_slopes - other_slopes).reshape(len(places), 3, -1)
    gradient = 2 * (apart[:, None] @ slopes)[:, 0]
    shape = (len(places), len(numbers), 3)
    second = 2 * (np.swapaxes(slopes, 1, 2) @ slopes)
    return np.sum(apart**2, axis=1), gradient.reshape(shape), second.reshape(*shape, *shape[1:])
