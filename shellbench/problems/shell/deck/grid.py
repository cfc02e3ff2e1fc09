"""A structured mesh on a rectangle of the surface's coordinates; its inner nodes may be moved out of their lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.deck.cells import PLACES, Mesh, Shape
from shellbench.problems.shell.question.places import Edge, Place, Point
from shellbench.problems.shell.symmetry.symmetry import Part

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

ON_NODE = 1e-9  # of a cell's side, by which a point may lie beside a node
SAMPLES = 33  # points a side at which the sides of a part are measured
MOST_ALONG = 16  # times as many cells along a long part as across it
FEWEST_AROUND = 3  # cells around a closed coordinate: with fewer, two would share two sides
SEED = 51  # of the numbers by which nodes are moved


def square_cells(part: Part, across: int) -> tuple[int, int]:
    """Return so many cells across a part and as many along it as make them nearly square."""
    first, second = (np.linspace(low, high, SAMPLES) for low, high in zip(part.lower, part.upper, strict=True))
    x = part.whole.surface.position(np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1))
    lengths = [float(np.linalg.norm(np.diff(x, axis=a), axis=-1).sum(axis=a).mean()) for a in (0, 1)]
    ratio = min(max(1, round(max(lengths) / min(lengths))), MOST_ALONG)
    return (across * ratio, across) if lengths[0] > lengths[1] else (across, across * ratio)


@dataclass(frozen=True)
class Grid:
    """Nodes and cells on a rectangle.

    Attributes
    ----------
    lower, upper
        Bounds of (xi1, xi2).
    closed
        Whether each coordinate closes on itself.
    counts
        Quadrilaterals along xi1 and xi2; triangles are their halves.
    shape
        Of the cells.
    distortion
        By how much inner corners are moved, in sides of a cell; the same numbers each time.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    closed: tuple[bool, bool]
    counts: tuple[int, int]
    shape: Shape = "quad4"
    distortion: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers of cells; InputError."""
        least = tuple(FEWEST_AROUND if turns else 1 for turns in self.closed)
        if any(n < low for n, low in zip(self.counts, least, strict=True)):
            raise InputError(f"field 'cells': found {list(self.counts)}, at least {list(least)} are needed")

    @property
    def order(self) -> int:
        """Steps of the lattice of nodes a cell's side: 2 with nodes in the middle of sides, else 1."""
        return 2 if 0.5 in PLACES[self.shape] else 1

    @property
    def _lattice(self) -> tuple[int, int]:
        return self.order * self.counts[0] + 1, self.order * self.counts[1] + 1

    @cached_property
    def _numbered(self) -> tuple[Mesh, Integers, Integers]:
        """The mesh with its seam twice, the node that each of its nodes is, and the places (m, 2) in the lattice."""
        n1, n2 = self._lattice
        parts = [PLACES[self.shape]]
        if self.shape.startswith("tri"):  # both halves of a square, cut along the diagonal from its first corner
            parts = [PLACES[self.shape] @ turn for turn in (np.array([[1, 0], [1, 1]]), np.array([[1, 1], [0, 1]]))]
        steps = np.concatenate([np.rint(self.order * part).astype(np.int64)[None] for part in parts])
        corners = self.order * np.stack([a.ravel() for a in np.indices(self.counts)], axis=-1)
        at = (corners[:, None, None] + steps).reshape(-1, steps.shape[1], 2)
        used, cells = np.unique(at[..., 0] * n2 + at[..., 1], return_inverse=True)
        lattice = np.stack(np.divmod(used, n2), axis=-1)
        turns = np.array(
            [self.order * n if closed else n1 * n2 for n, closed in zip(self.counts, self.closed, strict=True)]
        )
        once = lattice % turns
        _, merged = np.unique(once[:, 0] * n2 + once[:, 1], return_inverse=True)
        mesh = Mesh(self._coordinates(lattice), cells.reshape(at.shape[:2]), self.shape)
        return mesh, merged.reshape(-1), lattice

    def _coordinates(self, lattice: Integers) -> Array:
        """Return coordinates (m, 2) of places in the lattice: corners moved at random, middles between them."""
        n1, n2 = self.counts
        moves = np.zeros((n1 + 1, n2 + 1, 2))
        if self.distortion:
            drawn = np.random.default_rng(SEED).uniform(-1, 1, moves.shape)
            moves[1:-1, 1:-1] = self.distortion * drawn[1:-1, 1:-1]
        low, high = lattice // self.order, -(-lattice // self.order)
        moved = (moves[low[:, 0], low[:, 1]] + moves[high[:, 0], high[:, 1]]) / 2
        return np.asarray(self.lower + (lattice / self.order + moved) * self.steps)

    @property
    def steps(self) -> Array:
        """(2,) sides of a cell."""
        return np.subtract(self.upper, self.lower) / self.counts

    @property
    def mesh(self) -> Mesh:
        """The mesh in the surface's coordinates; a closed coordinate has its seam twice."""
        return self._numbered[0]

    @property
    def merged(self) -> Integers:
        """(m,) number of the node that each node of `mesh` is."""
        return self._numbered[1]

    @cached_property
    def nodes(self) -> Array:
        """(v, 2) coordinates of the nodes, each once."""
        _, first = np.unique(self.merged, return_index=True)
        return np.asarray(self.mesh.xi[first])

    @cached_property
    def cells(self) -> Integers:
        """(e, k) nodes of each cell."""
        return np.asarray(self.merged[self.mesh.cells])

    def edge(self, axis: int, last: bool) -> Integers:
        """Return the nodes at the lower or upper bound of a coordinate, in order; the seam of a closed one twice."""
        lattice = self._numbered[2]
        on = np.flatnonzero(lattice[:, axis] == (self._lattice[axis] - 1 if last else 0))
        return np.asarray(self.merged[on[np.argsort(lattice[on, 1 - axis])]])

    def node_at(self, xi: ArrayLike) -> int | None:
        """Return the node at a point (2,), or None if it lies on none."""
        size = np.subtract(self.upper, self.lower)
        offset = np.subtract(xi, self.lower)
        place = self.lower + np.where(self.closed, np.mod(offset + ON_NODE * self.steps, size), offset)
        found = int(np.argmin(np.abs(self.nodes - place).max(axis=-1)))
        return found if np.all(np.abs(self.nodes[found] - place) <= 2 * ON_NODE * size) else None

    def nodes_of(self, place: Place) -> Integers:
        """Return the nodes of a place; InputError if a point lies on none."""
        match place:
            case Edge(axis=axis, side=side, between=between):
                on = np.unique(self.edge(axis, side == "max"))
                if between is None:
                    return on
                start, stop = between
                running, slack = self.nodes[on, 1 - axis], ON_NODE * float(self.steps[1 - axis])
                if any(np.abs(running - end).min() > slack for end in between):
                    raise InputError(f"field 'cells': an end of '{place.name}' lies on no node; choose other cells")
                return np.asarray(on[(running >= start - slack) & (running <= stop + slack)])
            case Point(name=name, xi=xi):
                node = self.node_at(xi)
                if node is None:
                    n1, n2 = self.counts
                    raise InputError(
                        f"field 'cells': '{name}' lies on no node of {n1} x {n2} cells; choose other cells"
                    )
                return np.array([node])
        return np.arange(len(self.nodes))
