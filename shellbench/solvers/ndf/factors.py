"""Boundary factors: the matrix M in u = lift + M F that holds the supports whatever the network says.

Held components carry factors that vanish linearly at their edges; slopes are held by a projector,

    M = D [I - (1 - B) p p^T / (p . p)],   p = P D' a3,

with D the diagonal of the factors, B the factor that vanishes at the slope-held edges, P the components that are held
there, and D' the factors of the other edges. At such an edge u = 0 and u,n . a3 = B,n a3 . (I - p p^T/..) F = 0;
where one factor is common to all components that a3 has, this is B [I - (1 - B) a3 (x) a3] F. Components left free at
a slope-held edge, as on planes of symmetry, get even inputs instead (`inputs`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.places import SIDES, Edge
from shellbench.problems.shell.surface import Domain
from shellbench.solvers.ndf.geometry import contravariant_basis_jet, normal_jet
from shellbench.solvers.ndf.inputs import Sides
from shellbench.solvers.ndf.jets import (
    VALUE,
    Array,
    Placement,
    compose,
    constant,
    coordinates,
    dot,
    matrix_product,
    power,
    product,
    sine,
)
from shellbench.solvers.ndf.supports import TANGENTIAL, EdgeSupport, edge_supports, even_sides

NORMAL_SAMPLES = 17  # points a side of the grid on which a3 is looked at


def edge_factor(domain: Domain, edges: set[Edge], even: Sides, points: Array, placement: Placement) -> Tensor:
    """Return the jet (6, N) of a factor that vanishes linearly at the given edges and is at most 1.

    At a bound where inputs are even, and which it does not hold, the factor is even too.
    """
    factor = constant(placement.tensor(np.ones(len(points))), placement.planes)
    for axis in (0, 1):
        held = [any(e.axis == axis and e.side == side for e in edges) for side in SIDES]
        if not any(held):
            continue
        t = coordinates(points, placement)[axis] / domain.size[axis]
        t[VALUE] = (placement.tensor(points[:, axis]) - domain.lower[axis]) / domain.size[axis]
        from_upper = -t
        from_upper[VALUE] = (domain.upper[axis] - placement.tensor(points[:, axis])) / domain.size[axis]
        if all(held):
            factor = product(factor, 4 * product(t, from_upper))
            continue
        distance, other = (t, 1) if held[0] else (from_upper, 0)
        if even[axis][other]:
            distance = math.pi / 2 * distance
            distance = compose(sine(distance[VALUE]), distance)
        factor = product(factor, distance)
    return factor


@dataclass(frozen=True)
class BoundaryFactors:
    """The matrix M of a case; with `covariant`, times the contravariant basis (u = u_a a^a + u_3 a^3).

    Attributes
    ----------
    case
        Whose supports it holds.
    covariant
        Whether the network gives covariant components instead of Cartesian ones.
    """

    case: Case
    covariant: bool = False

    @cached_property
    def _all_held(self) -> bool:
        return self.case.prescribed

    @cached_property
    def _supports(self) -> tuple[EdgeSupport, ...]:
        return edge_supports(self.case)

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of M at points (N, 2)."""
        if self._all_held:
            return constant(placement.tensor(np.zeros((len(points), 3, 3))))
        even = even_sides(self._supports)
        domain = self.case.surface.domain
        held = [{s.edge for s in self._supports if c in s.held} for c in range(3)]
        matrix = torch.diag_embed(
            torch.stack([edge_factor(domain, edges, even, points, placement) for edges in held], dim=-1)
        )
        tilted = [s for s in self._supports if s.tilted]
        if tilted:
            matrix = matrix_product(matrix, self._projector(tilted, held, even, points, placement))
        if self.covariant:
            matrix = matrix_product(matrix, contravariant_basis_jet(self.case.surface, points, placement))
        return matrix

    def _projector(
        self, tilted: list[EdgeSupport], held: list[set[Edge]], even: Sides, points: Array, placement: Placement
    ) -> Tensor:
        domain, edges = self.case.surface.domain, {s.edge for s in tilted}
        b = edge_factor(domain, edges, even, points, placement)
        p = normal_jet(self.case.surface, points, placement)
        others = [held[c] - edges if all(c in s.held for s in tilted) else None for c in range(3)]
        active = [c for c in range(3) if self._normal_extent[c] > TANGENTIAL]
        mixed = any(others[c] != others[active[0]] for c in active)
        if mixed:
            p = torch.stack(
                [
                    torch.zeros_like(b)
                    if rest is None
                    else product(p[..., c], edge_factor(domain, rest, even, points, placement))
                    for c, rest in enumerate(others)
                ],
                dim=-1,
            )
        length = dot(p, p)
        if mixed:  # p may vanish on other edges; B^2 keeps the quotient smooth and vanishes where it matters
            length = length + product(b, b)
        outer = product(p[..., :, None], p[..., None, :])
        scale = product(power(length, -1.0), b)
        scale = power(length, -1.0) - scale
        identity = constant(torch.eye(3, device=placement.device, dtype=placement.dtype).expand(len(points), 3, 3))
        return identity - product(scale[..., None, None], outer)

    @cached_property
    def _normal_extent(self) -> Array:
        x = self.case.surface.derivatives(self.case.surface.domain.grid(NORMAL_SAMPLES, NORMAL_SAMPLES), 1)
        normal = np.cross(x[1, 0], x[0, 1])
        extent: Array = np.abs(normal / np.linalg.norm(normal, axis=-1, keepdims=True)).max(axis=(0, 1))
        return extent
