"""Planes of symmetry of a shell, its supports and its loads: found in the case, and built into the field.

A reflection maps the coordinate rectangle onto itself, xi_a -> 2 c - xi_a, and the surface onto its mirror image: one
Cartesian component changes its sign. Where supports, loads and stiffness are their own images, too, so is the answer of
linear theory, as it is the only one. Each of its components then is even about a plane, or odd about it. So is

    u = M O F,

with the boundary matrix M, a diagonal O of functions that are odd where a component is, and features F that are even
about all planes. Energies are integrated over one of the parts that planes cut the shell into, and multiplied by the
number of parts. The field itself is one of the whole shell, and smooth across the planes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product as all_of

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import AreaLoad, GravityLoad, PointLoad, PressureLoad
from shellbench.problems.shell.places import Edge, Point, Side
from shellbench.problems.shell.surface import Domain
from shellbench.solvers.ndf.jets import PLANES, VALUE, Array, Placement, compose, constant, coordinates, sine
from shellbench.solvers.ndf.quadrature import Rule, RuleSpec, area_rule
from shellbench.solvers.ndf.supports import edge_supports, force_density

SAMPLES = 11  # points a side at which a shell is compared with its mirror image
SAME = 1e-9  # of the size of what is compared: far above rounding


@dataclass(frozen=True)
class Mirror:
    """A reflection: coordinate `axis` about the value `at`, and the Cartesian `component` that changes its sign."""

    axis: int
    at: float
    component: int

    def image(self, points: Array) -> Array:
        """Return the mirror images (N, 2) of points, periodic coordinates in any period."""
        images = np.array(points, dtype=float)
        images[..., self.axis] = 2 * self.at - images[..., self.axis]
        return images


@dataclass(frozen=True)
class Mirrors:
    """Reflections of different Cartesian components, on a coordinate rectangle."""

    domain: Domain
    each: tuple[Mirror, ...]

    @property
    def parts(self) -> int:
        """Number of parts that the planes cut the shell into."""
        return int(2 ** len(self.each))

    def part(self) -> tuple[Domain, tuple[float, float]]:
        """Return one of them, and its shares of the sides."""
        lower, upper, shares = list(self.domain.lower), list(self.domain.upper), [1.0, 1.0]
        for axis in (0, 1):
            planes = [mirror.at for mirror in self.each if mirror.axis == axis]
            if planes:
                # A plane meets an open coordinate in the middle, a closed one twice, half a turn apart.
                closed = self.domain.periodic[axis]
                shares[axis] = 0.5 ** len(planes)
                lower[axis] = min(planes) if closed else lower[axis]
                upper[axis] = lower[axis] + shares[axis] * self.domain.size[axis]
        open_axes = [p and share == 1.0 for p, share in zip(self.domain.periodic, shares, strict=True)]
        part = Domain((lower[0], lower[1]), (upper[0], upper[1]), (open_axes[0], open_axes[1]), self.domain.angle)
        return part, (shares[0], shares[1])

    def rule(self, focal: Array, spec: RuleSpec) -> Rule:
        """Return a rule on one part whose weights stand for all parts; `spec` is one of the whole shell."""
        part, shares = self.part()
        first, second = (max(1, round(n * share)) for n, share in zip(spec.panels, shares, strict=True))
        rule = area_rule(part, focal, replace(spec, panels=(first, second)))
        return Rule(rule.points, self.parts * rule.weights)

    def images(self, points: Array) -> Iterator[tuple[Array, Array, Array]]:
        """Yield all images (N, 2) of points, signs (2,) of coordinates and (3,) of Cartesian components."""
        for applied in all_of((False, True), repeat=len(self.each)):
            here, coordinate_signs, component_signs = np.array(points, dtype=float), np.ones(2), np.ones(3)
            for mirror, reflects in zip(self.each, applied, strict=True):
                if reflects:
                    here = mirror.image(here)
                    coordinate_signs[mirror.axis] *= -1
                    component_signs[mirror.component] *= -1
            yield self.domain.wrap(here), coordinate_signs, component_signs

    def mean(self, jets: Callable[[Array], Tensor], points: Array) -> Tensor:
        """Return the jets (6, N, ...) of the mean over all images of functions, from their jets at points (N, 2)."""
        total: Tensor | None = None
        for here, signs, _ in self.images(points):
            image = jets(here)
            turned = [float(signs[0] ** i * signs[1] ** j) for i, j in PLANES[: len(image)]]
            image = image * image.new_tensor(turned).view(-1, *(1,) * (image.dim() - 1))
            total = image if total is None else total + image
        assert total is not None
        return total / self.parts

    def mean_of_vectors(self, vectors: Callable[[Array], Array], points: Array) -> Array:
        """Return the mean (N, 3, ...) over all images of vector fields, each mirrored back."""
        values = [
            signs.reshape(3, *(1,) * (vectors(here).ndim - 2)) * vectors(here) for here, _, signs in self.images(points)
        ]
        return np.asarray(np.mean(values, axis=0))

    def odd(self, points: Array, placement: Placement) -> Tensor:
        """Return the jets (6, N, 3) of functions that are odd where a component is, and even about all other planes."""
        columns = [constant(placement.tensor(np.ones(len(points))), placement.planes)] * 3
        for mirror in self.each:
            size, t = self.domain.size[mirror.axis], coordinates(points, placement)[mirror.axis]
            t[VALUE] -= mirror.at
            if self.domain.periodic[mirror.axis]:
                angle = 2 * math.pi / size * t
                columns[mirror.component] = compose(sine(angle[VALUE], 2), angle)
            else:
                columns[mirror.component] = 2 / size * t
        return torch.stack(columns, dim=-1)

    def parity(self, values: Callable[[Array], Tensor]) -> Tensor:
        """Return (k, n): whether functions are even (1), odd (-1) or neither (0) about each of the planes.

        `values` gives n functions (N, n) at points (N, 2).
        """
        points = samples(self.domain)
        here = values(points)
        size = SAME * here.abs().amax(0)
        rows = []
        for mirror in self.each:
            there = values(self.domain.wrap(mirror.image(points)))
            even, odd = ((here - sign * there).abs().amax(0) <= size for sign in (1, -1))
            rows.append(torch.where(even, 1, torch.where(odd, -1, 0)))
        return torch.stack(rows) if rows else here.new_zeros((0, here.shape[1]))


def samples(domain: Domain) -> Array:
    """Return points (N, 2) within the rectangle that no reflection maps onto each other's lines."""
    inside = (np.arange(SAMPLES) + 0.3) / SAMPLES
    grid = np.stack(np.meshgrid(inside, inside, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.asarray(np.asarray(domain.lower) + grid * np.asarray(domain.size))


def mirrors_of(case: Case) -> Mirrors:
    """Return the reflections that a linear case at rest is its own image under; there may be none.

    Planes are normal to Cartesian axes. Conditions whose images this does not look at have none.
    """
    domain = case.surface.domain
    none = Mirrors(domain, ())
    loads = all(isinstance(load, PointLoad | AreaLoad | GravityLoad | PressureLoad) for load in case.loads)
    held = all(isinstance(place, Edge) and place.whole for _, place in case.supported_places())
    moved = any(support.motion for support in case.supports)
    others = case.springs or case.obstacles or case.dynamics or any(case.kinks)
    if not loads or not held or moved or others or not case.linear or case.modal:
        return none
    found: list[Mirror] = []
    for axis in (0, 1):
        start, size = domain.lower[axis], domain.size[axis]
        for at in (start, start + size / 4) if domain.periodic[axis] else (start + size / 2,):
            for component in range(3):
                taken = any(mirror.component == component for mirror in found)
                mirror = Mirror(axis, at, component)
                if not taken and _is_its_image(case, mirror):
                    found.append(mirror)
                    break
    return Mirrors(domain, tuple(found))


def _is_its_image(case: Case, mirror: Mirror) -> bool:
    domain, sign = case.surface.domain, np.ones(3)
    sign[mirror.component] = -1
    points = samples(domain)
    images = domain.wrap(mirror.image(points))
    # 1. The surface, but for a shift of the plane.
    x, mirrored = case.surface.position(points), sign * case.surface.position(images)
    shift = (x - mirrored).mean(axis=0)
    size = np.abs(x - x.mean(axis=0)).max()
    if np.abs(x - mirrored - shift).max() > SAME * size:
        return False
    for here, there in zip(
        *(case.material.factors(p, case.surface.named_constants) for p in (points, images)), strict=True
    ):
        if np.abs(here - there).max() > SAME * np.abs(here).max():
            return False
    # 2. What each edge holds.
    held = {(s.edge.axis, s.edge.side): (set(s.held), s.slope is not None) for s in edge_supports(case)}
    for (axis, side), conditions in held.items():
        other: Side = "max" if side == "min" else "min"
        if held.get((axis, other if axis == mirror.axis else side)) != conditions:
            return False
    # 3. Loads on areas, and at points; points that are named as foci count as without a force.
    force, there = force_density(case, points), sign * force_density(case, images)
    if np.abs(force - there).max() > SAME * np.abs(force).max(initial=0.0):
        return False
    forces = _point_forces(case)
    for at, vector in forces:
        image = domain.wrap(mirror.image(np.asarray(at)))
        same = [v for xi, v in forces if _distance(domain, np.asarray(xi), image) <= SAME]
        if not same or np.abs(sum(same) - sign * vector).max() > SAME * np.abs(vector).max(initial=0.0):
            return False
    return True


def _point_forces(case: Case) -> list[tuple[tuple[float, float], Array]]:
    forces: dict[tuple[float, float], Array] = {}
    for load in case.loads:
        for name in load.on if isinstance(load, PointLoad) else ():
            place = case.places[name]
            if isinstance(place, Point) and isinstance(load, PointLoad):
                force = np.asarray(case.evaluate(load.force, np.array([place.xi]), 1.0)[0, 0][0])
                forces[place.xi] = forces.get(place.xi, np.zeros(3)) + force
    for name in case.focus:
        place = case.places[name]
        if isinstance(place, Point):
            forces.setdefault(place.xi, np.zeros(3))
    return list(forces.items())


def _distance(domain: Domain, one: Array, other: Array) -> float:
    """Return the largest difference of coordinates, in units of the sides."""
    apart = np.abs(one - other) / np.asarray(domain.size)
    return float(np.where(domain.periodic, np.minimum(apart, 1 - apart), apart).max())
