"""Inputs of the network at a point: coordinates as jets, derived from the case alone.

A plain coordinate is scaled to [-1, 1]. A periodic coordinate becomes (cos, sin). Two ablations replace this: by the
cosine alone (the field is then even about the seam: it closes, but can't distinguish the two sides), or by a plain
coordinate (the field is then that of a slit shell). At an edge that holds the slope of free components, the coordinate
is bent so that its derivative vanishes there. Strips between folds have inputs of their own (`strips`).

Distances from points that carry a force, and from the edges of curved shells, are additional inputs, stretched as
asinh(d / l) / asinh(reach / l): there the solution varies within the length l of a bending layer. Distances from lines
along which loads or stiffnesses have kinks are inputs too.

The module first derives these lengths. A shell bends within layers of the length sqrt(h R), R the smallest radius of
curvature, far below its size, around points that carry a force and along edges.

Every input is even about the planes of symmetry that are built into a field (see `mirrors`). An odd input, which goes
from -1 to 1, becomes 2 z^2 - 1. An input that is neither, such as the distance from one of two edges, becomes the mean
of its images.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.mirrors import Mirror
from shellbench.problems.shell.question.features import quick_lines
from shellbench.problems.shell.question.loads import PointLoad
from shellbench.problems.shell.question.places import Point
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.ndf.field.choices import LAYER, PeriodicInput, Slopes
from shellbench.solvers.ndf.field.geometry import SURFACE_SAMPLES, surface_size
from shellbench.solvers.ndf.field.jets import (
    VALUE,
    Activation,
    Array,
    Placement,
    compose,
    coordinates,
    cosine,
    from_derivatives,
    sine,
)
from shellbench.solvers.ndf.field.mirrors import Mirrors, Planes, independent_columns
from shellbench.solvers.ndf.field.quadrature import ROUNDING
from shellbench.solvers.ndf.field.strips import Strip, strip_input, strips_along
from shellbench.solvers.ndf.field.supports import Sides, edge_supports, even_sides, point_supports

EDGE_LAYER = 1.0  # the same along an edge; between .4 and 1 the certified energy of a hyperbolic paraboloid is flat
# l in units of the shell's size at most, and where it is flat: as `LAYER` for R / h = 100. Half of it changes the
# certified energy of a clamped plate, the Scordelis-Lo roof, a pinched cylinder and a clamped hyperboloid by 3e-6 at
# most, up or down; twice as much by 5e-8.
WIDEST_LAYER = 0.12

# For quickly varying stiffness: waves are as fine there, for any width. Neighbours are not on record.
WIDEST_STRETCH = 5.0


@dataclass(frozen=True)
class Focus:
    """A point that carries a force, and the lengths of the solution around it.

    Attributes
    ----------
    xi
        (xi1, xi2), radians for angles.
    position, tangents
        (3,), (2, 3): its position, and an orthonormal basis of the tangent plane; the first along a_1.
    reach
        Length over which the solution is plate-like, metres: the smallest radius of curvature or the size.
    layer
        Length of the bending layer l, metres.
    """

    xi: tuple[float, float]
    position: Array
    tangents: Array
    reach: float
    layer: float


def foci(case: Case, layer: float = LAYER) -> tuple[Focus, ...]:
    """Return the points of a case that carry a force: loads and supports at points, narrow loads, and its `focus`."""
    loaded = [*case.focus, *(name for load in case.loads if isinstance(load, PointLoad) for name in load.on)]
    places = [case.places[name] for name in loaded] + [s.point for s in point_supports(case)]
    narrow = [peak for feature in case.features for peak in feature.peaks]
    distinct = dict.fromkeys([*(place.xi for place in places if isinstance(place, Point)), *narrow])
    return tuple(_focus(case, xi, layer) for xi in distinct)


def _focus(case: Case, xi: tuple[float, float], layer: float) -> Focus:
    x = case.surface.derivatives(np.asarray(xi), 1)
    first = x[1, 0] / np.linalg.norm(x[1, 0])
    second = x[0, 1] - (x[0, 1] @ first) * first
    second /= np.linalg.norm(second)
    size, curvature = surface_size(case), strongest_curvature(case, np.asarray([xi]))
    reach = min(size, 1 / curvature) if curvature else size
    return Focus(xi, x[0, 0], np.stack([first, second]), reach, layer_length(case, curvature, layer, size))


def layer_length(case: Case, curvature: float, layer: float, size: float) -> float:
    """Return `layer` sqrt(h R), metres, or a share of the size if that is less or the shell is flat."""
    if not curvature:
        return WIDEST_LAYER * size
    return min(layer * math.sqrt(case.material.thickness / curvature), WIDEST_LAYER * size)


def strongest_curvature(case: Case, points: Array | None = None) -> float:
    """Return the largest principal curvature, 1/m, at points (n, 2) or anywhere; zero for a flat surface."""
    if points is None:
        points = case.surface.domain.grid(SURFACE_SAMPLES, SURFACE_SAMPLES).reshape(-1, 2)
    x = case.surface.derivatives(points, 2)
    a = np.stack([x[1, 0], x[0, 1]], axis=-2)
    normal = np.cross(x[1, 0], x[0, 1])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    b11, b12, b22 = ((x[key] * normal).sum(-1) for key in ((2, 0), (1, 1), (0, 2)))
    b = np.stack([np.stack([b11, b12], axis=-1), np.stack([b12, b22], axis=-1)], axis=-2)
    principal = np.linalg.eigvals(np.linalg.solve(a @ np.swapaxes(a, -1, -2), b))
    strongest = float(np.abs(principal).max())
    return strongest if strongest * surface_size(case) > ROUNDING else 0.0


def edge_layers(case: Case, flat: bool = False) -> tuple[float, float] | None:
    """Return the lengths of the layers at the edges of xi1 and of xi2, in those coordinates.

    None for a flat shell, unless `flat` is set. The layers of a flat shell have the decay length of an edge's effects
    in a strip as wide as the shorter side (exp(-pi x / width)), or a share of the size.
    """
    curvature = strongest_curvature(case)
    if not curvature and not flat:
        return None
    domain = case.surface.domain
    middle = [(low + high) / 2 for low, high in zip(domain.lower, domain.upper, strict=True)]
    x = case.surface.derivatives(np.asarray(middle), 1)
    speeds = [float(np.linalg.norm(d)) for d in (x[1, 0], x[0, 1])]
    sides = [speed * size for speed, size in zip(speeds, domain.size, strict=True)]
    most = min(sides) / math.pi if not curvature else math.inf
    first, second = (
        min(layer_length(case, curvature, EDGE_LAYER, side), most) / speed
        for side, speed in zip(sides, speeds, strict=True)
    )
    return first, second


INPUT_SAMPLES = 24  # points a side of the grid on which inputs are tested for linear independence


def even_coordinate(domain: Domain, points: Array, axis: int, even: tuple[bool, bool], placement: Placement) -> Tensor:
    """Return the jet (6, N) of a coordinate scaled to [0, 1], with vanishing slope at the bounds of even inputs."""
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
        Form of periodic coordinates.
    foci
        Points about which stretched coordinates are added.
    edges
        Lengths of the layers at edges, in xi1 and xi2, if coordinates are stretched toward edges.
    even
        Bounds at which every input is even.
    kept
        Numbers of the candidate columns that are used: those independent of the earlier ones.
    mirrors
        Planes about which all of them are even.
    hinged
        Axis and value of lines with features of their own, toward which no coordinate is stretched.
    squared
        Candidates that enter as 2 z^2 - 1.
    averaged
        Planes about which each candidate enters as the mean of its images.
    """

    case: Case
    periodic: PeriodicInput
    foci: tuple[Focus, ...]
    edges: tuple[float, float] | None
    even: Sides
    kept: tuple[int, ...]
    mirrors: Mirrors | None = None
    hinged: tuple[tuple[int, float], ...] = ()
    squared: tuple[int, ...] = ()
    averaged: tuple[Planes, ...] = ()

    @classmethod
    def from_case(
        cls,
        case: Case,
        periodic: PeriodicInput = "both",
        around: tuple[Focus, ...] = (),
        edges: tuple[float, float] | None = None,
        slopes: Slopes = "even",
        mirrors: Mirrors | None = None,
        hinged: tuple[tuple[int, float], ...] = (),
    ) -> Inputs:
        """Derive the inputs of a case, with stretched coordinates around the given foci and at edges.

        If only cosines enter, inputs that are not even about the seam are left out.
        """
        even = even_sides(edge_supports(case), slopes)
        candidates = cls(case, periodic, around, edges, even, (), hinged=hinged)
        domain = case.surface.domain
        if mirrors is not None:
            parity = mirrors.parity(candidates.values)
            squared = tuple(torch.nonzero((parity == -1).any(0))[:, 0].tolist())
            averaged = tuple(tuple(planes) for planes in (parity == 0).T.tolist())
            candidates = replace(candidates, mirrors=mirrors, squared=squared, averaged=averaged)
        values = candidates.values
        columns = values(domain.grid(INPUT_SAMPLES, INPUT_SAMPLES).reshape(-1, 2))
        usable = (seam_mirrors(domain, periodic).parity(values) == 1).all(0).tolist()
        return replace(candidates, kept=independent_columns(columns, usable))

    def values(self, points: Array) -> Tensor:
        """Return the values (N, n) of all candidates at points (N, 2)."""
        return self._jets_of(range(len(self._flags)), points, Placement(planes=1))[VALUE]

    @property
    def count(self) -> int:
        """Number of input coordinates n."""
        return len(self.kept)

    @property
    def stretched(self) -> tuple[bool, ...]:
        """For each input, True if it is stretched."""
        return tuple(self._flags[k] for k in self.kept)

    @property
    def from_edges(self) -> tuple[bool, ...]:
        """For each input, True if it is stretched toward an edge."""
        flags = self._flags
        last = flags.index(True) + len(self._stretched_lines()) if any(flags) else 0
        return tuple(flags[k] and k < last for k in self.kept)

    @property
    def axes(self) -> tuple[int | None, ...]:
        """For each input, its coordinate; None for a stretched one."""
        turns = self.case.surface.domain.periodic if self.periodic == "both" else (False, False)
        strips = [len(strips_along(self.case.surface, axis)) for axis in (0, 1)]
        counts = [n + 2 * turn if n else 1 + turn for n, turn in zip(strips, turns, strict=True)]
        plain = [axis for axis in (0, 1) for _ in range(counts[axis])]
        return tuple(plain[k] if k < len(plain) else None for k in self.kept)

    def jets(self, points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, n) of the inputs at points (N, 2), angles in radians."""
        return self._jets_of(self.kept, points, placement)

    @property
    def _flags(self) -> list[bool]:
        return [stretched for _, stretched in self._candidates(np.zeros((0, 2)), Placement())]

    def _jets_of(self, numbers: Sequence[int], points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, n) of candidates with these numbers."""

        def before(images: Array, some: Sequence[int]) -> Tensor:
            candidates, columns = self._candidates(images, placement), []
            for k in some:
                column = candidates[numbers[k]][0]()
                if numbers[k] in self.squared:
                    z = column[VALUE]
                    column = compose((2 * z * z - 1, 4 * z, torch.full_like(z, 4)), column)
                columns.append(column)
            return torch.stack(columns, dim=-1)

        if self.mirrors is None:
            return before(points, range(len(numbers)))
        return self.mirrors.mean(before, points, [self.averaged[k] for k in numbers])

    def _candidates(self, points: Array, placement: Placement) -> list[tuple[Callable[[], Tensor], bool]]:
        """Return for each candidate a function of its jet (6, N) without mirrors, and True if it is stretched."""
        # 1. Plain coordinates: cosine and sine of a periodic one, else the coordinate scaled to [-1, 1].
        # 2. Distances from edges, kinks and lines of quick stiffness, stretched.
        # 3. Distances from foci, stretched: along the tangents, or along the coordinates if inputs have to be even.
        domain = self.case.surface.domain

        @cache
        def unit(axis: int) -> Tensor:
            return even_coordinate(domain, points, axis, self.even[axis], placement)

        @cache
        def position() -> Tensor:
            return from_derivatives(self.case.surface.derivatives(points, placement.order), placement)

        def turned(function: Activation, axis: int) -> Tensor:
            angle = 2 * math.pi * unit(axis)
            return compose(function(angle[VALUE], placement.order), angle)

        def centred(axis: int) -> Tensor:
            t = 2 * unit(axis)
            t[VALUE] -= 1
            return t

        def along(axis: int, start: float, layer: float, widest: float) -> Tensor:
            return self._stretched_along(axis, start, layer, widest, unit(axis))

        def chord(focus: Focus, axis: int) -> Tensor:
            distance = (position() @ placement.tensor(focus.tangents[axis])) / focus.layer
            distance[VALUE] -= float(focus.position @ focus.tangents[axis]) / focus.layer
            return _stretched(distance, focus.reach / focus.layer)

        def beside(focus: Focus, axis: int) -> Tensor:
            x_focus = self.case.surface.derivatives(np.asarray(focus.xi), 1)
            layer = focus.layer / float(np.linalg.norm((x_focus[1, 0], x_focus[0, 1])[axis]))
            return along(axis, focus.xi[axis], layer, math.inf)

        def in_strip(axis: int, strip: Strip) -> Tensor:
            return strip_input(self.case.surface, axis, strip, points, placement)

        columns: list[tuple[Callable[[], Tensor], bool]] = []
        for axis in (0, 1):
            if domain.periodic[axis] and self.periodic != "none":
                functions = (cosine, sine)[: 2 if self.periodic == "both" else 1]
                columns += [(partial(turned, f, axis), False) for f in functions]
            elif not strips_along(self.case.surface, axis):
                columns.append((partial(centred, axis), False))
            columns += [(partial(in_strip, axis, strip), False) for strip in strips_along(self.case.surface, axis)]
        columns += [(partial(along, *line), True) for line in self._stretched_lines()]
        chords = not any(flag for side in self.even for flag in side) and not (
            self.periodic == "none" and any(domain.periodic)
        )
        columns += [(partial(chord if chords else beside, focus, axis), True) for focus in self.foci for axis in (0, 1)]
        return columns

    def _stretched_lines(self) -> list[tuple[int, float, float, float]]:
        """Return axis, coordinate, length of the layer and widest stretch of the lines of stretched coordinates.

        These lines are edges, kinks, and places where stiffness varies quickly.
        """
        domain = self.case.surface.domain
        if not self.edges:
            return []
        open_axes = [axis for axis in (0, 1) if not domain.periodic[axis]]
        bounds = (domain.lower, domain.upper)
        lines = [(a, bounds[n][a], self.edges[a], math.inf) for a in open_axes for n in (0, 1) if not self.even[a][n]]
        lines += [(a, at, self.edges[a], math.inf) for a in open_axes for at in self.case.kinks[a]]
        quick = [(a, *line) for a in open_axes for line in quick_lines(self.case, a)]
        return lines + [(a, at, layer, WIDEST_STRETCH) for a, at, layer in quick if (a, at) not in self.hinged]

    def _stretched_along(self, axis: int, start: float, layer: float, widest: float, unit: Tensor) -> Tensor:
        """Return the stretched distance from a value of one coordinate; even at the same bounds as the coordinate."""
        domain = self.case.surface.domain
        here = np.full((2, 2), start)
        here[1] += layer if start + layer <= domain.upper[axis] else -layer
        at, beside = even_coordinate(domain, here, axis, self.even[axis], Placement())[VALUE].tolist()
        distance = unit / abs(beside - at)
        distance[VALUE] -= at / abs(beside - at)
        return _stretched(distance, max(at, 1 - at) / abs(beside - at), widest)


def _stretched(distance: Tensor, reach: float, widest: float = math.inf) -> Tensor:
    """Return the jet of asinh(d) / asinh(reach), d in units of the layer, or over `widest` if that is less."""
    v, extent = distance[VALUE], min(math.asinh(reach), widest)
    root = torch.sqrt(1 + v * v)
    return compose((torch.asinh(v) / extent, 1 / (root * extent), -v / (root**3 * extent)), distance)


def seam_mirrors(domain: Domain, periodic: PeriodicInput) -> Mirrors:
    """Return the lines about which all features must be even, because the field is even about a seam."""
    closed = [axis for axis in (0, 1) if domain.periodic[axis] and periodic == "cosine"]
    return Mirrors(domain, tuple(Mirror(axis, domain.lower[axis], normal=axis) for axis in closed))
