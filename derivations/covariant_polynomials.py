r"""Any shell of one patch by tensor calculus, on polynomials over cells that shrink toward the edges.

The metric, Christoffel's symbols and the curvature come from derivatives of the position, up to the third for the
derivative of the curvature, b_ab,c = x,abc . a3 - b_c^l x,l . x,ab. The displacement is u_a g^ab x,b + w a3, and its
strains are those of `hypar_polynomials`. Trial functions are products of those of `strip` on each cell: u_1 and u_2 are
continuous from cell to cell, w with its slope. Cells shrink geometrically toward edges and their corners, where the
error of polynomials of a fixed degree is, so that it falls exponentially with their number.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .hypar_polynomials import ORDERS, covariant_strains, elasticity
from .least_squares import Piece, factors, minimiser
from .linear_splines import Field
from .strip import Strip
from .surface_strains import Array

SHRINK = 0.25
"""Ratio of neighbouring cells toward an edge; with 0.15 degree 8 leaves more of a corner's error than the cuts do."""
KINDS = "h1", "h1", "h2"
"""Continuity of u_1, u_2 and w: of values, or of slopes too."""


def graded(start: float, stop: float, cells: int, ends: tuple[int, int]) -> Array:
    """Equal cells, of which the first and the last are cut so many times, geometrically."""
    plain = np.linspace(start, stop, cells + 1)
    size = (stop - start) / cells
    first = start + size * SHRINK ** np.arange(1, ends[0] + 1)
    last = stop - size * SHRINK ** np.arange(1, ends[1] + 1)
    return np.unique(np.concatenate([plain, first, last]))


@dataclass(frozen=True)
class Line:
    """Piecewise polynomials of one variable."""

    breaks: Array
    degree: int

    @cached_property
    def cells(self) -> list[Strip]:
        """The functions of each cell."""
        return [Strip(a, b, self.degree) for a, b in zip(self.breaks[:-1], self.breaks[1:], strict=True)]

    def count(self, kind: str) -> int:
        """Number of functions."""
        nodes, inner = (1, self.degree - 1) if kind == "h1" else (2, self.degree - 3)
        return nodes * len(self.breaks) + inner * len(self.cells)

    def numbers(self, cell: int, kind: str) -> np.ndarray:
        """Numbers of the functions of a cell: those of its ends, then its own."""
        nodes, inner = (1, self.degree - 1) if kind == "h1" else (2, self.degree - 3)
        own = nodes * len(self.breaks) + inner * cell + np.arange(inner)
        return np.concatenate([nodes * cell + np.arange(2 * nodes), own])

    def held(self, kind: str, first: int, last: int) -> np.ndarray:
        """Numbers of the functions that vanish where so many values are held at the first and the last end."""
        nodes = 1 if kind == "h1" else 2
        return np.concatenate([np.arange(first), nodes * (len(self.breaks) - 1) + np.arange(last)])

    def functions(self, cell: int, at: Array, kind: str) -> Array:
        """Values and two derivatives of the functions of a cell, (3, points, degree + 1)."""
        size, basis = self.degree + 1, self.cells[cell].basis(at)
        return basis[:, :, 0, :size] if kind == "h1" else basis[:, :, 2, 2 * size :]

    def cell_of(self, at: float) -> int:
        """Number of the cell of a place."""
        return int(np.clip(np.searchsorted(self.breaks, at, side="right") - 1, 0, len(self.cells) - 1))


@dataclass(frozen=True)
class Geometry:
    """Operators of the strains (points, 6, 3, 6), inverse metric, tangents and normal (points, 3, 3), area."""

    strains: Array
    inverse: Array
    frame: Array
    area: Array

    @classmethod
    def at(cls, surface: Field, one: Array, two: Array) -> Geometry:
        """Return it at points, from the position alone."""

        def x(*directions: int) -> Array:
            return surface(one, two, directions.count(0), directions.count(1))

        pairs = [[x(a, b) for b in (0, 1)] for a in (0, 1)]
        tangents = np.stack([x(0), x(1)], axis=1)
        normal = np.cross(x(0), x(1))
        area = np.linalg.norm(normal, axis=-1)
        normal /= area[:, None]
        inverse = np.asarray(np.linalg.inv(tangents @ np.swapaxes(tangents, 1, 2)), dtype=np.float64)
        second = np.stack([np.stack(row, axis=1) for row in pairs], axis=1)
        onto = np.einsum("plc,pabc->plab", tangents, second)
        gamma = np.einsum("pml,plab->pmab", inverse, onto)
        b = np.einsum("pabc,pc->pab", second, normal)
        third = np.array([[[np.sum(x(a, m, c) * normal, -1) for c in (0, 1)] for m in (0, 1)] for a in (0, 1)])
        mixed = np.einsum("plm,pmc->pcl", inverse, b)  # b_c^l
        b_slope = np.moveaxis(third, -1, 0) - np.einsum("pcl,plab->pabc", mixed, onto)
        frame = np.concatenate([inverse @ tangents, normal[:, None]], axis=1)
        return cls(covariant_strains(inverse, gamma, b, b_slope), inverse, frame, area)


@dataclass(frozen=True)
class CovariantShell:
    """A patch with its supports and load.

    Attributes
    ----------
    surface : derivatives of the position
    lines : along xi1 and xi2
    held : of u_1, u_2 and w the numbers of values held at both ends of xi1, and of xi2; None if it vanishes everywhere
    young, poisson, thickness : Pa, 1, m
    pull : force per length of xi2 at the end of xi1, N, or none
    push : force per area, Pa, or none
    """

    surface: Field
    lines: tuple[Line, Line]
    held: tuple[tuple[tuple[int, int], tuple[int, int]] | None, ...]
    young: float
    poisson: float
    thickness: float
    pull: Array | None = None
    push: Array | None = None

    @cached_property
    def _starts(self) -> Array:
        sizes = [self.lines[0].count(kind) * self.lines[1].count(kind) for kind in KINDS]
        return np.cumsum([0, *sizes])

    def _numbers(self, i: int, j: int) -> np.ndarray:
        """Numbers of the products of a cell, by component."""
        found = []
        for start, kind in zip(self._starts, KINDS, strict=False):
            first, second = self.lines[0].numbers(i, kind), self.lines[1].numbers(j, kind)
            found.append((start + first[:, None] * self.lines[1].count(kind) + second).ravel())
        return np.concatenate(found)

    @cached_property
    def free(self) -> np.ndarray:
        """True for the functions that the supports leave."""
        found = []
        for kind, held in zip(KINDS, self.held, strict=True):
            left = np.full((self.lines[0].count(kind), self.lines[1].count(kind)), held is not None)
            if held is not None:
                left[self.lines[0].held(kind, *held[0])] = False
                left[:, self.lines[1].held(kind, *held[1])] = False
            found.append(left.ravel())
        return np.concatenate(found)

    def _shapes(self, i: int, j: int, one: Array, two: Array) -> list[Array]:
        """Derivatives (points of one, points of two, 6, functions) of the products of each component."""
        found = []
        for kind in KINDS:
            a, b = self.lines[0].functions(i, one, kind), self.lines[1].functions(j, two, kind)
            products = np.stack([a[m][:, None, :, None] * b[n][None, :, None] for m, n in ORDERS], axis=2)
            found.append(products.reshape(len(one), len(two), 6, -1))
        return found

    def _cell(self, i: int, j: int) -> tuple[Array, Array]:
        """Roots of the energy of a cell, and the work of the load on its functions."""
        (one, v), (two, w) = (self._rule(axis, cell) for axis, cell in ((0, i), (1, j)))
        grid = np.repeat(one, len(two)), np.tile(two, len(one))
        geometry = Geometry.at(self.surface, *grid)
        area = geometry.area * np.outer(v, w).ravel()
        stretching = self.young * self.thickness / (1 - self.poisson**2)
        moduli = elasticity(geometry.inverse, self.poisson) * (stretching * area)[:, None, None]
        upper = np.swapaxes(np.linalg.cholesky(moduli), 1, 2)
        shapes = [s.reshape(len(area), 6, -1) for s in self._shapes(i, j, one, two)]
        strains = np.concatenate([geometry.strains[:, :, c] @ s for c, s in enumerate(shapes)], axis=2)
        bent = self.thickness / np.sqrt(12)
        rows = np.concatenate([upper @ strains[:, :3], bent * (upper @ strains[:, 3:])], axis=1)
        work = np.zeros(strains.shape[2])
        if self.push is not None:
            pushed = area[:, None] * (geometry.frame @ self.push)
            work = np.concatenate([pushed[:, c] @ s[:, 0] for c, s in enumerate(shapes)])
        if self.pull is not None and i == len(self.lines[0].cells) - 1:
            work = work + self._pulled(i, j, two, w)
        return rows.reshape(-1, rows.shape[2]), work

    def _rule(self, axis: int, cell: int) -> tuple[Array, Array]:
        t, weights = np.polynomial.legendre.leggauss(self.lines[axis].degree + 2)
        strip = self.lines[axis].cells[cell]
        return (strip.left + strip.right) / 2 + strip.half_length * t, strip.half_length * weights

    def _pulled(self, i: int, j: int, two: Array, weights: Array) -> Array:
        assert self.pull is not None
        end = self.lines[0].breaks[-1:]
        frame = Geometry.at(self.surface, np.full_like(two, end[0]), two).frame
        pulled = weights[:, None] * (frame @ self.pull)
        return np.concatenate([pulled[:, c] @ s[0, :, 0] for c, s in enumerate(self._shapes(i, j, end, two))])

    @cached_property
    def solved(self) -> tuple[Array, float]:
        """All coefficients, and the strain energy, J."""
        load, strips = np.zeros(len(self.free)), []
        for i in range(len(self.lines[0].cells)):
            strips.append(self._strip(i, load))
        q = minimiser(factors(strips, len(load)), load)
        return q, float(load @ q) / 2

    @property
    def energy(self) -> float:
        """Strain energy, J."""
        return self.solved[1]

    def _strip(self, i: int, load: Array) -> list[Piece]:
        """Unknowns and rows of the cells along a line of xi2; their loads are added."""
        cells = []
        for j in range(len(self.lines[1].cells)):
            numbers, (rows, work) = self._numbers(i, j), self._cell(i, j)
            kept = self.free[numbers]
            np.add.at(load, numbers[kept], work[kept])
            cells.append((numbers[kept], rows[:, kept]))
        return cells

    def displacement(self, one: float, two: float) -> Array:
        """Cartesian displacement (3,) at a point, m."""
        frame = Geometry.at(self.surface, np.array([one]), np.array([two])).frame[0]
        return np.asarray(self.components(one, two)[:, 0] @ frame)

    def strains(self, one: float, two: float) -> tuple[Array, Array]:
        """Strains (6,) at a point, and the tangents (2, 3)."""
        place = np.array([one]), np.array([two])
        operator = Geometry.at(self.surface, *place).strains[0]
        tangents = [self.surface(*place, *order)[0] for order in ((1, 0), (0, 1))]
        return np.einsum("rck,ck->r", operator, self.components(one, two)), np.array(tangents)

    def components(self, one: float, two: float) -> Array:
        """u_1, u_2 and w with their derivatives, (3, 6), at a point."""
        i, j = self.lines[0].cell_of(one), self.lines[1].cell_of(two)
        shapes = self._shapes(i, j, np.array([one]), np.array([two]))
        parts = np.split(self.solved[0][self._numbers(i, j)], np.cumsum([s.shape[-1] for s in shapes])[:-1])
        return np.array([s[0, 0] @ part for s, part in zip(shapes, parts, strict=True)])
