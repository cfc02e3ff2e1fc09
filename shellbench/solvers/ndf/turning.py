"""Clamped edges that turn by finite angles: they carry the shell, its normals, and the field's own axes along.

Each edge's motion is a rigid one, scaled by the edge's weight: one on the edge, with vanishing slope, and zero on the
opposite edge. The lift is the composition of these motions, x -> T_1(T_2(x)): to first order in the distance from an
edge it is the rigid motion of that edge, so that the edge is clamped at any angle. The field's components are those on
axes that turn with it,

    u = lift + Q M F,    Q = R_1(w_1 angle_1) R_2(w_2 angle_2),

with the boundary matrix M of the undeformed shell (`factors`): on an edge Q is its rotation R, and the projector of M
becomes the one along the turned normal R a3. A tube whose rims are turned against each other is so far twisted as it is
by small angles that F hardly changes from step to step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import MomentLoad, Rotation, Translation
from shellbench.problems.shell.places import Point
from shellbench.solvers.ndf.factors import edge_weight
from shellbench.solvers.ndf.field import Factors
from shellbench.solvers.ndf.jets import (
    VALUE,
    Array,
    Placement,
    compose,
    constant,
    cosine,
    from_derivatives,
    matrix_product,
    product,
    sine,
)
from shellbench.solvers.ndf.supports import EdgeSupport, edge_supports


def turns(case: Case) -> bool:
    """Tell whether a clamped edge turns by a finite angle."""
    return not case.linear and any(s.clamped and isinstance(s.motion, Rotation) for s in case.supports)


def why_not_turned(case: Case) -> str | None:
    """Return why the clamped edges of a case can't be turned by finite angles, as one clause, or None if they can."""
    if not turns(case):
        return None
    name = next(s.name for s in case.supports if s.clamped and isinstance(s.motion, Rotation))
    turn = f"it can't turn the clamped support '{name}' by finite angles"
    supports = edge_supports(case)
    if case.dynamics is not None:
        return f"{turn} in motion"
    if len({s.edge.axis for s in supports}) > 1:
        return f"{turn} where supported edges meet"
    if any(isinstance(place, Point) for _, place in case.supported_places()):
        return f"{turn} beside supports at points"
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return f"{turn} beside edge moments"
    if any(len({h.name for h in s.held.values()}) != 1 or len(s.held) < 3 for s in supports):
        return f"{turn} unless each supported edge is held in all components by one support"
    movable = (Translation, Rotation, type(None))
    if any(not isinstance(h.motion, movable) for s in supports for h in s.held.values()):
        return f"{turn} beside a support that is moved by prescribed values"
    return None


@dataclass(frozen=True)
class Turning:
    """The rigid motions of a case's supported edges at load factor t, as a lift and as the field's axes."""

    case: Case
    t: float = 1.0

    @property
    def moves(self) -> bool:
        """Whether any edge is moved at all."""
        return True

    @cached_property
    def _supports(self) -> tuple[EdgeSupport, ...]:
        return edge_supports(self.case)

    def jet(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3) of the lift at points (N, 2)."""
        start = from_derivatives(self.case.surface.derivatives(points, 2), placement)
        x = start
        for support in reversed(self._supports):
            weight = edge_weight(self.case, support.edge, len(self._supports) == 1, points, placement)
            match support.held[0].motion:
                case Translation(vector=vector):
                    shift = placement.tensor(np.array([self.case.scalar(text, self.t) for text in vector]))
                    x = x + product(weight[..., None], constant(shift.expand(len(points), 3)))
                case Rotation() as rotation:
                    centre = constant(placement.tensor(np.tile(rotation.centre, (len(points), 1))))
                    turn = self._rotation(rotation, weight, placement)
                    x = centre + matrix_product(turn, (x - centre)[..., None])[..., 0]
        return x - start

    def axes(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of the rotation Q of the field's axes at points (N, 2)."""
        identity = torch.eye(3, device=placement.device, dtype=placement.dtype)
        total = constant(identity.expand(len(points), 3, 3))
        for support in self._supports:
            motion = support.held[0].motion
            if isinstance(motion, Rotation):
                weight = edge_weight(self.case, support.edge, len(self._supports) == 1, points, placement)
                total = matrix_product(total, self._rotation(motion, weight, placement))
        return total

    def _rotation(self, rotation: Rotation, weight: Tensor, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of the rotation by `weight` (6, N) of its angle, by Rodrigues' formula."""
        axis = np.asarray(rotation.axis) / np.linalg.norm(rotation.axis)
        cross = placement.tensor(np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]]))
        angle = math.radians(self.case.scalar(rotation.angle, self.t)) * weight
        s, c = (compose(f(angle[VALUE]), angle)[..., None, None] for f in (sine, cosine))
        identity = constant(torch.eye(3, device=cross.device, dtype=cross.dtype).expand(weight.shape[1], 3, 3))
        return identity + s * cross + (constant(torch.ones_like(weight[VALUE]))[..., None, None] - c) * (cross @ cross)


@dataclass(frozen=True)
class TurnedFactors:
    """Boundary factors on axes that turn with the supported edges: the matrix Q M."""

    factors: Factors
    turning: Turning

    def matrix(self, points: Array, placement: Placement) -> Tensor:
        """Return the jet (6, N, 3, 3) of Q M at points (N, 2)."""
        return matrix_product(self.turning.axes(points, placement), self.factors.matrix(points, placement))
