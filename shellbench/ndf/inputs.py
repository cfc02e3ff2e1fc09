"""What the network sees of a point: input coordinates as jets, derived from the case alone.

A plain coordinate is scaled to [-1, 1]; a periodic one becomes (cos, sin); at an edge that holds the slope of free
components it is bent so that its derivative vanishes there. About each point that carries a force the tangential
distance enters once more, stretched as asinh(d / l) / asinh(reach / l): there the solution varies within the length
sqrt(R h) of a shell's bending layer, far below the size of the shell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.case import Case
from shellbench.conditions import PointLoad
from shellbench.ndf.jets import VALUE, Array, Placement, compose, coordinates, cosine, from_derivatives, sine
from shellbench.ndf.supports import edge_supports, even_sides, point_supports
from shellbench.places import Point
from shellbench.surface import Domain

SAMPLES = 24  # points a side of the grid on which inputs are tested for linear independence
DEPENDENT = 1e-6  # an input whose remainder is below this share of its size is left out
LAYER = 1.2  # l in units of sqrt(h R); .12 R for R / h = 100, the best by certified energy on pinched cylinders
FLAT_LAYER = 0.12  # l in units of the shell's size where it is flat
LONGEST_LAYER = 0.5  # of the size: a thick shell's layer is no longer than the shell
CURVED = 1e-12  # a principal curvature times the size below this is flat

Sides = tuple[tuple[bool, bool], tuple[bool, bool]]


@dataclass(frozen=True)
class Focus:
    """A point that carries a force, and the lengths of the solution around it.

    Attributes
    ----------
    xi
        (xi1, xi2), radians for angles.
    position, tangents
        (3,), (2, 3): where it is, and an orthonormal basis of the tangent plane; the first along a_1.
    reach
        Length over which the solution is plate-like at all, metres: the smallest radius of curvature or the size.
    layer
        Length of the bending layer l, metres.
    """

    xi: tuple[float, float]
    position: Array
    tangents: Array
    reach: float
    layer: float


def foci(case: Case, layer: float = LAYER) -> tuple[Focus, ...]:
    """Return the points of a case that carry a force: point loads and point supports."""
    loaded = [name for load in case.loads if isinstance(load, PointLoad) for name in load.on]
    places = [case.places[name] for name in loaded] + [s.point for s in point_supports(case)]
    distinct = {place.xi: place for place in places if isinstance(place, Point)}
    return tuple(_focus(case, xi, layer) for xi in distinct)


def _focus(case: Case, xi: tuple[float, float], layer: float) -> Focus:
    sample = case.surface.position(case.surface.domain.grid(9, 9)).reshape(-1, 3)
    size = float(np.linalg.norm(sample - sample.mean(axis=0), axis=1).max())
    x = case.surface.derivatives(np.asarray(xi), 2)
    a = np.stack([x[1, 0], x[0, 1]])
    first = a[0] / np.linalg.norm(a[0])
    second = a[1] - (a[1] @ first) * first
    second /= np.linalg.norm(second)
    normal = np.cross(first, second)
    curvature = np.array([[x[2, 0] @ normal, x[1, 1] @ normal], [x[1, 1] @ normal, x[0, 2] @ normal]])
    principal = np.linalg.eigvals(np.linalg.solve(a @ a.T, curvature))
    strongest = float(np.abs(principal).max())
    flat = strongest * size < CURVED
    reach = size if flat else min(size, 1 / strongest)
    inner = (
        FLAT_LAYER * size if flat else min(layer * math.sqrt(case.material.thickness / strongest), LONGEST_LAYER * size)
    )
    return Focus(xi, x[0, 0], np.stack([first, second]), reach, inner)


def even_coordinate(domain: Domain, points: Array, axis: int, even: tuple[bool, bool], placement: Placement) -> Tensor:
    """Return the jet (6, N) of a coordinate scaled to [0, 1], with vanishing slope at the bounds where it is even."""
    t = coordinates(points, placement)[axis] / domain.size[axis]
    t[VALUE] -= domain.lower[axis] / domain.size[axis]
    v = t[VALUE]
    match even:
        case (True, True):
            f, slope, bend = cosine(math.pi * v)
            return compose(((1 - f) / 2, -math.pi / 2 * slope, -(math.pi**2) / 2 * bend), t)
        case (True, False):
            return compose((v * v, 2 * v, torch.full_like(v, 2.0)), t)
        case (False, True):
            return compose((v * (2 - v), 2 - 2 * v, torch.full_like(v, -2.0)), t)
    return t


@dataclass(frozen=True)
class Inputs:
    """The input coordinates of a field.

    Attributes
    ----------
    case
        The case they are derived from.
    periodic
        Whether periodic coordinates enter as (cos, sin); if not, the field lives on a slit shell.
    foci
        Points about which stretched coordinates are added.
    even
        Bounds at which every input is even.
    kept
        Which of the candidate columns are used: those independent of the earlier ones.
    """

    case: Case
    periodic: bool
    foci: tuple[Focus, ...]
    even: Sides
    kept: tuple[int, ...]

    @classmethod
    def of(cls, case: Case, periodic: bool = True, around: tuple[Focus, ...] = ()) -> Inputs:
        """Derive the inputs of a case, with stretched coordinates around the given foci."""
        even = even_sides(edge_supports(case))
        candidates = cls(case, periodic, around, even, ())
        points = case.surface.domain.grid(SAMPLES, SAMPLES).reshape(-1, 2)
        columns = torch.stack([c[VALUE] for c, _ in candidates._columns(points, Placement())], dim=-1)
        return cls(case, periodic, around, even, _independent(columns))

    @property
    def count(self) -> int:
        """Number of input coordinates n."""
        return len(self.kept)

    @property
    def stretched(self) -> tuple[bool, ...]:
        """For each input, whether it is a stretched one."""
        flags = [flag for _, flag in self._columns(np.asarray([self.case.surface.domain.lower]), Placement())]
        return tuple(flags[k] for k in self.kept)

    def jets(self, points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, n) of the inputs at points (N, 2), angles in radians."""
        columns = self._columns(points, placement)
        return torch.stack([columns[k][0] for k in self.kept], dim=-1)

    def _columns(self, points: Array, placement: Placement) -> list[tuple[Tensor, bool]]:
        domain = self.case.surface.domain
        unit = [even_coordinate(domain, points, axis, self.even[axis], placement) for axis in (0, 1)]
        columns: list[tuple[Tensor, bool]] = []
        for axis, t in enumerate(unit):
            if domain.periodic[axis] and self.periodic:
                angle = 2 * math.pi * t
                columns += [(compose(f(angle[VALUE], 2), angle), False) for f in (cosine, sine)]
            else:
                centred = 2 * t
                centred[VALUE] -= 1
                columns.append((centred, False))
        if not self.foci:
            return columns
        chords = not any(flag for side in self.even for flag in side) and (self.periodic or not any(domain.periodic))
        if chords:
            x = from_derivatives(self.case.surface.derivatives(points, 2), placement)
        for focus in self.foci:
            for axis in (0, 1):
                if chords:
                    distance = (x @ placement.tensor(focus.tangents[axis])) / focus.layer
                    distance[VALUE] -= float(focus.position @ focus.tangents[axis]) / focus.layer
                    extent = math.asinh(focus.reach / focus.layer)
                else:
                    at, unit_layer = self._parametric_layer(focus, axis)
                    distance = unit[axis] / unit_layer
                    distance[VALUE] -= at / unit_layer
                    extent = math.asinh(max(at, 1 - at) / unit_layer)
                columns.append((compose(_asinh(distance[VALUE], extent), distance), True))
        return columns

    def _parametric_layer(self, focus: Focus, axis: int) -> tuple[float, float]:
        """Return a focus and its layer along a coordinate line, in the scaled (and even) coordinate."""
        domain, even = self.case.surface.domain, self.even[axis]
        x = self.case.surface.derivatives(np.asarray(focus.xi), 1)
        step = focus.layer / float(np.linalg.norm((x[1, 0], x[0, 1])[axis]))
        here = np.array([focus.xi, focus.xi])
        here[1, axis] += step if focus.xi[axis] + step <= domain.upper[axis] else -step
        at, beside = even_coordinate(domain, here, axis, even, Placement())[VALUE].tolist()
        return at, abs(beside - at)


def _asinh(v: Tensor, extent: float) -> tuple[Tensor, Tensor, Tensor]:
    root = torch.sqrt(1 + v * v)
    return torch.asinh(v) / extent, 1 / (root * extent), -v / (root**3 * extent)


def _independent(columns: Tensor) -> tuple[int, ...]:
    """Return the columns that are no linear combination of a constant and earlier columns."""
    basis = [torch.ones_like(columns[:, 0]) / math.sqrt(len(columns))]
    kept = []
    for index, column in enumerate(columns.unbind(1)):
        rest = column.clone()
        for direction in basis * 2:  # twice: Gram-Schmidt loses orthogonality in one pass
            rest = rest - (rest @ direction) * direction
        if rest.norm() > DEPENDENT * column.norm():
            basis.append(rest / rest.norm())
            kept.append(index)
    return tuple(kept)
