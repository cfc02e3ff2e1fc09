"""Multifrontal factorisation on the nested dissection of a tensor mesh.

A tensor mesh has a good elimination order: halve the rectangle by a line of nodes, again and again, and eliminate the
halves before the line (George 1973). Each part is then one dense matrix, a *front*, of the nodes that it eliminates and
of the ring of nodes around it. The elimination leaves a Schur complement on the ring, which is added to the front of
the parent (Duff & Reid 1983; Liu 1992). Dense LAPACK does all the work on a few large blocks, which on a shell of
100,000 unknowns takes a seventh of the time of a general sparse LU.

George (1973), Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10.
Duff & Reid (1983), The multifrontal solution of indefinite sparse symmetric linear equations, ACM TOMS 9.
Liu (1992), The multifrontal method for sparse matrix solution: theory and practice, SIAM Review 34.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Range = tuple[int, int]

LEAF_NODES = 8  # a part with at most so many nodes is not halved any more (measured: 4 to 16 make no difference)


@dataclass(frozen=True)
class Part:
    """One step of the elimination: nodes by their place in the elimination order.

    Attributes
    ----------
    own
        First and last + 1 of the nodes that it eliminates; they are consecutive.
    ring
        Nodes around the region that is eliminated up to this part, increasing.
    children
        Parts, by number, whose Schur complements it takes.
    """

    own: Range
    ring: Integers
    children: tuple[int, ...]


class Run(NamedTuple):
    """Consecutive nodes of a ring, from `start` up to `stop`, and the place of the first one in the front above."""

    start: int
    stop: int
    place: int


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
    def from_shape(cls, shape: tuple[int, int], periodic: tuple[bool, bool], every: int = 1) -> Dissection:
        """Dissect a mesh with this many nodes along each coordinate; every `every`-th line may be a separator."""
        # 1. Halve the rectangle; the regions come in postorder, so that children stand before their parent.
        # 2. Number the nodes in that order: `rank` inverts `order`.
        # 3. Give each region its ring, and the open parts on the stack as its children.
        # This step is symbolic: it uses the mesh's shape, and no number of the matrix.
        regions = list(_halve((0, shape[0]), (0, shape[1]), periodic, every))
        numbers = np.arange(shape[0] * shape[1]).reshape(shape)
        order = np.concatenate([region.own_nodes(numbers) for region in regions])
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        parts: list[Part] = []
        open_parts: list[int] = []
        start = 0
        for region in regions:
            stop = start + len(region.own_nodes(numbers))
            # A node couples to the eight around it, so one line of nodes, corners included, separates.
            # The part's own nodes and all below it have ranks less than `stop`, and drop out.
            ring = np.unique(rank[region.surroundings(numbers, periodic)])
            children = tuple(open_parts[len(open_parts) - region.children :])
            del open_parts[len(open_parts) - region.children :]
            open_parts.append(len(parts))
            parts.append(Part((start, stop), ring[ring >= stop], children))
            start = stop
        return cls(order, tuple(parts))

    @cached_property
    def runs(self) -> tuple[tuple[tuple[Run, ...], ...], ...]:
        """By part and by child: the places of the child's ring in the part's front, as runs of consecutive places.

        A run ends with the part's own unknowns too.
        """
        # Newton's method factorises on one mesh again and again: the symbolic data of the mesh are cached.
        return tuple(
            tuple(tuple(_runs(part, self.parts[child].ring)) for child in part.children) for part in self.parts
        )


def _runs(part: Part, ring: Integers) -> Iterator[Run]:
    size, place = part.own[1] - part.own[0], places_in_front(part, ring)
    breaks = np.flatnonzero((np.diff(place) != 1) | (place[1:] == size)) + 1
    for start, stop in pairwise([0, *breaks.tolist(), len(place)]):
        if start < stop:
            yield Run(start, stop, int(place[start]))


def places_in_front(part: Part, nodes: Integers) -> Integers:
    """Return the places of nodes in the front of a part: its own first, then its ring."""
    start, stop = part.own
    return np.where(nodes < stop, nodes - start, stop - start + np.searchsorted(part.ring, nodes))


@dataclass(frozen=True)
class _Region:
    """A rectangle of nodes, and the lines of it that are eliminated after its inside."""

    first: Range
    second: Range
    lines: tuple[tuple[int, int], ...]  # (axis, index); none for a rectangle that is eliminated whole
    children: int

    def own_nodes(self, numbers: Integers) -> Integers:
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
            # On a closed coordinate the neighbour of the first line is the last one.
            wide = np.arange(start - 1, stop + 1)
            count = numbers.shape[axis]
            index.append(wide % count if periodic[axis] else wide[(wide >= 0) & (wide < count)])
        return numbers[np.ix_(*index)].ravel()


def _halve(first: Range, second: Range, seams: tuple[bool, bool], every: int) -> Iterator[_Region]:
    """Yield the parts of a rectangle, inside before separating lines; seams of closed coordinates are cut first."""
    lengths = (first[1] - first[0], second[1] - second[0])
    # George halves a rectangle. A closed coordinate has no ends, so its seam is cut first and eliminated last.
    # On a torus both seams make one separator.
    if any(seams):
        lines = tuple((axis, 0) for axis in (0, 1) if seams[axis])
        inner = [(start + seam, stop) for (start, stop), seam in zip((first, second), seams, strict=True)]
        yield from _halve(inner[0], inner[1], (False, False), every)
        yield _Region(first, second, lines, children=1)
    # George continues to single nodes. A few nodes of 12 unknowns each are already a block that suits LAPACK.
    elif lengths[0] * lengths[1] <= LEAF_NODES * every or max(lengths) < 2 * every + (every < 2):
        yield _Region(first, second, (), children=0)
    # The line runs across the longer side: it is the shortest separator, and the largest fronts stay small.
    elif lengths[0] >= lengths[1]:
        middle = sum(first) // 2 // every * every
        yield from _halve((first[0], middle), second, seams, every)
        yield from _halve((middle + 1, first[1]), second, seams, every)
        yield _Region(first, second, ((0, middle),), children=2)
    else:
        middle = sum(second) // 2 // every * every
        yield from _halve(first, (second[0], middle), seams, every)
        yield from _halve(first, (middle + 1, second[1]), seams, every)
        yield _Region(first, second, ((1, middle),), children=2)
