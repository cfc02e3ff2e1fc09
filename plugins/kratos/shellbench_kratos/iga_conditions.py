"""Supports of a part's case as conditions on its control points, and loads as forces on them.

On an edge a patch is made by its first row of control points alone, and its derivative across the edge is
proportional to the difference of the first two rows. A held component is therefore a fixed row, and a held slope or
a plane of symmetry ties the second row to the first one. A load's forces are its work on the part's own functions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.mirrors import Mirror, point_forces
from shellbench.problems.shell.quantities.measure import load_density
from shellbench.problems.shell.question.conditions import Support
from shellbench.problems.shell.question.loads import EdgeLoad
from shellbench.problems.shell.question.places import Edge, Place, Point
from shellbench.problems.shell.symmetry.symmetry import Part
from shellbench_kratos.nurbs import NurbsPatch

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ALONG = 1e-9  # sine of an angle that is rounding
SAMPLES = 17  # points of an edge at which its normal is looked at
EXTRA_POINTS = 2  # a span and coordinate, beyond degree + 1: loads may be any formula


@dataclass(frozen=True)
class Row:
    """Conditions on the control points along one edge of the part, or at one of its corners.

    Attributes
    ----------
    index, second
        Into the control points (n1, n2): those on the edge, and their neighbours within.
    held, tied
        Components that are held at zero, and components that have no derivative across the edge.
    """

    index: tuple[int | slice, int | slice]
    second: tuple[int | slice, int | slice]
    held: tuple[int, ...]
    tied: tuple[int, ...]


@dataclass(frozen=True)
class Conditions:
    """Constraints of the control points by supports and symmetry.

    Attributes
    ----------
    fixed
        (3, n1, n2) components of control points that are held at zero.
    leader
        (3, n1, n2) flat number of the control point whose component moves this one: its own, but where it is tied.
    """

    fixed: Mask
    leader: NDArray[np.int64]

    @property
    def free(self) -> int:
        """Number of unknowns."""
        own = self.leader == np.arange(self.fixed[0].size).reshape(self.fixed.shape[1:])
        return int(np.count_nonzero(own & ~self.fixed))

    def balanced(self, forces: Array) -> Array:
        """Return the parts of forces (3, n1, n2) in free directions, gathered at their leaders."""
        total = np.zeros((3, self.fixed[0].size))
        for component in range(3):
            np.add.at(total[component], self.leader[component].ravel(), forces[component].ravel())
        return np.asarray(np.where(self.fixed, 0.0, total.reshape(self.fixed.shape)))


def tied_by(case: Case, support: Support, edge: Edge) -> tuple[int, ...] | None:
    """Return the components that a held slope leaves without a derivative across the edge.

    On a plane of symmetry they are the two in it. Under a clamp it is that of the shell's normal: where the coordinate
    across the edge is oblique to it, this holds the slope along the conormal only if the component itself is held.

    Returns
    -------
    tuple or None
        None if Cartesian components can't express it.
    """
    if not support.holds_slope:
        return ()
    domain = case.surface.domain
    running = 1 - edge.axis
    points = edge.points(domain, np.linspace(domain.lower[running], domain.upper[running], SAMPLES))
    x = case.surface.derivatives(points, order=1)
    across = x[1, 0] if edge.axis == 0 else x[0, 1]
    normal = np.cross(x[1, 0], x[0, 1])
    if support.symmetry:
        plane = "xyz".index(support.symmetry)
        return tuple(c for c in range(3) if c != plane) if _direction(across) == plane else None
    found = _direction(normal)
    if found is None or not ("xyz"[found] in _held_on(case, edge) or _at_right_angles(x[1, 0], x[0, 1])):
        return None
    return (found,)


def _held_on(case: Case, edge: Edge) -> set[str]:
    """Return the components that any support holds on an edge."""
    return {component for support, place in case.supported_places() if place == edge for component in support.held}


def _at_right_angles(first: Array, second: Array) -> bool:
    """Return True if vectors (n, 3) are at right angles to others."""
    lengths = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    return bool(np.all(np.abs(np.einsum("ni,ni->n", first, second)) <= ALONG * lengths))


def _direction(vectors: Array) -> int | None:
    """Return the Cartesian direction along which all of the vectors (n, 3) are, if there is one."""
    unit = np.abs(vectors) / np.linalg.norm(vectors, axis=-1, keepdims=True)
    direction = int(np.argmax(unit[0]))
    return direction if np.delete(unit, direction, axis=-1).max() <= ALONG else None


def row_of(case: Case, support: Support, place: Place) -> Row:
    """Return the conditions of a support of a valid case along an edge of the shell, or at one of its corners."""
    held, every = tuple("xyz".index(c) for c in support.held), slice(None)
    if isinstance(place, Edge):
        tied = tied_by(case, support, place)
        assert tied is not None, "the case is declined"
        first, second = (0, 1) if place.side == "min" else (-1, -2)
        if place.axis == 0:
            return Row((first, every), (second, every), held, tied)
        return Row((every, first), (every, second), held, tied)
    corner = corner_of(case, place.xi) if isinstance(place, Point) else None
    assert corner is not None, "the case is declined"
    return Row(corner, corner, held, ())


def corner_of(case: Case, xi: tuple[float, float]) -> tuple[int, int] | None:
    """Return the control point at a corner of the shell, its numbers 0 or -1; None if a point is no corner."""
    first, second = (end_of(case, xi, axis) for axis in (0, 1))
    return None if first is None or second is None else (first, second)


def end_of(case: Case, xi: tuple[float, float], axis: int) -> int | None:
    """Return 0 or -1 where a point is at the lower or the upper end of a coordinate, else None."""
    domain = case.surface.domain
    slack = ALONG * domain.size[axis]
    if abs(xi[axis] - domain.lower[axis]) <= slack:
        return 0
    return -1 if abs(xi[axis] - domain.upper[axis]) <= slack else None


def conditions_of(case: Case, shape: tuple[int, int]) -> Conditions:
    """Return the constraints of the control points (n1, n2) of a shell."""
    fixed = np.zeros((3, *shape), dtype=bool)
    leader = np.broadcast_to(np.arange(shape[0] * shape[1]).reshape(shape), (3, *shape)).copy()
    rows = [row_of(case, support, place) for support, place in case.supported_places()]
    for row in rows:
        for component in row.held:
            fixed[component][row.index] = True
    for row in rows:
        for component in row.tied:
            # the corner that two such edges share follows: its leader is the leader of the one that it is tied to
            leader[component][row.second] = leader[component][row.index]
    for component in range(3):  # what is tied to something held is held, and what leads something held too
        followers = np.zeros(shape[0] * shape[1], dtype=bool)
        np.logical_or.at(followers, leader[component].ravel(), fixed[component].ravel())
        fixed[component] = followers[leader[component]]
    return Conditions(fixed, leader)


def held_by(part: Part, number: int, mirrors: tuple[Mirror, ...], shape: tuple[int, int]) -> Mask:
    """Return the components (3, n1, n2) that a support of the whole shell holds, on the part's copy under mirrors.

    If two supports share a control point, its force is assigned to the support that the case names first.
    """
    acting = np.zeros((len(part.whole.supports), 3, *shape), dtype=bool)
    for other, support, place in part.supported(mirrors):
        row = row_of(part.case, support, place)
        for component in row.held:
            acting[other, component][row.index] = True
        for component in row.tied:
            acting[other, component][row.index] = acting[other, component][row.second] = True
    return np.asarray(acting[number] & ~acting[:number].any(axis=0))


def control_forces(case: Case, patch: NurbsPatch, t: float) -> Array:
    """Return the forces (3, n1, n2) on control points at time or load factor t, N."""
    return _area(case, patch, t) + _edges(case, patch, t) + _points(case, patch, t)


def _area(case: Case, patch: NurbsPatch, t: float) -> Array:
    (first, w1), (second, w2) = (basis.gauss(basis.degree + 1 + EXTRA_POINTS) for basis in patch.bases)
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    density = load_density(case, points, t)
    if not np.any(density):
        return np.zeros((3, *patch.shape))
    x = case.surface.derivatives(points, order=1)
    area = np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1)
    density = (density * area[:, None]).reshape(len(first), len(second), 3) * np.outer(w1, w2)[..., None]
    return patch.gather(patch.bases[0].matrices(first, 0)[0], density, patch.bases[1].matrices(second, 0)[0])


def _edges(case: Case, patch: NurbsPatch, t: float) -> Array:
    total = np.zeros((3, *patch.shape))
    for load in case.loads:
        for name in load.on if isinstance(load, EdgeLoad) else ():
            edge = case.places[name]
            assert isinstance(load, EdgeLoad)
            assert isinstance(edge, Edge)
            running = 1 - edge.axis
            basis = patch.bases[running]
            nodes, weights = basis.gauss(basis.degree + 1 + EXTRA_POINTS)
            points = edge.points(case.surface.domain, nodes)
            x = case.surface.derivatives(points, order=1)
            length = np.linalg.norm(x[1, 0] if running == 0 else x[0, 1], axis=-1)
            density = case.evaluate(load.vector, points, t)[0, 0] * (length * weights)[:, None]
            row = basis.matrices(nodes, 0)[0].T @ density
            end = 0 if edge.side == "min" else -1
            if edge.axis == 0:
                total[:, end, :] += row.T
            else:
                total[:, :, end] += row.T
    return total


def _points(case: Case, patch: NurbsPatch, t: float) -> Array:
    total = np.zeros((3, *patch.shape))
    for xi, force in point_forces(case, t):
        left, right = (basis.matrices(np.array([xi[a]]), 0)[0, 0] for a, basis in enumerate(patch.bases))
        total += force[:, None, None] * np.outer(left, right)
    return total
