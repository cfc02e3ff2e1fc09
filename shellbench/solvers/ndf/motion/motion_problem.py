"""Newton's law for a field: the output layer's equations of motion, in unknowns that are orthonormal in mass.

The displacement is u = lift(t) + M w . phi with w = held g(t) + combine y. Point supports hold w to the prescribed
g(t); the other unknowns y obey

    y'' = combine^T [ f(t) - dE/dw - d(w, w') - rho (M phi, lift'') ],

where E is the energy of strains and springs, f are the loads and d is Rayleigh's damping: alpha times momentum, and as
stresses beta times those of the rates of strain. The columns of `held` and `combine` are orthogonal in
mass, so that g'' exerts nothing on y. The power of loads and supports is integrated beside y: their work must equal the
shell's energy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.path import Dynamics
from shellbench.solvers.ndf.field.ansatz import Ansatz, Combined
from shellbench.solvers.ndf.field.build import build_ansatz
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import COMPONENTS, VALUE, Array
from shellbench.solvers.ndf.field.quadrature import NOWHERE, RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import concentrated_forces, force_density, point_supports
from shellbench.solvers.ndf.linear.constraints import point_rows, point_targets
from shellbench.solvers.ndf.motion.motion_parts import Energies, LiftValues, ReflectedBasis, Table
from shellbench.solvers.ndf.motion.products import Grid, Products
from shellbench.solvers.ndf.path.newton import Basis
from shellbench.solvers.ndf.strains.sampled import Sampled
from shellbench.solvers.ndf.strains.strain_measures import GRADIENTS, stresses

STENCIL = 7  # values in time that give the rates of prescribed motions
NUDGE = 1e-6  # root mean square displacement of small motions, in sides of the shell: strains stay linear, and exact
POWER_ITERATIONS = 30  # of power iteration, which finds the highest frequency to a few per cent
SPACING = 1e-3  # of the whole time, distance of these values: errors of truncation and rounding are then both near 1e-9


@dataclass(frozen=True)
class Motion:
    """A case with its features on one quadrature.

    Attributes
    ----------
    case, spec
        The case, and the choices of the field.
    features
        Combinations, orthonormal in the area.
    rule_spec
        The rule that forces and energies are integrated with.
    """

    case: Case
    spec: FieldSpec
    features: Combined | Products
    rule_spec: RuleSpec

    def ansatz(self, t: float) -> Ansatz:
        """Return the supports at a time."""
        return build_ansatz(self.case, self.spec.model_copy(update={"t": t}))

    @property
    def dynamics(self) -> Dynamics:
        """The case's data of its motion."""
        assert self.case.dynamics is not None
        return self.case.dynamics

    @cached_property
    def sampled(self) -> Sampled:
        """The rule's points."""
        rule = area_rule(self.case.surface.domain, NOWHERE, self.rule_spec)
        keep = isinstance(self.features, Combined)
        return Sampled.at_points(self.ansatz(0.0), self.features, rule.points, keep)

    @cached_property
    def _scalar_matrix(self) -> bool:
        """Return True if the boundary matrix is a multiple of the identity, as with all components held or none."""
        through = self.sampled.through.view(-1, 5, COMPONENTS, COMPONENTS, 6)
        first = through[:, :, :1, :1] * torch.eye(COMPONENTS).to(through)[:, :, None]
        return bool(torch.equal(through, first.expand_as(through)))

    @cached_property
    def _table(self) -> Table | Grid:
        """The features at the points; if all components are alike, their displacement and gradients."""
        if isinstance(self.features, Products):
            return self.features.on_grid(self.sampled.points)
        jets = self.sampled.jets
        # If M is a multiple of the identity, all components share one small table. Both ways give the same field.
        if self._scalar_matrix:
            through = self.sampled.through.view(-1, 5, COMPONENTS, COMPONENTS, 6)[:, :, 0, 0]
            value = self.sampled.matrix[:, 0, :1, None] * torch.eye(6).to(through)[VALUE]
            jets = torch.cat([value, through], dim=1) @ jets
        return Table(jets.reshape(-1, self.features.count))

    @cached_property
    def areas(self) -> Tensor:
        """(N,): area of each point, m^2."""
        rule = area_rule(self.case.surface.domain, NOWHERE, self.rule_spec)
        return self.features.placement.tensor(rule.weights) * self.sampled.undeformed.geometry.jacobian

    @property
    def area(self) -> float:
        """Area of the midsurface, m^2."""
        return float(self.areas.sum())

    @cached_property
    def _elasticity(self) -> Tensor:
        return self.sampled.undeformed.elasticity(self.case.material) * self.areas[:, None, None, None]

    @cached_property
    def _springs(self) -> Tensor:
        """(N, 3): stiffness of each point, N/m."""
        return self.features.placement.tensor(self.case.spring_stiffness(self.sampled.points)) * self.areas[:, None]

    @cached_property
    def mass(self) -> Tensor:
        """(3 M, 3 M) on the output weights, kg; zero for components that are held on the whole surface."""
        total = self.sampled.products(self.case.material.areal_density * self.areas)
        blocks = total.view(COMPONENTS, self.features.count, COMPONENTS, self.features.count)
        # A component held on the whole surface moves as prescribed. Its features get no inertia, and therefore no place
        # in the basis.
        for c in self.case.held_everywhere:
            for d in range(COMPONENTS):
                blocks[c, :, d] = blocks[d, :, c] = 0.0
        return total

    @cached_property
    def _rows(self) -> Tensor:
        """(k, 3 M): conditions of the point supports."""
        return point_rows(self.ansatz(0.0), self.features)

    @cached_property
    def basis(self) -> Basis | ReflectedBasis:
        """The unknowns, orthonormal in mass."""
        if isinstance(self.features, Products):
            free = torch.ones((COMPONENTS, self.features.count), dtype=torch.bool)
            free[list(self.case.held_everywhere)] = False
            return ReflectedBasis.from_constraints(free.flatten(), self.case.material.areal_density, self._rows)
        return Basis.from_stiffness(self.mass, self._rows)

    def inertia(self, second: Tensor) -> Tensor:
        """Return mass times accelerations (3 M,) of the output weights, N."""
        if isinstance(self.basis, ReflectedBasis):
            return torch.where(self.basis.free, self.case.material.areal_density * second, 0.0)
        return self.mass @ second

    def unknowns(self, w: Tensor) -> Tensor:
        """Return the unknowns y (r,), or their rates, of output weights (3 M,) that satisfy the point supports."""
        return self.basis.gather(self.inertia(w))

    def force_vector(self, force: Tensor) -> Tensor:
        """Return the vector (3 M,) of forces (N, 3) on u."""
        if isinstance(self.features, Products):
            return self._weight_forces(force, force.new_zeros((len(force), GRADIENTS)))
        return self.sampled.forces(force)

    def targets(self, t: float) -> Tensor:
        """Return the displacements that point supports prescribe (k,) at a time, metres, less the lift."""
        return point_targets(self.ansatz(t), self.features.placement)

    @cached_property
    def _moves_supports(self) -> bool:
        """Return True if any point or edge is moved."""
        points = any(s.support.motion is not None for s in point_supports(self.case))
        return points or self._lifts

    @cached_property
    def _lifts(self) -> bool:
        return self.ansatz(0.0).lift.moves

    def rate(self, function: Callable[[float], Tensor], t: float, order: int) -> Tensor:
        """Return a derivative in time of a prescribed function, from values between rest and the final time."""
        return self.rates(function, t)[order - 1]

    def rates(self, function: Callable[[float], Tensor], t: float) -> tuple[Tensor, Tensor]:
        """Return the first and the second derivative in time of a prescribed function."""
        # Finite differences on a stencil that stays between rest and the end, one-sided there. Their weights solve
        # Vandermonde's system: exact for polynomials up to the sixth degree. A prescribed motion may be any function of
        # time, so that no formula is differentiated.
        spacing = SPACING * self.dynamics.until
        first = min(max(t - spacing * (STENCIL // 2), 0.0), self.dynamics.until - spacing * (STENCIL - 1))
        times = first + spacing * np.arange(STENCIL)
        powers = np.vander((times - t) / spacing, increasing=True).T
        wanted = np.zeros((STENCIL, 2))
        wanted[1, 0], wanted[2, 1] = 1 / spacing, 2 / spacing**2
        weights = np.linalg.solve(powers, wanted)
        values = torch.stack([function(float(time)) for time in times])
        slope, bend = (torch.tensordot(values.new_tensor(w), values, dims=1) for w in weights.T)
        return slope, bend

    def _lift(self, t: float) -> LiftValues:
        jet = self.ansatz(t).lift.jet(self.sampled.points, self.features.placement)
        return LiftValues(jet[VALUE], self.sampled.undeformed.gradients(jet))

    def _lift_rates(self, t: float) -> tuple[LiftValues, LiftValues]:
        """Return the lift's first and second derivative in time."""

        def packed(time: float) -> Tensor:
            lifted = self._lift(time)
            return torch.cat([lifted.values[:, None], lifted.gradients], dim=1)

        slope, bend = (LiftValues(both[:, 0], both[:, 1:]) for both in self.rates(packed, t))
        return slope, bend

    def weights(self, y: Tensor, t: float, order: int = 0) -> Tensor:
        """Return the output weights w (3 M,) of unknowns (r,), or their derivative in time from that of y."""
        total = self.basis.spread(y)
        if not self._moves_supports:
            return total
        targets = self.targets(t) if order == 0 else self._target_rates(t)[order - 1]
        return total + self.basis.held @ targets

    def _target_rates(self, t: float) -> tuple[Tensor, Tensor]:
        """Return the rates of the point supports' prescribed displacements; those of the last time are cached."""
        # Each evaluation of the accelerations needs both rates, and each rate takes a whole stencil of motions.
        if t not in self._rate_memory:
            self._rate_memory.clear()
            self._rate_memory[t] = self.rates(self.targets, t)
        return self._rate_memory[t]

    @cached_property
    def _rate_memory(self) -> dict[float, tuple[Tensor, Tensor]]:
        return {}

    @cached_property
    def _load_memory(self) -> dict[str, tuple[Array, Tensor]]:
        return {}

    def forces(self, t: float) -> Tensor:
        """Return the dead loads (3 M,) at a time; unchanged loads are not integrated again."""
        # Loads are compared, not assumed steady: most do not change, and a comparison costs less than an integral.
        density = force_density(self.case, self.sampled.points, t)
        points, concentrated = concentrated_forces(self.case, self.rule_spec, NOWHERE, t)
        key = np.concatenate([density, concentrated])
        if "loads" in self._load_memory and np.array_equal(self._load_memory["loads"][0], key):
            return self._load_memory["loads"][1]
        placement = self.features.placement
        total = self.force_vector(placement.tensor(density) * self.areas[:, None])
        if len(points):
            matrix = self.ansatz(t).factors.matrix(points, placement)[VALUE]
            on_free = (matrix.mT @ placement.tensor(concentrated)[..., None])[..., 0]
            total = total + (on_free.T @ self.features.values(points)).reshape(-1)
        self._load_memory["loads"] = (key, total)
        return total

    def _fields(self, w: Tensor, lifted: LiftValues | None) -> tuple[Tensor, Tensor]:
        """Return displacement (N, 3) and its gradients (N, 5, 3)."""
        found = self._table.fields(w.view(COMPONENTS, -1))
        if self._scalar_matrix:
            u, gradients = found[:, 0], found[:, 1:]
        else:
            u, gradients = self._apply_matrix(found.mT)
        if lifted is not None:
            return u + lifted.values, gradients + lifted.gradients
        return u, gradients

    def _apply_matrix(self, free: Tensor) -> tuple[Tensor, Tensor]:
        """Return displacement (N, 3) and gradients (N, 5, 3) from the jets of free components (N, 3, 6)."""
        gradients = (self.sampled.through @ free.reshape(-1, 6 * COMPONENTS, 1)).view(-1, 5, COMPONENTS)
        return (self.sampled.matrix @ free[..., VALUE, None])[..., 0], gradients

    def _weight_forces(self, force: Tensor, conjugate: Tensor) -> Tensor:
        """Return the vector (3 M,) of forces (N, 3) on u and of forces (N, 15) conjugate to its gradients."""
        if self._scalar_matrix:
            on_fields = torch.cat([force[:, None], conjugate.view(-1, 5, COMPONENTS)], dim=1)
            return self._table.pull_back(on_fields).reshape(-1)
        on_jet = (conjugate[:, None] @ self.sampled.through).view(-1, COMPONENTS, 6)
        on_jet[..., VALUE] += (self.sampled.matrix.mT @ force[..., None])[..., 0]
        return self._table.pull_back(on_jet.mT).reshape(-1)

    def resistance(self, w: Tensor, t: float, rate: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor, float]:
        """Return dE/dw + d (3 M,), by point its forces on gradients (N, 15) and on u (N, 3), and the power d takes.

        Only with w', `rate`, is there any damping d.
        """
        u, gradients = self._fields(w, self._lift(t) if self._lifts else None)
        strained = self.sampled.undeformed.strained(self.spec.strain, gradients)
        strains, pull, power = strained.strains, self._springs * u, 0.0
        if rate is not None and self.dynamics.damped:
            v, slopes = self._fields(rate, self._lift_rates(t)[0] if self._lifts else None)
            dragged = self.dynamics.mass_damping * self.case.material.areal_density * self.areas[:, None] * v
            pull, power = pull + dragged, float((dragged * v).sum())
            if beta := self.dynamics.stiffness_damping:
                rates = self._strain_rates(gradients, slopes)
                strains = strains + beta * rates
                power += beta * float((rates * stresses(self._elasticity, rates)).sum())
        stress = stresses(self._elasticity, strains)
        # Stress . eps' is conjugate to the gradients of u, the springs' pull to u itself.
        conjugate = strained.conjugate_forces(stress)
        return self._weight_forces(pull, conjugate), conjugate, pull, power

    def _strain_rates(self, gradients: Tensor, slopes: Tensor) -> Tensor:
        """Return the rates (N, 6) of the strains of gradients (N, 5, 3) that change by `slopes`."""

        def strains(moved: Tensor) -> Tensor:
            return self.sampled.undeformed.strained(self.spec.strain, moved).strains

        rates: Tensor = torch.func.jvp(strains, (gradients,), (slopes,))[1]
        return rates

    def accelerate(self, y: Tensor, velocity: Tensor, t: float) -> tuple[Tensor, float]:
        """Return y'' (r,), and the power of loads and supports less that of damping, W."""
        # y'' = combine^T (f - dE/dw - d - rho (M phi, lift'')): no mass matrix, as the basis is orthonormal in mass.
        # 1. Sum the forces of strains, springs and damping at w, dead loads, and inertia of the lift.
        # 2. Compute the power of the loads on w'.
        # 3. Add the power of point supports: mass times acceleration less all other forces, on the part of w' that they
        #    move.
        # 4. Add the power of moving edges and of loads on their motion: inertia, springs and stresses on the lift's
        #    rate.
        w = self.weights(y, t)
        moved = self.weights(velocity, t, 1)
        resistance, conjugate, pull, damping = self.resistance(w, t, moved)
        force = self.forces(t)
        rho = self.case.material.areal_density
        residual = force - resistance
        rates = self._lift_rates(t) if self._lifts else None
        if rates is not None:
            residual = residual - self.force_vector(rho * self.areas[:, None] * rates[1].values)
        acceleration = self.basis.gather(residual)
        power = float(force @ moved) - damping
        if self._moves_supports:
            # The free fields are in balance, so that only held ones remain; w' - combine y' is their motion.
            balance = self.inertia(self.weights(acceleration, t, 2)) - residual
            power += float(balance @ (moved - self.basis.spread(velocity)))
        if rates is not None:
            rate, second = rates
            free, _ = self._fields(self.weights(acceleration, t, 2), None)
            inertia = rho * self.areas[:, None] * (free + second.values)
            power += float(((inertia + pull) * rate.values).sum() + (conjugate * rate.gradients.flatten(1)).sum())
        return acceleration, power

    def fastest_rate(self) -> float:
        """Return the largest magnitude of a root of small motions about rest, 1/s: of l^2 + (a + b w^2) l + w^2."""
        # w is the highest angular frequency, by power iteration; a and b are the damping.
        # Power iteration on the stiffness at rest, which in this basis has the squared frequencies as eigenvalues. Its
        # product with a vector is a central difference of the forces: no matrix is made.
        rest = self.areas.new_zeros(self.basis.size)
        direction = torch.sin(torch.arange(1.0, 1 + len(rest)).to(rest))  # any vector that is orthogonal to no mode
        size, value = NUDGE * self.area**0.5 * self.case.material.areal_density**0.5, 0.0
        for _ in range(POWER_ITERATIONS):
            direction = direction / direction.norm()
            there, back = (
                self.resistance(self.basis.spread(rest + side * size * direction), 0.0)[0] for side in (1, -1)
            )
            direction = self.basis.gather(there - back) / (2 * size)
            value = float(direction.norm())
        damping = (self.dynamics.mass_damping + self.dynamics.stiffness_damping * value) / 2
        return damping + math.sqrt(damping**2 - value) if damping**2 > value else math.sqrt(value)

    def support_forces(self, w: Tensor, rate: Tensor, second: Tensor, t: float) -> Tensor:
        """Return the forces (k,) of the point supports, N, from output weights (3 M,) and their derivatives in time."""
        # D'Alembert: the supports exert the unbalanced forces, on the fields that move one of them by one unit.
        residual = self.resistance(w, t, rate)[0] - self.forces(t) + self.inertia(second)
        if self._lifts:
            lag = self.case.material.areal_density * self.areas[:, None] * self._lift_rates(t)[1].values
            residual = residual + self.force_vector(lag)
        return self.basis.held.T @ residual

    def energies(self, w: Tensor, rate: Tensor, t: float) -> Energies:
        """Return the energies of output weights (3 M,) and their rates at a time."""
        u, gradients = self._fields(w, self._lift(t) if self._lifts else None)
        strains = self.sampled.undeformed.strained(self.spec.strain, gradients).strains
        work = (strains * stresses(self._elasticity, strains)).view(-1, 2, 3).sum(dim=(0, 2)) / 2
        v = self._fields(rate, None)[0]
        if self._lifts:
            v = v + self._lift_rates(t)[0].values
        membrane, bending = work.tolist()
        return Energies(
            kinetic=self.case.material.areal_density / 2 * float(self.areas @ (v * v).sum(-1)),
            membrane=membrane,
            bending=bending,
            springs=float((self._springs * u * u).sum()) / 2,
        )
