"""Loads that follow the deformed shell, and the reactions of supports.

Edge moments work on the angle by which the normal turns about their fixed axis e. With q the part of the deformed
normal n across e, the angle's variation is (e x q) . dn / q . q, where e x q = e x n: such a moment is conservative,
and its work is the moment times the angle from the undeformed normal.

A following pressure exerts p a1 x a2 per parametric area, of the deformed base vectors. At a free edge it has no
potential: its derivative is not symmetric, and neither is the tangent of a Newton step.

Reactions follow by virtual work. For a virtual displacement v that is a rigid motion on the support and vanishes on all
others, the work of the reaction is a(u, v) - f(v). No stress is evaluated at the edge, so that the error is of second
order in that of the field.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import ReactionQuantity, TorqueQuantity
from shellbench.problems.shell.question.conditions import Support
from shellbench.problems.shell.question.contact import Touch
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.question.places import Edge, Whole
from shellbench.solvers.ndf.field.ansatz import Ansatz, FeatureSet
from shellbench.solvers.ndf.field.choices import StrainName
from shellbench.solvers.ndf.field.factors import edge_weight
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement, constant, from_derivatives, product
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule, edge_rule
from shellbench.solvers.ndf.field.supports import concentrated_forces, edge_supports, force_density, point_supports
from shellbench.solvers.ndf.strains.sampled import Sampled
from shellbench.solvers.ndf.strains.strain_measures import GRADIENTS, DeformedNormal, Undeformed

TURN = 2 * np.pi


@dataclass(frozen=True)
class EdgeMoment:
    """A moment at the points of an edge rule.

    Attributes
    ----------
    case, load
        The case and the load.
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

    def interpolate(self, angles: Tensor, other: EdgeMoment) -> Tensor:
        """Return angles (N,) of these points interpolated at those of another rule on the same edge."""
        ours, theirs = (m.sampled.points[:, np.ptp(self.sampled.points, axis=0).argmax()] for m in (self, other))
        return angles.new_tensor(np.interp(theirs, ours, angles.cpu().numpy()))

    def angles(self, gradients: Tensor, near: Tensor) -> Tensor:
        """Return the angles (N,), rad; the number of full turns is chosen to be closest to `near` (N,)."""
        if not self.finite:
            return (self.rows(gradients) * gradients[:, :2].flatten(1)).sum(-1)
        e, before = self._axis, self.sampled.undeformed.reference.normal
        after = DeformedNormal.from_slopes(self.sampled.undeformed.reference, gradients[:, :2]).normal
        p, q = (v - (v @ e)[:, None] * e for v in (before, after))
        angle = torch.atan2(torch.linalg.cross(p, q, dim=-1) @ e, (p * q).sum(-1))
        return angle + TURN * torch.round((near - angle) / TURN)

    def forces(self, gradients: Tensor, t: float) -> Tensor:
        """Return the vector (3 M,) on the output weights."""
        conjugate = gradients.new_zeros((len(gradients), GRADIENTS))
        conjugate[:, :6] = self.rows(gradients) * self.moments(t)[:, None]
        return self.sampled.pull_back(conjugate)

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
        turned, e = DeformedNormal.from_slopes(self.sampled.undeformed.reference, gradients[:, :2]), self._axis
        n = turned.normal
        return turned.variation(torch.linalg.cross(e.expand_as(n), n, dim=-1)) / (1 - (n @ e) ** 2)[:, None]

    def _form(self, gradients: Tensor) -> Tensor:
        turned, e = DeformedNormal.from_slopes(self.sampled.undeformed.reference, gradients[:, :2]), self._axis
        n = turned.normal
        along, lean = n @ e, torch.linalg.cross(e.expand_as(n), n, dim=-1)
        across = (1 - along**2)[:, None, None]
        mixed = turned.variation(lean)[:, :, None] * turned.variation(e.expand_as(n))[:, None]
        mixed = along[:, None, None] * (mixed + mixed.mT)
        return turned.second_variation(lean) / across + mixed / across**2


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


@dataclass(frozen=True)
class FollowingPressure:
    """All following pressures of a case, at the points of a rule with parametric weights (N,)."""

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


Sides = tuple[set[Edge], set[Edge]]


@dataclass(frozen=True)
class Virtual:
    """The virtual motions that give the reaction of a support.

    Attributes
    ----------
    edges
        For each component, the edges where the motion is one and those where it is zero.
    told
        Whether each component of the force is determined: not if both kinds of edges meet at a corner, whose reaction
        belongs to both supports.
    turns
        Whether moments are determined: not if a motion turns planes of symmetry as well.
    """

    edges: tuple[Sides, Sides, Sides]
    told: tuple[bool, bool, bool]
    turns: bool

    @classmethod
    def from_support(cls, case: Case, support: Support) -> Virtual:
        """Choose the motions of a support."""
        whole = {place for place in case.places.values() if isinstance(place, Edge) and place.whole}
        everywhere = any(isinstance(place, Whole) for s, place in case.supported_places() if s.name == support.name)
        held = {"xyz".index(c) for c in support.held} if everywhere else set()
        edges: list[Sides] = []
        told, turning = [True] * 3, True
        for c in range(3):
            own: set[Edge] = set(whole) if c in held else set()
            others: set[Edge] = set()
            mirrors: set[Edge] = set()  # they admit a translation, but no rotation
            for s in edge_supports(case) if c not in held else ():
                holder = s.held.get(c)
                turns = s.slope is not None and holder is None and c not in case.held_everywhere
                if (holder is not None and holder.name == support.name) or (turns and s.slope.name == support.name):  # type: ignore[union-attr]
                    own.add(s.edge)
                elif turns and s.slope.symmetry:  # type: ignore[union-attr]
                    mirrors.add(s.edge)
                elif holder is not None or turns:
                    others.add(s.edge)
            if own and _edges_meet(own | others | mirrors) and (others or mirrors):
                told[c] = not (others and _edges_meet(own | others))
                turning = False
            else:
                others |= mirrors
            edges.append((own, others))
        return cls((edges[0], edges[1], edges[2]), (told[0], told[1], told[2]), turning and all(told))

    def why_not_told(self, quantity: ReactionQuantity | TorqueQuantity) -> str | None:
        """Return the reason that a reaction can't be separated from that of another support, as one clause, or None."""
        if isinstance(quantity, ReactionQuantity):
            known = all(told or not part for told, part in zip(self.told, quantity.direction, strict=True))
        else:
            known = self.turns
        if known:
            return None
        return (
            f"the reaction of support '{quantity.support}' can't be told from that of another support which it meets at"
            " a corner"
        )


def _edges_meet(edges: set[Edge]) -> bool:
    return len({edge.axis for edge in edges}) > 1


def edge_reaction(
    field: Field,
    support: Support,
    centre: Array,
    spec: RuleSpec,
    focal: Array,
    held: Array,
    measure: StrainName = "linear",
    body: Callable[[Array], Array] | None = None,
    touch: Touch | None = None,
) -> Array:
    """Return force and moment (6,), N and N m, that a support exerts through its edges.

    `held` (k,) are the forces of the point supports, in the order of `point_supports`; they work on v as well. `body`
    returns further forces per area (N, 3) at points (N, 2), such as those of inertia; `touch` are the contact forces.
    At finite strain the arms of forces are those of the deformed shell.
    """
    # 1. Choose virtual motions that are rigid on the support's edges and vanish on all others.
    # 2. Sum over the area a(u, v) less the work of loads, springs and following pressures.
    # 3. Subtract the work of concentrated forces, contact forces and point supports.
    # 4. Subtract the work of edge moments.
    # 5. Return NaN for components that can't be separated from another support.
    # The textbook integrates stresses along the edge. Virtual work needs no stress there, and its error is of second
    # order.
    case, placement, t = field.ansatz.case, field.features.placement, field.ansatz.t
    virtual = Virtual.from_support(case, support)
    edges = virtual.edges
    if not any(own for own, _ in edges):
        return np.zeros(6)

    def moved(u: Tensor) -> Tensor | None:
        return None if measure == "linear" else u

    rule = area_rule(case.surface.domain, focal, spec)
    total = placement.tensor(np.zeros(6))
    for batch in rule.batches():
        points = batch.points
        surface = Undeformed.at_points(case.surface, points, placement)
        weights = placement.tensor(batch.weights) * surface.geometry.jacobian
        density = force_density(case, points, t)
        force = placement.tensor(density if body is None else density + body(points)) * weights[:, None]
        u = field.jet(points)
        gradients = surface.gradients(u)
        if case.springs and case.dynamics is None:  # in motion `body` includes them
            force = force - placement.tensor(case.spring_stiffness(points)) * u[VALUE] * weights[:, None]
        if case.following:
            pressure = FollowingPressure(case, placement.tensor(batch.weights))
            force = force + pressure.push(points, surface.geometry.tangents, gradients, t)
        strained = surface.strained(measure, gradients)
        stress = surface.respond(case.material, strained.strains)[0] * weights[:, None]
        conjugate = (stress[:, None] @ strained.variation)[:, 0]
        for k, v in enumerate(virtual_motions(case, edges, points, centre, placement, moved(u))):
            total[k] += (conjugate * surface.gradients(v).flatten(1)).sum() - (force * v[VALUE]).sum()
    points, forces = concentrated_forces(case, spec, focal, t)
    if touch is not None:
        points, forces = np.concatenate([points, touch.points]), np.concatenate([forces, touch.forces])
    at = point_supports(case, t)
    points = np.concatenate([points, np.array([p.point.xi for p in at]).reshape(-1, 2)])
    fixed = np.zeros((len(at), 3))
    fixed[np.arange(len(at)), [p.component for p in at]] = held
    forces = np.concatenate([forces, fixed])
    if len(points):
        u = field.jet(points)
        for k, v in enumerate(virtual_motions(case, edges, points, centre, placement, moved(u))):
            total[k] -= (placement.tensor(forces) * v[VALUE]).sum()
    for moment in edge_moments(field.ansatz, field.features, spec, focal, measure != "linear"):
        u = field.jet(moment.sampled.points)
        rows = moment.rows(moment.sampled.undeformed.gradients(u)) * moment.moments(t)[:, None]
        for k, v in enumerate(virtual_motions(case, edges, moment.sampled.points, centre, placement, moved(u))):
            total[k] -= (rows * moment.sampled.undeformed.gradients(v)[:, :2].flatten(1)).sum()
    known = np.array([*virtual.told, *[virtual.turns] * 3])
    return np.where(known, total.cpu().numpy(), np.nan)


def virtual_motions(
    case: Case,
    edges: Sequence[Sides],
    points: Array,
    centre: Array,
    placement: Placement,
    displacement: Tensor | None = None,
) -> list[Tensor]:
    """Return the jets (6, N, 3) of three translations and three rotations about `centre`, weighted by edges.

    `displacement` (6, N, 3) is the jet of the shell's displacement, if arms are those of the deformed shell.
    """
    x = from_derivatives(case.surface.derivatives(points, 2), placement)
    if displacement is not None:
        x = x + displacement
    arm = x - constant(placement.tensor(np.tile(centre, (len(points), 1))))
    weights = torch.stack([_weight(case, own, others, points, placement) for own, others in edges], dim=-1)
    motions = []
    for axis in torch.eye(3, device=placement.device, dtype=placement.dtype):
        motions.append(product(weights, constant(axis.expand(len(points), 3))))
    for axis in torch.eye(3, device=placement.device, dtype=placement.dtype):
        motions.append(product(weights, torch.linalg.cross(axis.expand_as(arm), arm, dim=-1)))
    return motions


def _weight(case: Case, own: set[Edge], others: set[Edge], points: Array, placement: Placement) -> Tensor:
    total = constant(placement.tensor(np.zeros(len(points))))
    if not own:
        return total
    if not others:
        return constant(placement.tensor(np.ones(len(points))))
    for edge in own:
        total = total + edge_weight(case, edge, len(own | others) == 1, points, placement)
    return total
