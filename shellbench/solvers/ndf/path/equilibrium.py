"""Equilibrium of a field at finite strain: energy, forces and tangent of the output weights, in independent fields.

Random features are nearly dependent, so that single output weights of a state have little meaning. The unknowns y are
the weights of independent combinations of features whose stiffness at rest is the identity. At a loaded state the
smallest eigenvalue of the tangent then measures the distance from instability.

Newton's method itself is in `newton`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.posed.rigid import free_motions, rigid_modes
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.solvers.ndf.field.ansatz import Ansatz, Combined, FeatureSet, independent_combinations
from shellbench.solvers.ndf.field.build import build_ansatz
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.factors import turns_clamps
from shellbench.solvers.ndf.field.jets import VALUE, Array
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import concentrated_forces, force_density, quantity_points
from shellbench.solvers.ndf.linear.constraints import SAME_ROW, point_rows, point_targets, slope_constraints
from shellbench.solvers.ndf.path.newton import Basis, Deformed
from shellbench.solvers.ndf.strains.energy import symmetric
from shellbench.solvers.ndf.strains.reaction import EdgeMoment, FollowingPressure, edge_moments
from shellbench.solvers.ndf.strains.sampled import Sampled, elastic_form
from shellbench.solvers.ndf.strains.stiffening import StiffeningMembrane, stiffening_membrane
from shellbench.solvers.ndf.strains.strain_measures import UNSTRAINED, stresses


@dataclass(frozen=True)
class PathProblem:
    """A case with its features on one quadrature.

    Attributes
    ----------
    spec, features, rule_spec, focal
        The field, and the rule of its energy.
    keep
        Whether the features' jets at the rule's points are cached. Without them each use takes longer, with a fraction
        of the memory.
    """

    spec: FieldSpec
    ansatz: Ansatz
    features: FeatureSet
    rule_spec: RuleSpec
    focal: Array
    keep: bool = True

    def independent(self) -> PathProblem:
        """Return the problem with independent combinations of its features, the same for all components."""
        # The sum over components has the combinations that each of them needs, and stays positive semidefinite.
        rest = self.deform(self.rest_weights, 0.0)
        anchors = self.anchor.view(-1, self.features.count)
        alike = self.sampled_at(0.0).block_sum(self._form(rest)) + anchors.T @ anchors
        return replace(self, features=Combined(self.features, independent_combinations(alike), alike))

    @cached_property
    def _stiffness(self) -> Tensor:
        return self.tangent(self.deform(self.rest_weights, 0.0), 0.0)

    @cached_property
    def ansatz_at(self) -> Callable[[float], Ansatz]:
        """The supports at a load factor."""
        if not self.ansatz.lift.moves:
            return lambda t: replace(self.ansatz, t=t)
        return lru_cache(maxsize=4)(lambda t: build_ansatz(self.ansatz.case, self.spec.model_copy(update={"t": t})))

    @cached_property
    def sampled(self) -> Sampled:
        """The area rule's points."""
        rule = area_rule(self.ansatz.case.surface.domain, self.focal, self.rule_spec)
        return Sampled.at_points(self.ansatz_at(0.0), self.features, rule.points, self.keep)

    @cached_property
    def sampled_at(self) -> Callable[[float], Sampled]:
        """The area rule's points with the boundary factors at a load factor."""
        if not turns_clamps(self.ansatz.case):
            return lambda t: self.sampled
        return lru_cache(maxsize=2)(lambda t: self.sampled.with_ansatz(self.ansatz_at(t)))

    @cached_property
    def lift_at(self) -> Callable[[float], Tensor | None]:
        """Gradients (N, 5, 3) of the lift there at a load factor, None where it is zero."""
        return lru_cache(maxsize=2)(lambda t: self.sampled.lift_gradients(self.ansatz_at(t)))

    @cached_property
    def weights(self) -> Tensor:
        """(N,) parametric weights of the area rule."""
        rule = area_rule(self.ansatz.case.surface.domain, self.focal, self.rule_spec)
        return self.features.placement.tensor(rule.weights)

    @property
    def rest_weights(self) -> Tensor:
        """(3 M,) zeros: the output weights at rest."""
        return self.features.placement.zeros(3 * self.features.count)

    @cached_property
    def elasticity(self) -> Tensor:
        """(N, 2, 3, 3) of each point's share of the area."""
        return self.sampled.undeformed.elasticity(self.ansatz.case.material) * self.areas[:, None, None, None]

    @cached_property
    def stiffening(self) -> StiffeningMembrane | None:
        """The membrane, if it stiffens."""
        return stiffening_membrane(self.sampled.undeformed.geometry, self.ansatz.case.material)

    @cached_property
    def areas(self) -> Tensor:
        """(N,): area of each point, m^2."""
        return self.weights * self.sampled.undeformed.geometry.jacobian

    @property
    def area(self) -> float:
        """Area of the midsurface, m^2."""
        return float(self.areas.sum())

    @property
    def rounding_energy(self) -> float:
        """Energy that counts as rounding, J."""
        return UNSTRAINED * self.ansatz.case.material.membrane_stiffness * self.area

    @cached_property
    def moments(self) -> tuple[EdgeMoment, ...]:
        """The edge moments."""
        finite = self.spec.strain != "linear"
        return tuple(edge_moments(self.ansatz, self.features, self.rule_spec, self.focal, finite))

    @cached_property
    def pressure(self) -> FollowingPressure | None:
        """The pressures that follow the shell, if any."""
        return FollowingPressure(self.ansatz.case, self.weights) if self.ansatz.case.following else None

    @cached_property
    def forces(self) -> Callable[[float], tuple[Tensor, float]]:
        """The dead loads at a load factor: a vector (3 M,), and their work on the lift."""
        return lru_cache(maxsize=4)(self._forces)

    def _forces(self, t: float) -> tuple[Tensor, float]:
        case, placement, sampled = self.ansatz.case, self.features.placement, self.sampled_at(t)
        ansatz = self.ansatz_at(t)
        # Forces act on u = lift + M F: through M^T on the output weights, and by their work on the lift.
        force = placement.tensor(force_density(case, sampled.points, t))
        force = force * self.areas[:, None]
        total = sampled.forces(force)
        points, concentrated = concentrated_forces(case, self.rule_spec, self.focal, t)
        extra = placement.tensor(concentrated)
        if len(points):
            matrix = ansatz.factors.matrix(points, placement)[VALUE]
            on_free = (matrix.mT @ extra[..., None])[..., 0]
            total = total + (on_free.T @ self.features.values(points)).reshape(-1)
        work = 0.0
        if ansatz.lift.moves:
            work = float((force * ansatz.lift.jet(sampled.points, placement)[VALUE]).sum())
            if len(points):
                work += float((extra * ansatz.lift.jet(points, placement)[VALUE]).sum())
        return total, work

    @cached_property
    def anchor(self) -> Tensor:
        """(r, 3 M): rows whose squares pin free rigid motions, without effect on loads in balance."""
        case = self.ansatz.case
        free = free_motions(case)
        modes = rigid_modes(case.surface, self.sampled.points)[0, 0] @ free
        # The mean of u . mode over the area, squared. The rows are scaled to be as stiff as the membrane. Loads in
        # balance do no work on the modes, so that at the answer these squares vanish.
        share = self.areas / self.areas.sum() * case.material.membrane_stiffness**0.5
        placed = self.features.placement.tensor(modes) * share[:, None, None]
        rows = [self.sampled.forces(placed[..., k]) for k in range(free.shape[1])]
        return torch.stack(rows) if rows else share.new_zeros((0, 3 * self.features.count))

    @cached_property
    def constraints(self) -> Tensor:
        """(k, 3 M): rows of the point supports, then those of slopes."""
        slopes = [found for found, _ in slope_constraints(self.ansatz, self.features)]
        return torch.cat([point_rows(self.ansatz_at(0.0), self.features), *slopes])

    def targets(self, t: float) -> Tensor:
        """Return the displacements that the constraints prescribe (k,), metres, less the lift."""
        ansatz, placement = self.ansatz_at(t), self.features.placement
        slopes = [target for _, target in slope_constraints(ansatz, self.features)]
        return torch.cat([point_targets(ansatz, placement), *slopes])

    def row(self, points: Array, directions: Array, t: float = 0.0) -> Tensor:
        """Return the row (3 M,) of the mean displacement of the free field at points (n, 2) along directions (n, 3).

        It depends on the load factor only if clamped edges turn.
        """
        placement = self.features.placement
        matrix = self.ansatz_at(t).factors.matrix(points, placement)[VALUE]
        on_free = (matrix.mT @ placement.tensor(directions)[..., None])[..., 0] / len(points)
        return (on_free.T @ self.features.values(points)).reshape(-1)

    def functional(self, quantity: DisplacementQuantity, t: float = 0.0) -> Tensor:
        """Return the row (3 M,) of a displacement quantity; the lift's share is left out."""
        return self.row(*quantity_points(self.ansatz.case, quantity), t)

    def lift_share(self, quantity: DisplacementQuantity, t: float) -> float:
        """Return the lift's share of a displacement quantity at a load factor, metres."""
        ansatz = self.ansatz_at(t)
        if not ansatz.lift.moves:
            return 0.0
        points, directions = quantity_points(ansatz.case, quantity)
        lift = ansatz.lift.jet(points, self.features.placement)[VALUE].cpu().numpy()
        return float(np.mean(np.sum(lift * directions, axis=-1)))

    @cached_property
    def basis(self) -> Basis:
        """The unknowns."""
        # k C^T C is zero on fields that satisfy the constraints. It keeps motions that only constraints stop: these
        # have no other stiffness.
        k, rows = self.ansatz.case.material.membrane_stiffness, self.constraints
        return Basis.from_stiffness(self._stiffness + k * rows.T @ rows, rows, (SAME_ROW / k) ** 0.5)

    def cosine(self, first: Tensor, second: Tensor) -> float:
        """Return the cosine of two changes of weights (3 M,) by the stiffness at rest, 1 if one of them is zero."""
        # Weights have no metric of their own. With that of the stiffness at rest, the cosine is one of displacements.
        stiff = self._stiffness @ first
        product = float(stiff @ first) * float(second @ (self._stiffness @ second))
        return float(stiff @ second) / math.sqrt(product) if product > 0 else 1.0

    def fit_weights(self, other: PathProblem, weights: Tensor) -> Tensor:
        """Return the weights (3 M,) of the field that is closest, in stiffness at rest, to one of another problem.

        The other problem has the same supports and quadrature.
        """
        # The stiffness of the basis is the identity: the projection is Z Z^T f, with f the forces that hold the field.
        variation = self.deform(self.rest_weights, 0.0).strained.variation
        gradients = other.sampled.gradients(weights.view(3, -1)).reshape(-1, 15, 1)
        conjugate = stresses(self.elasticity, (variation @ gradients)[..., 0])
        force = self.sampled.pull_back((conjugate[:, None] @ variation)[:, 0])
        return self.basis.spread(self.basis.gather(force))

    def deform(self, weights: Tensor, t: float, near: tuple[Tensor, ...] | None = None) -> Deformed:
        """Deform the shell by output weights (3 M,); angles are followed from `near`."""
        # 1. Compute gradients of u at the points from output weights and lift; strains, and stresses times area share.
        # 2. Compute the energy, and its gradient by the strains' first variation, pulled back to the output weights.
        # 3. Add loads, anchors of free rigid motions, and moments, whose angles are followed from the state before.
        # 4. Add following pressures; their work counts as that of dead loads, since they have no potential.
        output, ansatz = weights.view(3, -1), self.ansatz_at(t)
        sampled = self.sampled_at(t)
        gradients = sampled.gradients(output, self.lift_at(t))
        strained = sampled.undeformed.strained(self.spec.strain, gradients)
        strains = strained.strains
        conjugate, energies = self._respond(strains)
        forces, work = self.forces(t)
        # r = -dE/dw: the loads less stress . eps' at the points.
        residual = forces - sampled.pull_back((conjugate[:, None] @ strained.variation)[:, 0])
        residual = residual - self.anchor.T @ (self.anchor @ weights)
        work += float(forces @ weights)
        angles = []
        for k, moment in enumerate(self.moments):
            # An angle is known up to whole turns. The one nearest to the last state's is taken, also past half a turn.
            slopes = moment.sampled.gradients(output, moment.sampled.lift_gradients(ansatz))
            before = slopes.new_zeros(len(slopes)) if near is None else near[k]
            angles.append(moment.angles(slopes, before))
            residual = residual + moment.forces(slopes, t)
            work += float(moment.moments(t) @ angles[-1])
        if self.pressure is not None:
            push = self.pressure.push(sampled.points, sampled.undeformed.geometry.tangents, gradients, t)
            on_weights = sampled.forces(push)
            residual = residual + on_weights
            work += float(on_weights @ weights)
            if ansatz.lift.moves:
                work += float((push * ansatz.lift.jet(sampled.points, self.features.placement)[VALUE]).sum())
        membrane, bending = energies.tolist()
        return Deformed(membrane, bending, work, residual, strained, conjugate, tuple(angles))

    def tangent(
        self, deformed: Deformed, t: float, weights: Tensor | None = None, geometric: Tensor | None = None
    ) -> Tensor:
        """Return the second variation (3 M, 3 M) of the potential energy, without following pressures.

        `geometric` (N, 6) replace its stresses; `weights` are needed with moments.
        """
        form = self._form(deformed, geometric)
        count = 3 * self.features.count
        total = form.new_zeros((count, count))
        self.sampled_at(t).add_form(total, form)
        if weights is not None:
            for moment in self.moments:
                lift = moment.sampled.lift_gradients(self.ansatz_at(t))
                moment.add_tangent(total, moment.sampled.gradients(weights.view(3, -1), lift), t)
        return symmetric(total) + self.anchor.T @ self.anchor

    def _form(self, deformed: Deformed, geometric: Tensor | None = None) -> Tensor:
        """Return the second variation (N, 15, 15) of the energy in the displacement gradients."""
        # K = eps'^T C eps' + stress . eps'', the first from the displacement, the second with the stresses given.
        form = elastic_form(self._elasticity_at(deformed.strained.strains), deformed.strained.variation)
        return form + deformed.strained.second_variation(deformed.stresses if geometric is None else geometric)

    def load_stiffness(self, weights: Tensor, t: float) -> Tensor | None:
        """Return the derivative (3 M, 3 M) of the forces of following pressures; None without any."""
        if self.pressure is None:
            return None
        sampled = self.sampled_at(t)
        gradients = sampled.gradients(weights.view(3, -1), self.lift_at(t))
        return self.pressure.tangent(sampled, gradients, t)

    def predicted_stresses(self, deformed: Deformed, change: Tensor, t: float = 0.0) -> Tensor:
        """Return the stresses (N, 6) that the strains' first variation predicts after a change (3 M,) of weights."""
        # C (eps + eps' dw): linear in the change, while the strains of w + dw are quadratic and more.
        elasticity = self._elasticity_at(deformed.strained.strains)
        return deformed.stresses + stresses(elasticity, self._strain_change(deformed, change, t))

    def predicted_energies(self, deformed: Deformed, change: Tensor, t: float) -> tuple[float, float]:
        """Return the membrane and the bending energy, J, of the strains predicted by their first variation.

        A thin shell's own strains after a bending step have far more energy, since the membrane has not followed yet.
        """
        strains = deformed.strained.strains + self._strain_change(deformed, change, t)
        membrane, bending = self._respond(strains)[1].tolist()
        return membrane, bending

    def _respond(self, strains: Tensor) -> tuple[Tensor, Tensor]:
        """Return the stresses (N, 6) conjugate to strains (N, 6), and the membrane and bending energies (2,), J."""
        conjugate = stresses(self.elasticity, strains)
        energies = (strains * conjugate).view(-1, 2, 3).sum(dim=(0, 2)) / 2
        if self.stiffening is not None:
            energy, stress, _ = self.stiffening.respond(strains[:, :3])
            conjugate[:, :3], energies[0] = stress * self.areas[:, None], self.areas @ energy
        return conjugate, energies

    def _elasticity_at(self, strains: Tensor) -> Tensor:
        """Return the derivative (N, 2, 3, 3) of the stresses by the strains (N, 6)."""
        if self.stiffening is None:
            return self.elasticity
        membrane = self.stiffening.respond(strains[:, :3])[2] * self.areas[:, None, None]
        return torch.stack([membrane, self.elasticity[:, 1]], dim=1)

    def _strain_change(self, deformed: Deformed, change: Tensor, t: float) -> Tensor:
        gradients = self.sampled_at(t).gradients(change.view(3, -1)).reshape(-1, 15, 1)
        rates: Tensor = (deformed.strained.variation @ gradients)[..., 0]
        return rates

    def force_rate(self, weights: Tensor) -> Tensor:
        """Return the derivative (3 M,) of proportional loads in t."""
        total = self.forces(1.0)[0]
        for moment in self.moments:
            total = total + moment.forces(moment.sampled.gradients(weights.view(3, -1)), 1.0)
        return total
