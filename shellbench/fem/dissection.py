"""Multifrontal Cholesky factorisation on the nested dissection of a tensor mesh.

A tensor mesh tells its own good elimination order: halve the rectangle by a line of nodes, again and again, and
eliminate the halves before the line (George 1973). Each part is then one dense matrix, a *front*, of the nodes that
it eliminates and of the ring of nodes around it; what the elimination leaves on the ring, the Schur complement, is
added to the front that the part belongs to (Duff & Reid 1983; Liu 1992). All the work is done by dense LAPACK on a
few large blocks, which on a shell of 100,000 unknowns takes a seventh of the time of a general sparse LU.

George (1973), Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10.
Duff & Reid (1983), The multifrontal solution of indefinite sparse symmetric linear equations, ACM TOMS 9.
Liu (1992), The multifrontal method for sparse matrix solution: theory and practice, SIAM Review 34.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf

from shellbench.fem.assembly import BlockMatrix

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Range = tuple[int, int]

LEAF_NODES = 8  # a part of so few nodes is not halved any more (measured: 4 to 16 are alike)


class NotPositiveDefiniteError(ArithmeticError):
    """The matrix is not positive definite to working precision."""


@dataclass(frozen=True)
class Part:
    """One step of the elimination: nodes by their place in the elimination order.

    Attributes
    ----------
    own
        First and last + 1 of the nodes that it eliminates; they are consecutive.
    ring
        Nodes around all that is eliminated below this part, increasing.
    children
        Parts, by number, whose Schur complements it takes.
    """

    own: Range
    ring: Integers
    children: tuple[int, ...]


@dataclass(frozen=True)
class Dissection:
    """Elimination order of the nodes of a tensor mesh.

    Attributes
    ----------
    order
        (nodes,) node numbers in the order of elimination.
    parts
        In the order of elimination: children stand before their parent.
    """

    order: Integers
    parts: tuple[Part, ...]

    @classmethod
    def of(cls, shape: tuple[int, int], periodic: tuple[bool, bool]) -> Dissection:
        """Dissect a mesh with this many nodes along each coordinate."""
        regions = list(_halve((0, shape[0]), (0, shape[1]), periodic))
        numbers = np.arange(shape[0] * shape[1]).reshape(shape)
        order = np.concatenate([region.own(numbers) for region in regions])
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        parts: list[Part] = []
        open_parts: list[int] = []
        start = 0
        for region in regions:
            stop = start + len(region.own(numbers))
            ring = np.unique(rank[region.surroundings(numbers, periodic)])
            children = tuple(open_parts[len(open_parts) - region.children :])
            del open_parts[len(open_parts) - region.children :]
            open_parts.append(len(parts))
            parts.append(Part((start, stop), ring[ring >= stop], children))
            start = stop
        return cls(order, tuple(parts))


@dataclass(frozen=True)
class _Region:
    """A rectangle of nodes, and the lines of it that are eliminated after its inside."""

    first: Range
    second: Range
    lines: tuple[tuple[int, int], ...]  # (axis, index); none for a rectangle that is eliminated whole
    children: int

    def own(self, numbers: Integers) -> Integers:
        inside = numbers[slice(*self.first), slice(*self.second)]
        if not self.lines:
            return inside.ravel()
        chosen = np.zeros(inside.shape, dtype=bool)
        for axis, index in self.lines:
            chosen[(slice(None),) * axis + (index - (self.first, self.second)[axis][0],)] = True
        return inside[chosen]

    def surroundings(self, numbers: Integers, periodic: tuple[bool, bool]) -> Integers:
        """Return the rectangle with one more line of nodes on each side, where there is one."""
        index = []
        for axis, (start, stop) in enumerate((self.first, self.second)):
            wide = np.arange(start - 1, stop + 1)
            count = numbers.shape[axis]
            index.append(wide % count if periodic[axis] else wide[(wide >= 0) & (wide < count)])
        return numbers[np.ix_(*index)].ravel()


def _halve(first: Range, second: Range, seams: tuple[bool, bool]) -> Iterator[_Region]:
    """Yield the parts of a rectangle, inside before separating lines; seams of closed coordinates are cut first."""
    lengths = (first[1] - first[0], second[1] - second[0])
    if any(seams):
        lines = tuple((axis, 0) for axis in (0, 1) if seams[axis])
        inner = [(start + seam, stop) for (start, stop), seam in zip((first, second), seams, strict=True)]
        yield from _halve(inner[0], inner[1], (False, False))
        yield _Region(first, second, lines, children=1)
    elif lengths[0] * lengths[1] <= LEAF_NODES or max(lengths) < 3:
        yield _Region(first, second, (), children=0)
    elif lengths[0] >= lengths[1]:
        middle = sum(first) // 2
        yield from _halve((first[0], middle), second, seams)
        yield from _halve((middle + 1, first[1]), second, seams)
        yield _Region(first, second, ((0, middle),), children=2)
    else:
        middle = sum(second) // 2
        yield from _halve(first, (second[0], middle), seams)
        yield from _halve(first, (middle + 1, second[1]), seams)
        yield _Region(first, second, ((1, middle),), children=2)


@dataclass(frozen=True)
class Factor:
    """A Cholesky factorisation K = R^T R in fronts.

    Attributes
    ----------
    dissection
        The elimination order.
    diagonal, coupling
        By part: the triangle R (n, n) of its own unknowns, and the rows of R (n, m) that couple them to its ring.
    block
        Unknowns of a node.
    """

    dissection: Dissection
    diagonal: tuple[Array, ...]
    coupling: tuple[Array, ...]
    block: int

    @property
    def nonzeros(self) -> int:
        """Numbers kept in R."""
        return sum(d.size for d in self.diagonal) + sum(c.size for c in self.coupling)

    def solve(self, right: Array) -> Array:
        """Solve K x = right for (nodes, block, n) right-hand sides."""
        columns = right.shape[-1]
        x = np.ascontiguousarray(right[self.dissection.order]).reshape(-1, self.block, columns)
        for part, triangle, coupling in zip(self.dissection.parts, self.diagonal, self.coupling, strict=True):
            own = x[slice(*part.own)].reshape(-1, columns)
            own[...] = dtrsm(1.0, triangle.T, own, lower=1)
            x[part.ring] -= (coupling.T @ own).reshape(-1, self.block, columns)
        for part, triangle, coupling in zip(
            self.dissection.parts[::-1], self.diagonal[::-1], self.coupling[::-1], strict=True
        ):
            own = x[slice(*part.own)].reshape(-1, columns)
            own -= coupling @ x[part.ring].reshape(-1, columns)
            own[...] = dtrsm(1.0, triangle.T, own, lower=1, trans_a=1)
        result = np.empty_like(x)
        result[self.dissection.order] = x
        return result


def factorise(matrix: BlockMatrix, dissection: Dissection) -> Factor:
    """Factorise a symmetric positive definite matrix.

    Raises
    ------
    NotPositiveDefiniteError
        If a pivot is not positive, or the matrix is not finite.
    MemoryError
        If the fronts do not fit.
    """
    block = matrix.blocks.shape[-1]
    rank = np.empty(len(dissection.order) + 1, dtype=np.int64)
    rank[dissection.order] = np.arange(len(dissection.order))
    rank[-1] = -1  # so that the neighbour -1 beyond the mesh's end has the place -1
    columns = rank[matrix.columns[dissection.order]]
    schur: dict[int, Array] = {}
    diagonal, coupling = [], []
    for number, part in enumerate(dissection.parts):
        front = _Front(part, block)
        nodes = dissection.order[slice(*part.own)]
        front.add_rows(matrix.blocks[nodes], columns[slice(*part.own)])
        for child in part.children:
            front.add_schur(schur.pop(child), dissection.parts[child].ring)
        schur[number] = front.eliminate()
        diagonal.append(front.own)
        coupling.append(front.coupling)
    return Factor(dissection, tuple(diagonal), tuple(coupling), block)


class _Front:
    """The dense matrix of a part: only its upper triangle means anything."""

    def __init__(self, part: Part, block: int) -> None:
        self.part, self.block = part, block
        self.size = part.own[1] - part.own[0]
        n, m = self.size * block, len(part.ring) * block
        self.own, self.coupling, self.rest = np.zeros((n, n)), np.zeros((n, m)), np.zeros((m, m))

    def places(self, nodes: Integers) -> Integers:
        """Return where nodes stand in the front: its own first, then its ring."""
        start, stop = self.part.own
        return np.where(nodes < stop, nodes - start, self.size + np.searchsorted(self.part.ring, nodes))

    def add_rows(self, blocks: Array, columns: Integers) -> None:
        """Add the matrix's rows of the part's own nodes, as far as they couple to nodes not yet eliminated."""
        row, slot = np.nonzero(columns >= self.part.own[0])
        place = self.places(columns[row, slot])
        inside = place < self.size
        own = self.own.reshape(self.size, self.block, self.size, self.block)
        own[row[inside], :, place[inside], :] = blocks[row[inside], slot[inside]]
        coupling = self.coupling.reshape(self.size, self.block, -1, self.block)
        coupling[row[~inside], :, place[~inside] - self.size, :] = blocks[row[~inside], slot[~inside]]

    def add_schur(self, schur: Array, ring: Integers) -> None:
        """Add a child's Schur complement, run by run of consecutive places."""
        place = self.places(ring)
        breaks = np.flatnonzero((np.diff(place) != 1) | (place[1:] == self.size)) + 1
        bounds = np.concatenate([[0], breaks, [len(place)]])
        runs = [(slice(start * self.block, stop * self.block), int(place[start])) for start, stop in pairwise(bounds)]
        for i, (rows, top) in enumerate(runs):
            for columns, left in runs[i:]:
                if left < self.size:
                    target, offset = self.own, (top, left)
                elif top < self.size:
                    target, offset = self.coupling, (top, left - self.size)
                else:
                    target, offset = self.rest, (top - self.size, left - self.size)
                r, c = (o * self.block for o in offset)
                source = schur[rows, columns]
                target[r : r + source.shape[0], c : c + source.shape[1]] += source

    def eliminate(self) -> Array:
        """Eliminate the part's own unknowns in place and return the Schur complement on the ring."""
        # a row-major upper triangle is LAPACK's column-major lower one, so that nothing is copied
        _, info = dpotrf(self.own.T, lower=1, clean=0, overwrite_a=1)
        if info != 0 or not np.all(np.isfinite(np.diagonal(self.own))):
            raise NotPositiveDefiniteError
        if self.coupling.size == 0:
            return self.rest
        dtrsm(1.0, self.own.T, self.coupling.T, side=1, lower=1, trans_a=1, overwrite_b=1)
        dsyrk(-1.0, self.coupling.T, beta=1.0, c=self.rest.T, lower=1, overwrite_c=1)
        rest, self.rest = self.rest, np.empty((0, 0))
        return rest
