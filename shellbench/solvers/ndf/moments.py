"""Edge moments at finite rotation: they work on the angle by which the normal turns about their fixed axis e.

With q the part of the deformed normal n across e, the angle's variation is (e x q) . dn / q . q, where e x q = e x n:
such a moment is conservative, its work the moment times the angle from the undeformed normal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import MomentLoad
from shellbench.problems.shell.places import Edge
from shellbench.solvers.ndf.field import Ansatz
from shellbench.solvers.ndf.jets import Array
from shellbench.solvers.ndf.quadrature import RuleSpec, edge_rule
from shellbench.solvers.ndf.sampled import FeatureSet, Sampled
from shellbench.solvers.ndf.strain_measures import GRADIENTS, Turned

TURN = 2 * np.pi


@dataclass(frozen=True)
class EdgeMoment:
    """A moment at the points of an edge rule.

    Attributes
    ----------
    case, load
        Whose load it is.
    sampled
        Features at the points.
    lengths
        (N,) share of the edge, metres.
    finite
        Whether normals turn by finite angles; if not, the angle is its first variation at rest.
    """

    case: Case
    load: MomentLoad
    sampled: Sampled
    lengths: Array
    finite: bool = True

    @property
    def _axis(self) -> Tensor:
        axis = np.asarray(self.load.axis, dtype=float)
        return self.sampled.jets.new_tensor(axis / np.linalg.norm(axis))

    def moments(self, t: float) -> Tensor:
        """Return the moments (N,) of the points, N m, at a load factor."""
        value = self.case.formula(self.load.value).derivatives(self.sampled.points, 0, t)[0, 0]
        return self.sampled.jets.new_tensor(np.asarray(value * self.lengths))

    def spread(self, angles: Tensor, other: EdgeMoment) -> Tensor:
        """Return angles (N,) of these points interpolated at those of another rule on the same edge."""
        ours, theirs = (m.sampled.points[:, np.ptp(self.sampled.points, axis=0).argmax()] for m in (self, other))
        return angles.new_tensor(np.interp(theirs, ours, angles.cpu().numpy()))

    def angles(self, gradients: Tensor, near: Tensor) -> Tensor:
        """Return the angles (N,), rad, and of those that differ by full turns the ones closest to `near` (N,)."""
        if not self.finite:
            return (self.rows(gradients) * gradients[:, :2].flatten(1)).sum(-1)
        e, before = self._axis, self.sampled.undeformed.reference.normal
        after = Turned.by_slopes(self.sampled.undeformed.reference, gradients[:, :2]).normal
        p, q = (v - (v @ e)[:, None] * e for v in (before, after))
        angle = torch.atan2(torch.linalg.cross(p, q, dim=-1) @ e, (p * q).sum(-1))
        return angle + TURN * torch.round((near - angle) / TURN)

    def forces(self, gradients: Tensor, t: float) -> Tensor:
        """Return the vector (3 M,) on the output weights."""
        conjugate = gradients.new_zeros((len(gradients), GRADIENTS))
        conjugate[:, :6] = self.rows(gradients) * self.moments(t)[:, None]
        return self.sampled.pulled_back(conjugate)

    def add_tangent(self, total: Tensor, gradients: Tensor, t: float) -> None:
        """Subtract the forces' derivative from a tangent (3 M, 3 M), see `Sampled.add_form`."""
        if not self.finite:
            return
        form = gradients.new_zeros((len(gradients), GRADIENTS, GRADIENTS))
        form[:, :6, :6] = -self._form(gradients) * self.moments(t)[:, None, None]
        self.sampled.add_form(total, form)

    def rows(self, gradients: Tensor) -> Tensor:
        """Return the first variation (N, 6) of the angles on du,1 and du,2."""
        if not self.finite:
            gradients = torch.zeros_like(gradients)
        turned, e = Turned.by_slopes(self.sampled.undeformed.reference, gradients[:, :2]), self._axis
        n = turned.normal
        return turned.turning(torch.linalg.cross(e.expand_as(n), n, dim=-1)) / (1 - (n @ e) ** 2)[:, None]

    def _form(self, gradients: Tensor) -> Tensor:
        turned, e = Turned.by_slopes(self.sampled.undeformed.reference, gradients[:, :2]), self._axis
        n = turned.normal
        along, lean = n @ e, torch.linalg.cross(e.expand_as(n), n, dim=-1)
        across = (1 - along**2)[:, None, None]
        mixed = turned.turning(lean)[:, :, None] * turned.turning(e.expand_as(n))[:, None]
        mixed = along[:, None, None] * (mixed + mixed.mT)
        return turned.second_turning(lean) / across + mixed / across**2


def edge_moments(
    ansatz: Ansatz, features: FeatureSet, spec: RuleSpec, focal: Array, finite: bool
) -> Iterator[EdgeMoment]:
    """Yield the moments of a case, edge by edge."""
    case = ansatz.case
    for load in case.loads:
        if isinstance(load, MomentLoad):
            for place in (case.places[name] for name in load.on):
                if isinstance(place, Edge):
                    rule = edge_rule(case.surface.domain, place, focal, spec)
                    tangent = case.surface.derivatives(rule.points, 1)[(0, 1) if place.axis == 0 else (1, 0)]
                    lengths = rule.weights * np.linalg.norm(tangent, axis=-1)
                    yield EdgeMoment(case, load, Sampled.at_points(ansatz, features, rule.points), lengths, finite)
