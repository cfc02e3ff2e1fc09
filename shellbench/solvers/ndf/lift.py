"""The lift: a smooth displacement that moves every support as the case prescribes, on which the field adds the rest.

Each held component is blended by itself from the motions of the edges that hold it. A weight is one on its own edge
and zero on the opposite one, with vanishing slope at both, so that the lift has a clamped edge's own slope. Edges of
both coordinates meet at corners: they are joined there as a Coons patch (Coons 1967), which is exact on all edges
where the prescribed motions agree at the corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import Support, Value
from shellbench.problems.shell.places import Edge, Whole
from shellbench.solvers.ndf.jets import (
    PLANES,
    VALUE,
    Array,
    Placement,
    compose,
    constant,
    coordinates,
    from_derivatives,
    product,
)
from shellbench.solvers.ndf.supports import edge_supports

Moved = list[tuple[Edge, Support]]


def edge_weight(case: Case, edge: Edge, alone: bool, points: Array, placement: Placement) -> Tensor:
    """Return the jet (6, N) of an edge's weight: the cubic smoothstep across the shell, or one if it is `alone`."""
    if alone:
        return constant(placement.tensor(np.ones(len(points))))
    domain = case.surface.domain
    t = coordinates(points, placement)[edge.axis] / domain.size[edge.axis]
    t[VALUE] = placement.tensor((points[:, edge.axis] - domain.lower[edge.axis]) / domain.size[edge.axis])
    if edge.side == "min":
        t = -t
        t[VALUE] = placement.tensor((domain.upper[edge.axis] - points[:, edge.axis]) / domain.size[edge.axis])
    v = t[VALUE]
    return compose((v * v * (3 - 2 * v), 6 * v * (1 - v), 6 - 12 * v), t)


@dataclass(frozen=True)
class Lift:
    """The prescribed motions of a case, extended to the whole shell; `t` is the load factor."""

    case: Case
    t: float = 1.0

    @cached_property
    def _edges(self) -> tuple[Moved, Moved, Moved]:
        supports = edge_supports(self.case)
        x, y, z = ([(s.edge, s.held[c]) for s in supports if c in s.held] for c in range(3))
        return x, y, z

    @cached_property
    def _whole(self) -> tuple[Support, Whole] | None:
        found = [(s, place) for s, place in self.case.supported_places() if isinstance(place, Whole) and s.motion]
        return found[0] if found else None

    @property
    def moves(self) -> bool:
        """Whether any edge is moved at all."""
        return self._whole is not None or any(support.motion for edges in self._edges for _, support in edges)

    def jet(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3) of the lift at points (N, 2)."""
        if self._whole is not None:
            return from_derivatives(self.case.motion(*self._whole, points, self.t, 2), placement)
        zero = constant(placement.tensor(np.zeros(len(points))))
        columns = [
            self._component(c, edges, points, placement) if any(s.motion for _, s in edges) else zero
            for c, edges in enumerate(self._edges)
        ]
        return torch.stack(columns, dim=-1)

    def _component(self, c: int, edges: Moved, points: Array, placement: Placement) -> Tensor:
        first_motion = edges[0][1].motion
        if not isinstance(first_motion, Value) and all(s.motion == first_motion for _, s in edges):
            return self._motion(*edges[0], points, placement)[..., c]
        sides = [[(e, s) for e, s in edges if e.axis == axis] for axis in (0, 1)]
        if not (sides[0] and sides[1]):
            return self._across(c, sides[0] or sides[1], points, placement)
        first = self._across(c, sides[0], points, placement, frozen=True)
        for edge, support in sides[1]:
            motion = self._frozen(edge, support, points, placement)[..., c]
            for other, _ in sides[0]:  # what the other pair of edges has put here already
                corner = other.project(self.case.surface.domain, edge.project(self.case.surface.domain, points))
                value = self._motion(edge, support, corner, placement)[VALUE, :, c]
                weight = edge_weight(self.case, other, len(sides[0]) == 1, points, placement)
                motion = motion - product(weight, constant(value))
            weight = edge_weight(self.case, edge, len(sides[1]) == 1, points, placement)
            first = first + product(weight, motion)
        return first

    def _across(self, c: int, edges: Moved, points: Array, placement: Placement, frozen: bool = False) -> Tensor:
        total = constant(placement.tensor(np.zeros(len(points))))
        for edge, support in edges:
            motion = (self._frozen if frozen else self._motion)(edge, support, points, placement)
            weight = edge_weight(self.case, edge, len(edges) == 1, points, placement)
            total = total + product(weight, motion[..., c])
        return total

    def _motion(self, edge: Edge, support: Support, points: Array, placement: Placement) -> Tensor:
        return from_derivatives(self.case.motion(support, edge, points, self.t, 2), placement)

    def _frozen(self, edge: Edge, support: Support, points: Array, placement: Placement) -> Tensor:
        """Return the motion on the edge itself, constant along the other coordinate."""
        jet = self._motion(edge, support, edge.project(self.case.surface.domain, points), placement)
        across = [plane for plane, orders in enumerate(PLANES) if orders[edge.axis]]
        jet[across] = 0.0
        return jet
