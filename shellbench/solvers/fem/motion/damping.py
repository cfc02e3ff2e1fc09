"""Rayleigh's damping in one step in time: alpha M v + beta B^T (A d(eps)/dt), B the first variation of the strains eps.

At the step's time t_n + (1 - alpha_f) h the generalised-alpha method has v = r (x - x_0), with r = gamma / (beta h) of
Newmark's constants, and a known x_0. The first part is therefore inertia with another weight and x*. The rate of strain
is r (eps(x) - eps_0), with

    eps_0 = 2 eps(x_0) - (eps(x_0 + d) + eps(x_0 - d)) / 2,    d = v_n / r.

It is that of the method itself for linear strains, and of second order for others. With k = r times Rayleigh's beta,
the strain energy and the second part have, but for a constant, the potential (1 + k) W(eps(x) - k eps_0 / (1 + k)).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.path import Dynamics
from shellbench.solvers.fem.mechanics.strain_energy import StrainEnergy
from shellbench.solvers.fem.motion.generalised_alpha import Instant, Scheme

Array = NDArray[np.float64]
Strains = tuple[Array, ...]


@dataclass(frozen=True)
class StepDamping:
    """Damping in one step; none by default.

    Attributes
    ----------
    by_mass, by_stiffness
        Rayleigh's alpha, 1/s, and his beta, s.
    rate
        r, 1/s.
    still
        x_0 (nodes, 12).
    strains
        eps_0 (n, 6) by portion; None without beta.
    """

    by_mass: float = 0.0
    by_stiffness: float = 0.0
    rate: float = 0.0
    still: Array | float = 0.0
    strains: Strains | None = None

    @classmethod
    def of_step(
        cls, dynamics: Dynamics | None, energy: StrainEnergy, scheme: Scheme, start: Instant, h: float, coast: Array
    ) -> StepDamping:
        """Return the damping of a step; `coast` (nodes, 12) is its end without the part of its last acceleration."""
        if dynamics is None or not dynamics.damped:
            return cls()
        late, rate = scheme.alpha_f, scheme.gamma / (scheme.beta * h)
        steady = start.v + (1 - late) * h * (1 - scheme.gamma) * start.a
        still = (1 - late) * coast + late * start.q - steady / rate
        strains: Strains | None = None
        if dynamics.stiffness_damping:
            near = (energy.strains(still + side * start.v / rate) for side in (0, 1, -1))
            strains = tuple(2 * middle - (after + before) / 2 for middle, after, before in zip(*near, strict=True))
        return cls(dynamics.mass_damping, dynamics.stiffness_damping, rate, still, strains)

    def with_inertia(self, target: Array, weight: float) -> tuple[Array, float]:
        """Return x* (nodes, 12) and the weight of inertia, 1/s^2, with the damping by mass."""
        added = self.rate * self.by_mass
        share = added / (weight + added)
        return (1 - share) * target + share * self.still, weight + added

    @property
    def factor(self) -> float:
        """Factor 1 + k of the strain energy."""
        return 1 + self.rate * self.by_stiffness

    @cached_property
    def shifts(self) -> Strains | None:
        """Strains (n, 6) by portion from which others are counted; None without beta."""
        share = 1 - 1 / self.factor
        return None if self.strains is None else tuple(share * strains for strains in self.strains)

    def work(self, energy: StrainEnergy, first: Array, last: Array, kinetic: float, h: float) -> float:
        """Return the energy, J, that damping takes from q `first` to `last`; `kinetic` is the sum of both ends'."""
        taken = self.by_mass * h * kinetic
        if self.by_stiffness:
            changes = (b - a for a, b in zip(energy.strains(first), energy.strains(last), strict=True))
            taken += 2 * self.by_stiffness / h * sum(energy.parts_of_strains(tuple(changes)))
        return taken
