"""Pressure that follows the deformed shell: p a1 x a2 per parametric area, of the deformed base vectors.

Where an edge is free it has no potential: its derivative is not symmetric, and neither is the tangent that a Newton
step is solved with.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.jets import Array
from shellbench.solvers.ndf.strains.sampled import Sampled

SLOPES = 6  # u,1 and u,2 among the displacement gradients


@dataclass(frozen=True)
class FollowingPressure:
    """All pressures of a case that follow, at the points of a rule with parametric weights (N,)."""

    case: Case
    weights: Tensor

    def values(self, points: Array, t: float) -> Tensor:
        """Return the pressures (N,) times the parametric weights, at a load factor."""
        return self.weights * self.weights.new_tensor(self.case.pressure(points, t))

    def push(self, points: Array, tangents: Tensor, gradients: Tensor, t: float) -> Tensor:
        """Return the forces (N, 3), N, at points with base vectors (N, 2, 3) and displacement gradients (N, 5, 3)."""
        base = tangents + gradients[:, :2]
        normal: Tensor = torch.linalg.cross(base[:, 0], base[:, 1], dim=-1)
        return self.values(points, t)[:, None] * normal

    def tangent(self, sampled: Sampled, gradients: Tensor, t: float) -> Tensor:
        """Return the derivative (3 M, 3 M) of the forces on the output weights."""
        # d(a1 x a2) = -a2 x du,1 + a1 x du,2, component by component.
        base = sampled.undeformed.geometry.tangents + gradients[:, :2]
        unit = torch.eye(3).to(base)
        sides = [torch.linalg.cross(-base[:, 1, None], unit[None]), torch.linalg.cross(base[:, 0, None], unit[None])]
        spread = torch.cat(sides, dim=1).mT * self.values(sampled.points, t)[:, None, None]
        return sampled.values_by_slopes(spread)
