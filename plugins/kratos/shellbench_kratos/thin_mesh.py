"""A structured mesh of quadrilaterals on a rectangle of the surface's coordinates, and what holds and loads its nodes.

The nodes are on the midsurface. Supports hold their displacements and rotations; also here are the rigid motions that
nothing holds.

Loads on the area and on edges are consistent with bilinear displacements, by Gauss' rule on the true midsurface and
its true edges. They put no moments on nodes, as the element has no shape functions of its own between its nodes;
the difference is of second order in the cells' size, as the element's own error. A point load acts on its node.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck import nodal
from shellbench.problems.shell.deck.grid import Grid
from shellbench.problems.shell.question.conditions import Support
from shellbench.problems.shell.question.places import Edge, Place

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))  # of a cell, in Kratos' order: the normal is then along a1 x a2
FEWEST_AROUND = 3  # cells around a closed coordinate: with fewer, quadrilaterals would share two sides


@dataclass(frozen=True)
class QuadMesh:
    """Nodes and quadrilaterals.

    Attributes
    ----------
    lower, upper
        Bounds of (xi1, xi2).
    closed
        Whether each coordinate closes on itself: its last nodes are then its first.
    cells
        Along xi1 and xi2.
    """

    lower: tuple[float, float]
    upper: tuple[float, float]
    closed: tuple[bool, bool]
    cells: tuple[int, int]

    @cached_property
    def grid(self) -> Grid:
        """The same mesh as other programs get it; its nodes have the same numbers."""
        return Grid(self.lower, self.upper, self.closed, self.cells)

    @property
    def counts(self) -> tuple[int, int]:
        """Nodes along xi1 and xi2."""
        first, second = (n if turns else n + 1 for n, turns in zip(self.cells, self.closed, strict=True))
        return first, second

    @property
    def node_count(self) -> int:
        """Number of nodes v."""
        return self.counts[0] * self.counts[1]

    @property
    def steps(self) -> Array:
        """(2,) sides of a cell."""
        return np.subtract(self.upper, self.lower) / self.cells

    @cached_property
    def nodes(self) -> Array:
        """(v, 2) coordinates of the nodes; xi2 runs fastest."""
        first, second = (
            low + step * np.arange(n) for low, step, n in zip(self.lower, self.steps, self.counts, strict=True)
        )
        return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def quads(self) -> Integers:
        """(e, 4) nodes of each quadrilateral; those of one xi1 follow each other."""
        i, j = (a.ravel() for a in np.indices(self.cells))
        return np.stack([self._number(i + di, j + dj) for di, dj in CORNERS], axis=-1)

    def _number(self, i: Integers, j: Integers) -> Integers:
        n1, n2 = self.counts
        return (i % n1) * n2 + j % n2

    def locate(self, points: Array) -> tuple[Integers, Array]:
        """Return the quadrilateral (n,) that each point (n, 2) of the rectangle lies in, and its place (n, 2) there.

        Places are from 0 to 1 along xi1 and xi2.
        """
        place = (points - self.lower) / self.steps
        cell = np.clip(np.floor(place).astype(np.int64), 0, np.asarray(self.cells) - 1)
        return cell[:, 0] * self.cells[1] + cell[:, 1], place - cell


def bilinear(places: Array) -> Array:
    """Return the bilinear shape functions (n, 4) of a cell's corners at places (n, 2) from 0 to 1."""
    s, t = places[:, 0], places[:, 1]
    return np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=-1)


SAMPLES = 33  # points of an edge at which its direction is looked at
STRAIGHT = 1e-9  # sine of an angle that is rounding


def constant_axis(vectors: Array) -> int | None:
    """Return the Cartesian direction (0, 1, 2) that all vectors (n, 3) are along; None if there is none."""
    sizes = np.abs(vectors) / np.linalg.norm(vectors, axis=-1, keepdims=True)
    for axis in range(3):
        if np.abs(np.delete(sizes, axis, axis=-1)).max() < STRAIGHT:
            return axis
    return None


def across(axis: int) -> tuple[int, ...]:
    """Return the two Cartesian directions across a direction."""
    return tuple(c for c in range(3) if c != axis)


def held_rotations(case: Case, place: Place, support: Support) -> tuple[int, ...] | None:
    """Return the rotations (0, 1, 2) that a support holds at a place; None if single components can't express it.

    A clamp holds the rotation about the edge's tangent. That is a component where the tangent is along a Cartesian
    axis. Where the normal is along one, and the displacement in its direction is held, so that the rotation about
    the conormal is zero too, both components across the normal are held, whatever the edge's shape. A plane of
    symmetry holds the rotations about axes in it.
    """
    if support.symmetry is not None:
        return across("xyz".index(support.symmetry))
    if not support.clamped or not isinstance(place, Edge):
        return ()
    domain, running = case.surface.domain, 1 - place.axis
    points = place.points(domain, np.linspace(domain.lower[running], domain.upper[running], SAMPLES))
    x = case.surface.derivatives(points, order=1)
    tangent = constant_axis((x[0, 1], x[1, 0])[place.axis])
    if tangent is not None:
        return (tangent,)
    normal = constant_axis(np.cross(x[1, 0], x[0, 1]))
    if normal is not None and "xyz"[normal] in support.held:
        return across(normal)
    return None


Masks = tuple[NDArray[np.bool_], NDArray[np.bool_]]


def held_nodes(case: Case, mesh: QuadMesh, supported: Iterable[tuple[int, Support, Place]], count: int) -> Masks:
    """Return the displacements and the rotations (count, v, 3) that numbered supports prescribe at places.

    Raises
    ------
    InputError
        If a point that is held lies on no node.
    """
    moved = np.zeros((count, mesh.node_count, 3), dtype=bool)
    turned = np.zeros_like(moved)
    for number, support, place in supported:
        nodes = mesh.grid.nodes_of(place)
        for component in support.held:
            moved[number, nodes, "xyz".index(component)] = True
        for rotation in held_rotations(case, place, support) or ():
            turned[number, nodes, rotation] = True
    return moved, turned


@dataclass(frozen=True)
class Supports:
    """Supports of the nodes.

    Attributes
    ----------
    held
        (v, 6) displacements and rotations that supports prescribe, planes of symmetry among them.
    """

    case: Case
    mesh: QuadMesh
    held: NDArray[np.bool_]

    @classmethod
    def on_mesh(cls, case: Case, mesh: QuadMesh) -> Supports:
        """Find the held nodes; InputError if a point that is held lies on no node."""
        places = ((n, support, case.places[name]) for n, support in enumerate(case.supports) for name in support.on)
        masks = held_nodes(case, mesh, places, len(case.supports))
        return cls(case, mesh, np.concatenate([mask.any(axis=0) for mask in masks], axis=1))

    @cached_property
    def free(self) -> Integers:
        """Free degrees of freedom 6 v + component."""
        return np.flatnonzero(~self.held.ravel())

    def prescribed(self, t: float) -> Array:
        """Return the displacements (v, 3) that supports prescribe at a load factor; zero where none does.

        Raises
        ------
        InputError
            If two supports move a node that they share to different places.
        """
        return nodal.prescribed(self.case, self.mesh.grid, t)[:, :3]


@dataclass(frozen=True)
class Loose:
    """Rigid motions that nothing holds: pinned while a case is solved, then taken away in the mean over the area.

    Attributes
    ----------
    motions
        (v, 6, k) displacements and rotations of the nodes.
    pins
        (k,) degrees of freedom that are held at zero: those that resist the motions best.
    """

    motions: Array
    pins: Integers

    @classmethod
    def from_supports(cls, supports: Supports) -> Loose:
        """Choose pins among the free displacements of the nodes."""
        return cls(*nodal.loose(supports.case, supports.mesh.grid, supports.held))

    def removed(self, values: Array, areas: Array) -> Array:
        """Return displacements and rotations (v, 6) without their mean part along the motions.

        The mean is that of displacements, nodes weighed by areas (v,).
        """
        if not len(self.pins):
            return values
        weighted = self.motions[:, :3] * areas[:, None, None]
        left = np.einsum("vca,vcb->ab", weighted, self.motions[:, :3])
        part = np.linalg.solve(left, np.einsum("vca,vc->a", weighted, values[:, :3]))
        return np.asarray(values - self.motions @ part)


@dataclass(frozen=True)
class Loads:
    """Loads on the nodes of a shell.

    Attributes
    ----------
    case, mesh
        The solved case, possibly that of a part, and its mesh.
    """

    case: Case
    mesh: QuadMesh

    @cached_property
    def areas(self) -> Array:
        """(v,) area of each node, m^2."""
        return nodal.areas(self.case, self.mesh.grid)

    def forces(self, t: float) -> Array:
        """Return forces and moments (v, 6) at a load factor, N and N m."""
        return nodal.forces(self.case, self.mesh.grid, t)
