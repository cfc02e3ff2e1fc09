"""The published functional of motion: the mean over time of potential *plus* kinetic energy.

    L = |Omega| / (N_Omega N_t) sum_ij (W - f . u + 1/2 k |u|^2 + 1/2 rho |du/dt|^2) sqrt(a)

(Kairanda et al., eq. (35)) at N_Omega points, one random one in each cell of a grid, and N_t times, one in each of so
many intervals, all redrawn at every iteration; k is the stiffness of springs. The sum is over all pairs, as printed.
It is 1/T times the integral (33), so that its unit is J.

Its Euler-Lagrange equation is rho u'' = +dE/du: the sign of inertia is that of Newton's law reversed, and the final
time brings the natural condition du/dt = 0. A free fall from rest becomes u = g (T t - t^2 / 2).

Points and times are numbers of a counter-based generator, keyed by the seed and counted by the iteration, as in
`published_loss`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.choices import StrainName
from shellbench.solvers.ndf.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.loads import force_density
from shellbench.solvers.ndf.published_loss import stratified_samples
from shellbench.solvers.ndf.published_motion_field import DT, Ansatz, moving
from shellbench.solvers.ndf.published_network import Siren
from shellbench.solvers.ndf.strain_measures import MEASURES, Reference, gradient_map
from shellbench.solvers.ndf.undeformed import Undeformed

OF_TIMES = 1 << 64  # apart from the counters of the points: no iteration reaches it


def stratified_times(until: float, count: int, seed: int, iteration: int) -> Array:
    """Return one random time in each of `count` equal intervals, (T,), s, for one iteration of a training."""
    generator = np.random.Generator(np.random.Philox(key=seed, counter=(iteration << 128) + OF_TIMES))
    times: Array = until * (np.arange(count) + generator.random(count)) / count
    return times


@dataclass(frozen=True)
class SpaceTime:
    """N points by T times, and all that the functional needs there beside the network.

    Attributes
    ----------
    inputs
        (7, T N, n): what the network sees; times vary slowest.
    times
        (T,), s.
    factor, prescribed
        (6, N, 3) and (7, T, N, 3): B and the prescribed displacement.
    gradients
        (N, 5, 6): from a jet to u,1, u,2, d_11, d_22, d_12.
    reference
        What strains need of the undeformed surface, times slowest: (T N, ...).
    elasticity
        (N, 2, 3, 3), N/m and N m.
    force
        (T, N, 3), N/m^2.
    springs
        (N, 3), N/m^3.
    weights
        (T, N), m^2: they sum up to the area.
    """

    inputs: Tensor
    times: Tensor
    factor: Tensor
    prescribed: Tensor
    gradients: Tensor
    reference: Reference
    elasticity: Tensor
    force: Tensor
    springs: Tensor
    weights: Tensor
    density: float
    strain: StrainName

    @classmethod
    def at_points(
        cls, ansatz: Ansatz, strain: StrainName, points: Array, times: Array, share: Array, placement: Placement
    ) -> SpaceTime:
        """Tabulate in float64 at points (N, 2) and times (T,), whose parametric areas are `share` (T, N)."""
        case, exact = ansatz.case, placement._replace(dtype=torch.float64)
        surface = Undeformed.at_points(case.surface, points, exact)
        to, many = placement.dtype, len(times)

        def repeated(tensor: Tensor) -> Tensor:
            return tensor.to(to).expand(many, *tensor.shape).flatten(0, 1)

        moments = exact.tensor(times)
        reference = surface.reference
        return cls(
            inputs=ansatz.seen(ansatz.space(points, exact), moments).to(to),
            times=moments.to(to),
            factor=ansatz.supports.factor(points, exact).to(to),
            prescribed=ansatz.prescribed(points, times, exact).to(to),
            gradients=gradient_map(surface.geometry).to(to),
            reference=Reference(
                repeated(reference.base),
                repeated(reference.normal),
                repeated(reference.inverse),
                repeated(reference.curvature),
            ),
            elasticity=surface.elasticity(case.material).to(to),
            force=exact.tensor(np.stack([force_density(case, points, float(t)) for t in times])).to(to),
            springs=exact.tensor(case.spring_stiffness(points)).to(to),
            weights=(exact.tensor(share) * surface.geometry.jacobian).to(to),
            density=case.material.areal_density,
            strain=strain,
        )

    def loss(self, siren: Siren) -> Tensor:
        """Return the functional of a network, J."""
        return self.functional(self.planes(siren))

    def planes(self, siren: Siren) -> Tensor:
        """Return the displacement's planes (7, T, N, 3)."""
        jets = siren.jets(self.inputs)
        return moving(jets.view(len(jets), *self.weights.shape, 3), self.times, self.factor) + self.prescribed

    def functional(self, planes: Tensor) -> Tensor:
        """Return the functional of a displacement, J, from its planes (7, T, N, 3)."""
        u, velocity = planes[VALUE], planes[DT]
        density = 0.5 * (self.springs * u**2 + self.density * velocity**2).sum(-1) - (self.force * u).sum(-1)
        return (self.weights * (self.strain_energy(planes[:DT]) + density)).sum()

    def strain_energy(self, jets: Tensor) -> Tensor:
        """Return the strain energy density W (T, N), N/m, from the jets (6, T, N, 3) of a displacement."""
        gradients = self.gradients @ jets.permute(1, 2, 0, 3)
        strains = MEASURES[self.strain].from_gradients(self.reference, gradients.flatten(0, 1)).strains
        strains = strains.view(*self.weights.shape, 2, 3, 1)
        density: Tensor = 0.5 * (strains * (self.elasticity @ strains)).sum((-3, -2, -1))
        return density


@dataclass(frozen=True)
class MotionSampler:
    """Makes the samples of a training; see `shellbench.solvers.ndf.published_training.Sampling`.

    Attributes
    ----------
    cells, times
        Of the grid, along xi1 and xi2, and of time.
    placement
        Of the tensors.
    """

    ansatz: Ansatz
    strain: StrainName
    cells: tuple[int, int]
    times: int
    seed: int
    placement: Placement
    modulus_factor: float = 1.0

    @property
    def end(self) -> float:
        """Final time, s."""
        return self.ansatz.until

    def samples(self, start: int, stop: int) -> Iterator[SpaceTime]:
        """Yield the samples of iterations start, ..., stop - 1."""
        case, count = self.ansatz.case, math.prod(self.cells)
        share = np.full((self.times, count), math.prod(case.surface.domain.size) / (self.times * count))
        for iteration in range(start, stop):
            points = stratified_samples(case, self.cells, self.seed, iteration)
            times = stratified_times(self.ansatz.until, self.times, self.seed, iteration)
            yield SpaceTime.at_points(self.ansatz, self.strain, points, times, share, self.placement)


def why_not_sampled(case: Case) -> str | None:
    """Return which loads the functional leaves out, as one clause; None if it has all."""
    for load in case.loads:
        if load.kind not in ("area", "pressure", "gravity"):
            return f"its functional of motion knows no load of kind '{load.kind}'"
    return None
