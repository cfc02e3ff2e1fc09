"""Supports as held displacements and rotations of nodes; rigid motions that nothing holds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import RIGID_MOTIONS, Support
from shellbench.problems.shell.places import Edge, Place, Point
from shellbench.solvers.kratos.thin_mesh import QuadMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

SAMPLES = 33  # points of an edge at which its direction is looked at
STRAIGHT = 1e-9  # sine of an angle that is rounding
CONTRADICTION = 1e-9  # of the shell's size: how far two supports may move one node apart


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
    """Return the rotations (0, 1, 2) that a support holds at a place; None if single components can't say it.

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
        nodes = nodes_of(place, mesh)
        for component in support.held:
            moved[number, nodes, "xyz".index(component)] = True
        for rotation in held_rotations(case, place, support) or ():
            turned[number, nodes, rotation] = True
    return moved, turned


@dataclass(frozen=True)
class Supports:
    """What is held.

    Attributes
    ----------
    held
        (v, 6) displacements and rotations that supports prescribe, planes of symmetry among them.
    """

    case: Case
    mesh: QuadMesh
    held: NDArray[np.bool_]

    @classmethod
    def of(cls, case: Case, mesh: QuadMesh) -> Supports:
        """Find the held nodes; InputError if a point that is held lies on no node."""
        places = ((n, support, case.places[name]) for n, support in enumerate(case.supports) for name in support.on)
        masks = held_nodes(case, mesh, places, len(case.supports))
        return cls(case, mesh, np.concatenate([mask.any(axis=0) for mask in masks], axis=1))

    @cached_property
    def free(self) -> Integers:
        """Degrees of freedom 6 v + component that nothing prescribes."""
        return np.flatnonzero(~self.held.ravel())

    def prescribed(self, t: float) -> Array:
        """Return the displacements (v, 3) that supports prescribe at a load factor; zero where none does.

        Raises
        ------
        InputError
            If two supports move a node that they share to different places.
        """
        result = np.zeros((self.mesh.node_count, 3))
        for support, place in self.case.supported_places():
            if support.motion is None:
                continue
            nodes = nodes_of(place, self.mesh)
            moved = self.case.motion(support, place, self.mesh.nodes[nodes], t)[0, 0]
            for component in support.held:
                result[nodes, "xyz".index(component)] = moved[:, "xyz".index(component)]
        self._check(result, t)
        return result

    def _check(self, result: Array, t: float) -> None:
        size = np.ptp(self.case.surface.position(self.mesh.nodes), axis=0).max()
        for support, place in self.case.supported_places():
            nodes = nodes_of(place, self.mesh)
            columns = ["xyz".index(c) for c in support.held]
            moved = self.case.motion(support, place, self.mesh.nodes[nodes], t)[0, 0] if support.motion else 0.0
            gap = np.abs(result[nodes] - moved)[:, columns]
            if gap.max(initial=0.0) > CONTRADICTION * size:
                raise InputError(f"{self.case.name}: two supports move a node on '{place.name}' to different places")


def nodes_of(place: Place, mesh: QuadMesh) -> Integers:
    """Return the nodes of a place.

    Raises
    ------
    InputError
        If a point lies on no node.
    """
    match place:
        case Edge(axis=axis, side=side):
            return mesh.edge(axis, side == "max")
        case Point():
            return np.array([node_at(place, mesh)])
        case _:
            return np.zeros(0, dtype=np.int64)


def node_at(point: Point, mesh: QuadMesh) -> int:
    """Return the node at a point; InputError if there is none."""
    node = mesh.node_at(point.xi)
    if node is None:
        n1, n2 = mesh.cells
        raise InputError(f"field 'cells': '{point.name}' lies on no node of {n1} x {n2} cells; choose other cells")
    return node


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
    def of(cls, supports: Supports, positions: Array) -> Loose:
        """Choose pins among the free displacements of nodes at positions (v, 3)."""
        names = supports.case.remove_rigid_motions
        chosen = [RIGID_MOTIONS.index(name) for name in names]
        centre = (positions.max(axis=0) + positions.min(axis=0)) / 2
        size = np.ptp(positions, axis=0).max()
        motions = np.zeros((len(positions), 6, 6))
        motions[:, :3, :3] = np.eye(3)
        for axis, unit in enumerate(np.eye(3)):
            motions[:, :3, 3 + axis] = np.cross(unit, positions - centre) / size
            motions[:, 3:, 3 + axis] = unit / size
        motions = motions[:, :, chosen]
        free = supports.free[supports.free % 6 < 3]
        if not names:
            return cls(motions, np.zeros(0, dtype=np.int64))
        _, _, order = qr(motions.reshape(-1, len(names))[free].T, mode="economic", pivoting=True)
        return cls(motions, free[np.sort(order[: len(names)])])

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
