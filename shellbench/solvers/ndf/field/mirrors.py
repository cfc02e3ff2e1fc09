"""Planes of symmetry that are built into a field.

If a case has mirrors (see `shellbench.problems.shell.posed.mirrors`), the answer of linear theory is unique, and
therefore its own image. Each of its Cartesian components is even or odd about a plane. So is

    u = M O F,

with the boundary matrix M, a diagonal O of functions with the parity of each component, and features F that are even
about all planes. Energies are integrated over one of the parts into which the planes cut the shell, and multiplied by
the number of parts. The field is one of the whole shell, and smooth across the planes.

The module also finds independent functions of a point by sampling.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product as all_of

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.posed.mirrors import ComparisonPoints, Mirror, mirror_of
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.ndf.field.jets import PLANES, VALUE, Array, Placement, compose, constant, coordinates, sine
from shellbench.solvers.ndf.field.quadrature import ROUNDING, Rule, RuleSpec, area_rule

MIRROR_SAMPLES = 11  # points a side at which functions are compared with their images
Planes = tuple[bool, ...]  # for each mirror, True if it is meant
ONE_POINT = 1e-12  # of a side: images of one point differ by rounding, a thousandth of this
DEPENDENT_INPUT = 1e-6  # an input whose remainder is below this share of its size is left out: rounding leaves 1e-15
ASYMMETRIC = 0.3  # place of a sample in its cell: any but the ends, the middle, and their halves


@dataclass(frozen=True)
class Mirrors:
    """Mirrors whose planes are normal to different Cartesian axes, on a coordinate rectangle."""

    domain: Domain
    each: tuple[Mirror, ...]

    @property
    def parts(self) -> int:
        """Number of parts into which the planes cut the shell."""
        return int(2 ** len(self.each))

    def part(self) -> tuple[Domain, tuple[float, float]]:
        """Return one of the parts, and its shares of the sides."""
        lower, upper, shares = list(self.domain.lower), list(self.domain.upper), [1.0, 1.0]
        for axis in (0, 1):
            planes = [mirror.at for mirror in self.each if mirror.axis == axis]
            if planes:
                # A plane meets an open coordinate in the middle, a closed one twice, half a turn apart.
                closed = self.domain.periodic[axis]
                shares[axis] = 0.5 ** len(planes)
                lower[axis] = min(planes) if closed else lower[axis]
                upper[axis] = lower[axis] + shares[axis] * self.domain.size[axis]
        closed_sides = [p and share == 1.0 for p, share in zip(self.domain.periodic, shares, strict=True)]
        part = Domain((lower[0], lower[1]), (upper[0], upper[1]), (closed_sides[0], closed_sides[1]), self.domain.angle)
        return part, (shares[0], shares[1])

    def rule(self, focal: Array, spec: RuleSpec) -> Rule:
        """Return the points of a rule of the whole shell on one part, with weights for all parts."""
        part, _ = self.part()
        first, second = ((*spec.joints[k], *(m.at for m in self.each if m.axis == k)) for k in (0, 1))
        rule = area_rule(self.domain, focal, replace(spec, joints=(first, second)))
        inside = ((rule.points > part.lower) & (rule.points < part.upper)).all(axis=1)
        return Rule(rule.points[inside], self.parts * rule.weights[inside])

    def images(self, points: Array, about: Planes) -> Iterator[tuple[Array, Array]]:
        """Yield all images (N, 2) of points about some of the planes, and signs (2,) of their coordinates."""
        for applied in all_of(*((False, True)[: 1 + asked] for asked in about)):
            here, signs = np.array(points, dtype=float), np.ones(2)
            for mirror in (mirror for mirror, reflects in zip(self.each, applied, strict=True) if reflects):
                here = mirror.image(here)
                signs[mirror.axis] *= -1
            yield self.domain.wrap(here), signs

    def mean(self, jets: Callable[[Array, Sequence[int]], Tensor], points: Array, about: Sequence[Planes]) -> Tensor:
        """Return the jets (6, N, n) of the means of n functions over their images at points (N, 2).

        `jets` returns those of the functions with given numbers. `about` states, for each function, the planes about
        which it is not even; about the others it is its own image.
        """
        numbers: dict[Planes, list[int]] = {}
        for number, planes in enumerate(about):
            numbers.setdefault(planes, []).append(number)
        columns: dict[int, Tensor] = {}
        for planes, alike in numbers.items():
            places, signs = zip(*self.images(points, planes), strict=True)
            images = jets(np.concatenate(places), alike)
            turned = [[float(one[0] ** i * one[1] ** j) for one in signs] for i, j in PLANES[: len(images)]]
            each = (
                images.view(len(images), len(signs), len(points), images.shape[-1])
                * images.new_tensor(turned)[..., None, None]
            )
            columns |= zip(alike, each.mean(1).unbind(-1), strict=True)
        return torch.stack([columns[k] for k in range(len(about))], dim=-1)

    def fold_onto_part(self, points: Array) -> tuple[Array, NDArray[np.intp]]:
        """Return points (n, 2) of one part, and the numbers (N,) of those whose images the points (N, 2) are."""
        here = np.array(points, dtype=float)
        for mirror in self.each:
            image = self.domain.wrap(mirror.image(here))
            here = np.where((image[:, mirror.axis] < here[:, mirror.axis])[:, None], image, here)
        steps = np.round((here - self.domain.lower) / (ONE_POINT * np.asarray(self.domain.size)))
        here = np.where(steps == 0, self.domain.lower, here)  # powers of the distance from a corner magnify rounding
        first, second = steps.T
        _, chosen, number = np.unique(first + 1j * second, return_index=True, return_inverse=True)
        return here[chosen], number

    def odd_jets(self, points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, 3) of functions with each component's parity about its plane, even about others."""
        columns = [constant(placement.tensor(np.ones(len(points))), placement.planes)] * 3
        for mirror in self.each:
            size, t = self.domain.size[mirror.axis], coordinates(points, placement)[mirror.axis]
            t[VALUE] -= mirror.at
            if self.domain.periodic[mirror.axis]:
                angle = 2 * math.pi / size * t
                columns[mirror.normal] = compose(sine(angle[VALUE], 2), angle)
            else:
                columns[mirror.normal] = 2 / size * t
        return torch.stack(columns, dim=-1)

    def parity(self, values: Callable[[Array], Tensor]) -> Tensor:
        """Return the parity (k, n) of functions about each of the planes: even (1), odd (-1) or neither (0).

        `values` returns n functions (N, n) at points (N, 2).
        """
        points = samples(self.domain)
        here = values(points)
        size = ROUNDING * here.abs().amax(0)
        rows = []
        for mirror in self.each:
            there = values(self.domain.wrap(mirror.image(points)))
            even, odd = ((here - sign * there).abs().amax(0) <= size for sign in (1, -1))
            rows.append(torch.where(even, 1, torch.where(odd, -1, 0)))
        return torch.stack(rows) if rows else here.new_zeros((0, here.shape[1]))


def inner_shares(count: int) -> Array:
    """Return evenly spaced shares (count,) of a side, no two of which are symmetric to its middle."""
    return np.asarray((np.arange(count) + ASYMMETRIC) / count)


def samples(domain: Domain) -> Array:
    """Return points (N, 2) within the rectangle that no reflection maps onto each other's lines."""
    inside = inner_shares(MIRROR_SAMPLES)
    grid = np.stack(np.meshgrid(inside, inside, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.asarray(np.asarray(domain.lower) + grid * np.asarray(domain.size))


def mirrors_of(case: Case) -> Mirrors:
    """Return the mirrors of a linear case at rest that can be built into its field; there may be none."""
    domain = case.surface.domain
    held = all(isinstance(place, Edge) and not support.motion for support, place in case.supported_places())
    moments = any(isinstance(load, MomentLoad) for load in case.loads)
    others = moments or case.focus or case.obstacles or case.dynamics or any(case.kinks)
    found: list[Mirror] = []
    if held and not others and case.linear and not case.modal:
        sight = ComparisonPoints.spread_over(case)
        for axis, (start, size) in enumerate(zip(domain.lower, domain.size, strict=True)):
            for at in (start, start + size / 4) if domain.periodic[axis] else (start + size / 2,):
                mirror = mirror_of(case, axis, at, sight)
                if mirror is not None and all(mirror.normal != other.normal for other in found):
                    found.append(mirror)
    return Mirrors(domain, tuple(found))


def independent_columns(columns: Tensor, usable: list[bool]) -> tuple[int, ...]:
    """Return the usable columns that are no linear combination of a constant and earlier ones."""
    basis = [torch.ones_like(columns[:, 0]) / math.sqrt(len(columns))]
    kept = []
    for index, column in enumerate(columns.unbind(1)):
        if not usable[index]:
            continue
        rest = column.clone()
        for direction in basis * 2:  # twice: Gram-Schmidt loses orthogonality in one pass
            rest = rest - (rest @ direction) * direction
        if rest.norm() > DEPENDENT_INPUT * column.norm():
            basis.append(rest / rest.norm())
            kept.append(index)
    return tuple(kept)
