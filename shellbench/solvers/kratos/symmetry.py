"""Planes of symmetry of a case, and the part of its shell that remains to be solved.

An open coordinate can have one mirror (see `mirror`), in its middle; a closed one two, a quarter of
a turn apart, or one, which leaves two lines half a turn apart where they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import RigidMotion
from shellbench.problems.shell.places import SIDES, Point, Side
from shellbench.solvers.kratos.mirror import ROUNDING, Mirror, mirror_of, point_forces

__all__ = ["Folded", "Mirror", "Part", "part_of", "point_forces", "whole_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Folded:
    """Points of the whole shell, brought into the part.

    Attributes
    ----------
    points
        (..., 2) in the part.
    signs
        (..., 3) by which a vector there is multiplied to be the one at the point it came from.
    turned
        (..., 2) -1 where a coordinate runs the other way, else 1.
    """

    points: Array
    signs: Array
    turned: Array


@dataclass(frozen=True)
class Part:
    """The part of a shell that is solved, a rectangle of the coordinates.

    Attributes
    ----------
    case
        The whole.
    lower, upper
        Bounds of the rectangle.
    mirrors
        Those that make the whole of the part.
    planes
        (axis, side) -> normal: edges of the part that lie in planes of symmetry, and the Cartesian direction (0, 1, 2)
        across.
    """

    case: Case
    lower: tuple[float, float]
    upper: tuple[float, float]
    mirrors: tuple[Mirror, ...]
    planes: Mapping[tuple[int, Side], int]

    @property
    def copies(self) -> int:
        """How many times the part is in the whole."""
        return 1 << len(self.mirrors)

    @property
    def normals(self) -> frozenset[int]:
        """Directions across planes of symmetry."""
        return frozenset(mirror.normal for mirror in self.mirrors)

    def images(self) -> Iterator[tuple[Mirror, ...]]:
        """Yield for each copy the mirrors that lead from the part to it, the part itself first."""
        for chosen in product((False, True), repeat=len(self.mirrors)):
            yield tuple(m for m, taken in zip(self.mirrors, chosen, strict=True) if taken)

    def fold(self, points: ArrayLike) -> Folded:
        """Bring points (..., 2) of the whole shell into the part."""
        xi = np.array(points, dtype=float)
        signs, turned = np.ones((*xi.shape[:-1], 3)), np.ones_like(xi)
        domain = self.case.surface.domain
        for axis in (0, 1):
            if domain.periodic[axis]:
                xi[..., axis] = self.lower[axis] + np.mod(xi[..., axis] - self.lower[axis], domain.size[axis])
            for mirror in (m for m in self.mirrors if m.axis == axis):
                # a mirror at the lower end of a turn also leaves the line half a turn away where it is
                line = mirror.at + (domain.size[axis] / 2 if mirror.at == self.lower[axis] else 0.0)
                beyond = xi[..., axis] > line
                xi[..., axis] = np.where(beyond, 2 * line - xi[..., axis], xi[..., axis])
                signs[..., mirror.normal] *= np.where(beyond, -1.0, 1.0)
                turned[..., axis] *= np.where(beyond, -1.0, 1.0)
        return Folded(xi, signs, turned)

    def place(self, point: tuple[float, float]) -> tuple[tuple[float, float], float] | None:
        """Return a point of the whole as a point of the part, and the share of a load there that the part carries.

        The share is a half for each plane of symmetry through the point; None if the point is outside the part.
        """
        domain = self.case.surface.domain
        found, share = [], 1.0
        for axis in (0, 1):
            value, size = point[axis], self.upper[axis] - self.lower[axis]
            if domain.periodic[axis]:
                offset = (value - self.lower[axis]) % domain.size[axis]
                if domain.size[axis] - offset < ROUNDING * size:
                    offset = 0.0
                value = self.lower[axis] + offset
            if not -ROUNDING * size <= value - self.lower[axis] <= size * (1 + ROUNDING):
                return None
            value = min(max(value, self.lower[axis]), self.upper[axis])
            for side in SIDES:
                end = (self.lower if side == "min" else self.upper)[axis]
                if (axis, side) in self.planes and abs(value - end) <= ROUNDING * size:
                    share /= 2
            found.append(value)
        return (found[0], found[1]), share

    def holds(self, motion: RigidMotion) -> bool:
        """Tell whether planes of symmetry exclude a rigid motion.

        A plane excludes the translation across it and the rotations about axes in it: in the mean over the area a
        symmetric displacement is then orthogonal to the motion.
        """
        kind, _, name = motion.partition("_")
        direction = "xyz".index(name)
        return direction in self.normals if kind == "translation" else bool(self.normals - {direction})


def whole_of(case: Case) -> Part:
    """Return the whole of a case's shell as its own part, without a look at its symmetry."""
    domain = case.surface.domain
    return Part(case, domain.lower, domain.upper, (), {})


def part_of(case: Case) -> Part:
    """Return the smallest part of a case's shell that its planes of symmetry allow; the whole if it has none."""
    domain = case.surface.domain
    lower, upper = list(domain.lower), list(domain.upper)
    mirrors: list[Mirror] = []
    planes: dict[tuple[int, Side], int] = {}
    for axis in (0, 1):
        if not domain.periodic[axis]:
            mirror = mirror_of(case, axis, (domain.lower[axis] + domain.upper[axis]) / 2)
            if mirror:
                mirrors.append(mirror)
                upper[axis] = mirror.at
                planes[axis, "max"] = mirror.normal
            continue
        found = _mirrors_of_a_turn(case, axis)
        if found:
            mirrors += found
            lower[axis] = found[0].at
            upper[axis] = found[0].at + domain.size[axis] / (2 * len(found))
            planes[axis, "min"], planes[axis, "max"] = found[0].normal, found[-1].normal
    return Part(case, (lower[0], lower[1]), (upper[0], upper[1]), tuple(mirrors), planes)


def _mirrors_of_a_turn(case: Case, axis: int) -> list[Mirror]:
    """Return two mirrors a quarter of a turn apart, or one, or none."""
    domain = case.surface.domain
    turn = domain.size[axis]
    named = [p.xi[axis] for p in case.places.values() if isinstance(p, Point)]
    single: list[Mirror] = []
    for start in (domain.lower[axis], 0.0, *named, domain.lower[axis] + turn / 4, turn / 4):
        first = mirror_of(case, axis, start)
        if first is None:
            continue
        second = mirror_of(case, axis, start + turn / 4)
        if second and second.normal != first.normal:
            return [first, second]
        single = single or [first]
    return single
