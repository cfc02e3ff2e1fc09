"""Grids that are solved for: what a grid without layers displaces is linear in its coefficients.

A function is matched by least squares along one axis after the other. Losses of local structures are minimised by
Newton's method: the Hessian is exact for strain, that of Gauss and Newton for bending.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bmat, diags
from scipy.sparse.linalg import spsolve

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.field.case import Cloth, FieldCase
from shellbench.problems.field.formulas import evaluated
from shellbench.problems.field.quantities import AXES, along_edge
from shellbench.problems.field.structure import EDGES, MIDDLE, OUTER, TURN, corners, lattice, weighted
from shellbench.solvers.field.basis import Sparse, along, matrix
from shellbench.solvers.field.field import LayeredField
from shellbench.solvers.field.sampling import Cells, positive

Array = NDArray[np.float64]
Blocks = dict[tuple[int, int], Array]

MOST_STEPS = 50  # of Newton's method
SMALL = 1e-12  # relative: change of the energy at which it ends
HALVINGS = 30  # of a step that does not lower the energy
PLAYS = 12  # of the two players: density, then minimiser
STEADY = 1e-10  # by which the density still moves when they end
PER_CELL = 4  # samples of a match along a cell
GAUSS = {1: 2, 3: 3}  # points of a cell along a side, by degree: midpoints alone let splines gain at the edges
GOLDEN_TURN = TURN * 0.6180339887498949  # orientations of neighbours: no two alike


def form_of(cells: int, degree: int, confined: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the form of a field of one level without layers."""
    none = {"frequencies": 0, "layers": 0, "activation": "relu", "held": []}
    return {"cells": [cells], "degree": degree, "confined": list(confined), **none}


def matched(case: FieldCase, cells: int, degree: int) -> LayeredField:
    """Return the grid that is nearest to the function on a lattice of points."""
    assert case.match is not None
    count = PER_CELL * cells
    inverse = np.linalg.pinv(along((np.arange(count) + 0.5) / count, cells, degree).toarray())
    values = evaluated(case.match.function, lattice(count)).reshape(count, count, 3)
    found = np.einsum("ia,jb,abk->ijk", inverse, inverse, values, optimize=True)
    return LayeredField(case, {"grid_0": found.reshape(-1, 3)}, form_of(cells, degree))


@dataclass(frozen=True)
class Sampled:
    """Structures at sample points, as matrices of a grid's coefficients: one for each corner, and the middles'.

    Attributes
    ----------
    triangles, stars
        Of the three corners that strain looks at, and of the six that bending does; none of what has no weight.
    flat, rest
        Rest places (n, 3, 3) of the triangles and (n, 6, 3) of the stars.
    """

    cloth: Cloth
    triangles: tuple[Sparse, ...]
    stars: tuple[Sparse, ...]
    flat: Array
    rest: Array
    middles: Sparse
    heights: Array
    weights: Array

    @classmethod
    def of(cls, case: FieldCase, cells: int, degree: int, points: Array, weights: Array) -> Sampled:
        """Return the structures about points (n, 2) whose losses have weights (n,)."""
        assert case.cloth is not None
        angles: Array = np.arange(len(points), dtype=float) * GOLDEN_TURN % TURN

        cloth = case.cloth

        def of_corners(count: int) -> tuple[tuple[Sparse, ...], Array]:
            at = corners(points, angles, cloth.side, count, *([True] if cloth.past_edges else []))
            rest = np.stack([case.rest(at[:, corner]) for corner in range(count)], axis=1)
            return tuple(matrix(at[:, corner], cells, degree) for corner in range(count)), rest

        triangles, flat = of_corners(3)
        stars, rest = of_corners(6) if case.cloth.bend else ((), np.zeros((len(points), 0, 3)))
        heights = case.rest(points)[:, 2]
        return cls(case.cloth, triangles, stars, flat, rest, matrix(points, cells, degree), heights, weights)

    @property
    def axes(self) -> list[int]:
        """Numbers of the components that are free."""
        return [number for number, axis in enumerate(AXES) if axis not in self.cloth.confined]

    def energy(self, coefficients: Array) -> float:
        """Return the weighted mean of all losses for coefficients (m, 3)."""
        return self.taken(coefficients, order=0)[0]

    def taken(self, coefficients: Array, order: int = 2) -> tuple[float, Array, Sparse]:
        """Return the energy, its gradient (m, 3) and its Hessian, component by component of those that are free.

        With `order` 0 gradient and Hessian are empty.
        """
        axes = self.axes
        drop = self.cloth.gravity * self.cloth.mass_gravity * self.weights
        energy = float(drop @ (self.heights + self.middles @ coefficients[:, 2]))
        gradient = np.zeros_like(coefficients)
        gradient[:, 2] = self.middles.T @ drop
        hessian: list[list[Any]] = [[None] * len(axes) for _ in axes]

        def add(matrices: list[Sparse], value: Array, slopes: Array, blocks: Array) -> None:
            """Add a loss (n,) with its slopes (n, c, 3) and second derivatives (n, c, 3, d, 3) in c vectors."""
            nonlocal energy
            energy += float(self.weights @ value)
            if not order:
                return
            for c, one in enumerate(matrices):
                gradient[:] += one.T @ (self.weights[:, None] * slopes[:, c])
                for d, other in enumerate(matrices):
                    for row, a in enumerate(axes):
                        for column, b in enumerate(axes):
                            part, there = (
                                one.T @ diags(self.weights * blocks[:, c, a, d, b]) @ other,
                                hessian[row][column],
                            )
                            hessian[row][column] = part if there is None else there + part

        for i, j in EDGES if self.cloth.strain else ():
            edge, resting = self.triangles[j] - self.triangles[i], self.flat[:, j] - self.flat[:, i]
            value, slope, second = stretched(resting + edge @ coefficients, np.linalg.norm(resting, axis=1))
            parts = (self.cloth.strain * part for part in (value, slope[:, None], second[:, None, :, None]))
            add([edge], *parts)
        places = np.stack([m @ coefficients for m in self.stars], axis=1) + self.rest if self.stars else self.rest
        for face in OUTER if self.stars else ():
            numbers = [*MIDDLE, next(corner for corner in face if corner > 2)]
            value, slope, second = bent(places, face, numbers)
            add([self.stars[n] for n in numbers], *(self.cloth.bend * p for p in (value, slope, second)))
        return energy, gradient, bmat(hessian, format="csr") if order else None


def stretched(edge: Array, rest: Array) -> tuple[Array, Array, Array]:
    """Return (l/L - 1)^2 (n,) of edges (n, 3) with rest lengths (n,), its gradient (n, 3) and Hessian (n, 3, 3)."""
    length = np.linalg.norm(edge, axis=1)
    along_it = edge / length[:, None]
    excess = length / rest - 1
    outer = along_it[:, :, None] * along_it[:, None, :]
    across = np.eye(3) - outer
    second = 2 / rest[:, None, None] ** 2 * (outer + (1 - rest / length)[:, None, None] * across)
    return excess**2, 2 * (excess / rest)[:, None] * along_it, second


def normal_with_slopes(places: Array, face: tuple[int, int, int], numbers: list[int]) -> tuple[Array, Array]:
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


def bent(places: Array, face: tuple[int, int, int], numbers: list[int]) -> tuple[Array, Array, Array]:
    """Return |n1 - n2|^2 (n,) of the middle face and another, its gradient, and twice the square of the slopes."""
    one, one_slopes = normal_with_slopes(places, MIDDLE, numbers)
    other, other_slopes = normal_with_slopes(places, face, numbers)
    apart, slopes = one - other, one_slopes - other_slopes
    gradient = 2 * np.einsum("ni,nica->nca", apart, slopes)
    return np.sum(apart**2, axis=1), gradient, 2 * np.einsum("nica,nidb->ncadb", slopes, slopes)


def gauss(cells: int, count: int) -> tuple[Array, Array]:
    """Return Gauss points (n, 2) of equal cells, so many along a side of each, and their areas (n,)."""
    places, weights = np.polynomial.legendre.leggauss(count)
    x = ((np.arange(cells)[:, None] + (places + 1) / 2) / cells).ravel()
    lengths = np.tile(weights / (2 * cells), cells)
    points = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    return points, np.outer(lengths, lengths).ravel()


def held(case: FieldCase, cells: int, degree: int) -> tuple[NDArray[np.bool_], Array]:
    """Return which coefficients (m, 3) are given, and their values (m, 3): those of pinned edges."""
    side = cells + degree
    given, values = np.zeros((side, side, 3), dtype=bool), np.zeros((side, side, 3))
    for component in case.cloth.confined if case.cloth else ():
        given[..., AXES.index(component)] = True
    for pin in case.pins:
        for edge in pin.on:
            axis, end = "uv".index(edge[0]), -1 if edge.endswith("max") else 0
            place: Any = (end, slice(None)) if axis == 0 else (slice(None), end)
            points = along_edge(edge, PER_CELL * cells)
            splines = along(points[:, 1 - axis], cells, degree).toarray()
            values[place] = np.linalg.lstsq(splines, evaluated(pin.displacement, points), rcond=None)[0]
            given[place] = True
    return given.reshape(-1, 3), values.reshape(-1, 3)


def least(case: FieldCase, sampled: Sampled, start: Array, given: NDArray[np.bool_]) -> Iterator[tuple[float, Array]]:
    """Yield energy and coefficients after each step of Newton's method, until the energy is least.

    Raises
    ------
    SolveFailure
        If steps do not lower it, or it has not settled.
    """
    axes = sampled.axes
    free = ~given[:, axes].T.ravel()  # the Hessian goes component by component
    coefficients = start
    for _ in range(MOST_STEPS):
        energy, gradient, hessian = sampled.taken(coefficients)
        found = np.zeros(free.shape)
        found[free] = spsolve(hessian[free][:, free].tocsc(), -gradient[:, axes].T.ravel()[free])
        step = np.zeros_like(coefficients)
        step[:, axes] = found.reshape(len(axes), -1).T
        if not np.all(np.isfinite(step)):
            raise SolveFailure("the losses leave some of the field undetermined: pins are missing, or samples")
        slope = float(np.sum(step * gradient))
        if abs(slope) <= SMALL * (abs(energy) + abs(slope)):
            yield sampled.energy(coefficients + step), coefficients + step
            return
        for _ in range(HALVINGS):
            if sampled.energy(coefficients + step) <= energy:
                break
            step = step / 2
        else:
            raise SolveFailure("Newton's method finds no step that lowers the energy")
        coefficients = coefficients + step
        yield sampled.energy(coefficients), coefficients
    raise SolveFailure(f"the energy has not settled after {MOST_STEPS} steps of Newton's method")


@dataclass(frozen=True)
class Play:
    """How samples of a minimisation are weighed: evenly, or by a density that follows the losses.

    With `share` above 0 that part of samples follows the density of `cells` along a side. Unless `weighted`, losses
    count as often as they are sampled, as the paper has it; that is the mean over all draws.
    """

    share: float
    weighted: bool
    cells: int


def minimised(
    case: FieldCase, cells: int, degree: int, play: Play, progress: ProgressCallback, count: int | None = None
) -> LayeredField:
    """Return the grid of least energy on so many Gauss points of a cell along a side, None for those of its degree.

    With a density that follows the losses, where both players rest.
    """
    assert case.cloth is not None
    began, history = time.perf_counter(), list[Step]()
    points, areas = gauss(cells, count or GAUSS[degree])
    given, start = held(case, cells, degree)
    form = form_of(cells, degree, case.cloth.confined)
    middles, shares = lattice(play.cells), np.ones((play.cells, play.cells))
    plays = 0
    for _ in range(PLAYS if play.share else 1):
        plays += 1
        density = play.share * Cells(shares).density(points) + 1 - play.share
        ones = np.ones(len(points)) if play.weighted else density
        sampled = Sampled.of(case, cells, degree, points, areas * ones)
        for energy, coefficients in least(case, sampled, start, given):
            history.append(Step(len(history), time.perf_counter() - began, energy, int((~given).sum())))
            progress(Progress(len(history), None, f"energy {energy:.6g}"))
            start = coefficients
        found = LayeredField(case, {"grid_0": start}, form, tuple(history))
        losses = positive(weighted(found.losses(middles), case.cloth.weights)).reshape(shares.shape)
        before, shares = shares, losses / losses.mean()
        if np.abs(shares - before).max() <= STEADY * shares.max():
            break
    pictures = {"points": points, "density": shares} if play.share else {}
    return LayeredField(case, found.tensors, form, tuple(history), diagnostics={"plays": plays}, pictures=pictures)
