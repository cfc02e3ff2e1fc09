"""Reflections of the parametric rectangle under which a linear case is its own mirror image.

A reflection about a coordinate line is a symmetry where it carries the surface, the loads and the supports into their
mirror images in a Cartesian plane with unit normal e,

    x(xi') = R x(xi) + 2 d e,    f(xi') = R f(xi),    R = 1 - 2 e e^T.

That it does is never assumed. It is observed on the mesh at hand: of the mesh lines; of the surface, its derivatives
and the loads per area at every Gauss point; of loads on edges and the motion of supports at the nodes and the Gauss
points there; and of forces at points. What the whole mesh would integrate is symmetric, then.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import COMPONENTS, EdgeLoad, PointLoad, Support
from shellbench.problems.shell.measure import load_density
from shellbench.problems.shell.places import SIDES, Edge, Place, Point
from shellbench.problems.shell.surface import COORDINATES, Domain
from shellbench.solvers.fem import clamping
from shellbench.solvers.fem.loads import EDGE_GAUSS_POINTS
from shellbench.solvers.fem.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Index = slice | Integers
Places = tuple[Index, Index]  # of a grid of points

SYMMETRIC = 1e-13  # relative difference to the mirror image that is rounding; symmetric cases have 1e-15 to 3e-15


@dataclass(frozen=True)
class Mirror:
    """A reflection of one coordinate that is a symmetry of a case.

    Attributes
    ----------
    axis
        Number of the coordinate.
    normal
        Number of the Cartesian component along the normal of the plane of symmetry.
    supports
        For each support the number of its mirror image.
    """

    axis: int
    normal: int
    supports: tuple[int, ...]

    @property
    def signs(self) -> Array:
        """(3,) diagonal of R."""
        return _signs(self.normal)


class Observed:
    """A case as the whole mesh sees it: at its Gauss points, with all that is evaluated there."""

    def __init__(self, case: Case, mesh: TensorMesh, quadrature_order: int) -> None:
        self.case, self.mesh, self.domain = case, mesh, mesh.domain
        self.gauss = quadrature_order // 2 + 1  # points of a cell along a coordinate
        self.runs = [_gauss_points(line, self.gauss) for line in mesh.lines]
        self.kept: list[Index] = [slice(None), slice(None)]  # the other points are known to be images of these

    @cached_property
    def points(self) -> Array:
        """(n1, n2, 2) Gauss points."""
        return self.domain.wrap(np.stack(np.meshgrid(*self.runs, indexing="ij"), axis=-1))

    @cached_property
    def surface(self) -> dict[tuple[int, int], Array]:
        """Position and derivatives (n1, n2, 3)."""
        return self.case.surface.derivatives(self.points, order=2)

    @cached_property
    def densities(self) -> list[Array]:
        """Load per area (n1, n2, 3) at each state."""
        flat = self.points.reshape(-1, 2)
        return [load_density(self.case, flat, t).reshape(self.surface[0, 0].shape) for t in self.case.states]

    def keep(self, axis: int, start: int, cells: int) -> None:
        """Note that all other cells along a coordinate are images of these."""
        first = start if start + cells <= self.mesh.cells[axis] else start - cells
        self.kept[axis] = slice(first * self.gauss, (first + cells) * self.gauss)

    def mirror(self, axis: int, line: int, cells: int) -> Mirror | None:
        """Return the reflection about a mesh line if it is a symmetry; so many cells on either side are compared."""
        steps, size = np.diff(self.mesh.lines[axis]), self.domain.size[axis]
        opposite = (2 * line - 1 - np.arange(len(steps))) % len(steps)
        if np.abs(steps - steps[opposite]).max() > SYMMETRIC * size:
            return None
        here, there = self._sides(axis, line * self.gauss, cells * self.gauss)
        normal = self._normal(axis, here, there)
        if normal is None:
            return None
        signs = _signs(normal)
        if not all(_alike(density[there], signs * density[here]) for density in self.densities):
            return None
        reflection = _Reflection(self.domain, axis, float(self.mesh.lines[axis][line]), signs)
        if not (self._edge_loads_agree(reflection) and self._point_loads_agree(reflection)):
            return None
        supports = self._mirrored_supports(reflection)
        return None if supports is None else Mirror(axis, normal, supports)

    def _sides(self, axis: int, middle: int, points: int) -> tuple[Places, Places]:
        """Return so many Gauss points along a coordinate on either side of one, those next to it first."""
        count = len(self.runs[axis])
        last = (middle or count) - 1
        here: Index = slice(middle, middle + points)
        there: Index = slice(last, None if middle == points else last - points, -1)
        if middle + points > count or 0 < middle < points:  # one of them lies beyond the seam
            here, there = (middle + np.arange(points)) % count, (middle - 1 - np.arange(points)) % count
        other = self.kept[1 - axis]
        return ((here, other), (there, other)) if axis == 0 else ((other, here), (other, there))

    def _normal(self, axis: int, here: Places, there: Places) -> int | None:
        """Return the component along which a reflection mirrors the surface; None if it does not."""
        position = self.surface[0, 0]
        gap = np.abs(position[there] - position[here]).max(axis=(0, 1))
        normal = int(np.argmax(gap))  # images differ along the normal alone
        middles = position[there][..., normal] + position[here][..., normal]
        if not max(np.delete(gap, normal).max(), np.ptp(middles)) <= SYMMETRIC * gap[normal]:
            return None
        for key, x in self.surface.items():
            if key != (0, 0) and not _alike(x[there], (-1) ** key[axis] * _signs(normal) * x[here]):
                return None
        return normal

    def _edge_loads_agree(self, reflection: _Reflection) -> bool:
        loads = [load for load in self.case.loads if isinstance(load, EdgeLoad)]

        def density(edge: Edge, points: Array, t: float) -> Array:
            total = np.zeros((len(points), len(COMPONENTS)))
            for load in loads:
                if edge.name in load.on:
                    total += self.case.evaluate(load.vector, self.domain.wrap(points), t)[0, 0]
            return total

        edges = [place for place in self.case.places.values() if isinstance(place, Edge)] if loads else []
        for edge, t in product(edges, self.case.states):
            here = edge.points(self.domain, _gauss_points(self.mesh.lines[1 - edge.axis], EDGE_GAUSS_POINTS))
            there = reflection.points(here)
            if not _alike(density(reflection.edge(edge), there, t), reflection.signs * density(edge, here, t)):
                return False
        return True

    def _point_loads_agree(self, reflection: _Reflection) -> bool:
        forces = list(_point_forces(self.case))
        scale = max((float(np.abs(force).max()) for _, force in forces), default=0.0)
        for xi, _ in forces:
            here = sum(force for at, force in forces if reflection.same(at, xi))
            there = sum(force for at, force in forces if reflection.same(at, reflection.points(xi)))
            if not np.abs(there - reflection.signs * here).max() <= SYMMETRIC * scale:
                return False
        return True

    def _mirrored_supports(self, reflection: _Reflection) -> tuple[int, ...] | None:
        """Return for each support the number of its mirror image; None if one has none."""
        supports = self.case.supports
        found = []
        for support in supports:
            images = (n for n, other in enumerate(supports) if self._carries(reflection, support, other))
            found.append(next(images, -1))
        return None if -1 in found else tuple(found)

    def _carries(self, reflection: _Reflection, support: Support, other: Support) -> bool:
        alike = set(support.held) == set(other.held) and support.clamped == other.clamped
        if not alike or support.symmetry != other.symmetry or len(support.on) != len(other.on):
            return False
        candidates = [self.case.places[name] for name in other.on]
        for place in (self.case.places[name] for name in support.on):
            image = next((p for p in candidates if reflection.carries(place, p)), None)
            if image is None or not self._motions_agree(reflection, (support, place), (other, image)):
                return False
        return True

    def _motions_agree(self, reflection: _Reflection, one: tuple[Support, Place], other: tuple[Support, Place]) -> bool:
        if one[0].motion is None and other[0].motion is None:
            return True
        place = one[1]
        if isinstance(place, Edge):
            line = self.mesh.lines[1 - place.axis]
            here = place.points(self.domain, np.concatenate([line, _gauss_points(line, clamping.GAUSS_POINTS)]))
        elif isinstance(place, Point):
            here = np.array([place.xi])
        else:
            return False
        there = reflection.points(here)
        for t in self.case.states:
            moved = self.case.motion(*one, self.domain.wrap(here), t, order=2)
            image = self.case.motion(*other, self.domain.wrap(there), t, order=2)
            for key, u in moved.items():
                if not _alike((-1) ** key[reflection.axis] * image[key], reflection.signs * u):
                    return False
        return True


@dataclass(frozen=True)
class _Reflection:
    """xi -> 2 c - xi of one coordinate, with the signs of the Cartesian components."""

    domain: Domain
    axis: int
    centre: float
    signs: Array

    def points(self, xi: Array | tuple[float, float]) -> Array:
        """Return the reflected points (..., 2)."""
        turned = np.array(xi, dtype=float)
        turned[..., self.axis] = 2 * self.centre - turned[..., self.axis]
        return turned

    def same(self, one: Array | tuple[float, float], other: Array | tuple[float, float]) -> bool:
        """Tell whether two points are the same."""
        gap, size = np.asarray(one) - np.asarray(other), np.asarray(self.domain.size)
        gap = np.where(self.domain.periodic, gap - size * np.round(gap / size), gap)
        return bool(np.all(np.abs(gap) <= SYMMETRIC * size))

    def edge(self, edge: Edge) -> Edge:
        """Return the edge that an edge is carried to."""
        if edge.axis != self.axis:
            return edge
        side = SIDES[1 - SIDES.index(edge.side)]
        return Edge(f"{COORDINATES[edge.axis]}_{side}", edge.axis, side)

    def carries(self, place: Place, other: Place) -> bool:
        """Tell whether a place is carried to another one."""
        if isinstance(place, Edge):
            return self.edge(place) == other
        return isinstance(place, Point) and isinstance(other, Point) and self.same(self.points(place.xi), other.xi)


def _signs(normal: int) -> Array:
    return np.where(np.arange(len(COMPONENTS)) == normal, -1.0, 1.0)


def _gauss_points(line: Array, count: int) -> Array:
    x, _ = np.polynomial.legendre.leggauss(count)
    return np.asarray((line[:-1, None] + np.diff(line)[:, None] * (x + 1) / 2).ravel())


def _alike(one: Array, other: Array) -> bool:
    scale = max(float(other.max(initial=0.0)), -float(other.min(initial=0.0)))
    return bool(np.abs(one - other).max(initial=0.0) <= SYMMETRIC * scale)


def _point_forces(case: Case) -> Iterator[tuple[tuple[float, float], Array]]:
    """Yield the points of all forces at points, and the force (states, 3)."""
    for load in case.loads:
        if isinstance(load, PointLoad):
            for place in (case.places[name] for name in load.on):
                if isinstance(place, Point):
                    at = np.array([place.xi])
                    yield place.xi, np.concatenate([case.evaluate(load.force, at, t)[0, 0] for t in case.states])
