"""The published loss: the energy of a shell from one random point in each cell of a grid, redrawn at every iteration.

L = |Omega|/N sum_i (W - f . u) sqrt(a) at N stratified samples, less the work f . u of point loads (Kairanda et al.
2023, eqs. (35), (62), (67)); forces on edges are integrated along them. Strains are the linear part of eq. (30).

Samples are numbers of a counter-based generator, keyed by the seed and counted by the iteration. Therefore a resumed
training, on any device, has the same samples as an uninterrupted one. All data that do not depend on the network are
tabulated for many iterations at once, in float64.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import focal_points
from shellbench.solvers.ndf.field.field import FixedFeatures
from shellbench.solvers.ndf.field.inputs import Inputs
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.field.quadrature import NOWHERE, Rule, RuleSpec, area_rule
from shellbench.solvers.ndf.field.supports import concentrated_forces, force_density
from shellbench.solvers.ndf.published.published_network import InputScale, Siren
from shellbench.solvers.ndf.strains.energy import Concentrated, concentrated, surface_area, tabulate

SAMPLES_AT_ONCE = 10_000  # sampled points that are tabulated at once
PLATE = 0.00406  # deflection of a simply supported square plate: w = PLATE q L^4 / B (Timoshenko, article 30)
ORDER_ONE = (0.1, 10.0)  # metres: estimated deflections for which the modulus stays as it is
AIM = 100.0  # metres: scaled estimate otherwise; E = 30 brings the pinched cylinders' to 124


def stratified_samples(case: Case, cells: tuple[int, int], seed: int, iteration: int) -> Array:
    """Return one random point in each cell of a grid, (N, 2), for one iteration of a training."""
    generator = np.random.Generator(np.random.Philox(key=seed, counter=iteration << 128))
    corner = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 2)
    share = (corner + generator.random(corner.shape)) / cells
    domain = case.surface.domain
    points: Array = np.asarray(domain.lower) + share * np.asarray(domain.size)
    return points


@dataclass(frozen=True)
class Sample:
    """Data of the loss of one iteration beside the network.

    Attributes
    ----------
    inputs
        (6, N + P, n): jets of the published inputs at the samples and at P points of edge and point loads.
    rows, offset
        (N, 6, 18) and (N, 6): on the jets of F, half the sum of squares is the strain energy.
    force
        (N + P, 3): work of the loads on a unit of F.
    work
        Work of the loads on the lift.
    """

    inputs: Tensor
    rows: Tensor
    offset: Tensor
    force: Tensor
    work: float

    def loss(self, siren: Siren) -> Tensor:
        """Return the potential energy of the field on the samples."""
        jets = siren.jets(self.inputs)
        return 0.5 * self._strains(jets).square().sum() - (self.force * jets[VALUE]).sum() - self.work

    def energies(self, siren: Siren) -> Tensor:
        """Return the strain energies (N,) of the samples."""
        return 0.5 * self._strains(siren.jets(self.inputs)).square().sum(-1)

    def _strains(self, jets: Tensor) -> Tensor:
        count = len(self.rows)
        return (self.rows @ jets[:, :count].permute(1, 2, 0).reshape(count, 18, 1))[..., 0] + self.offset


@dataclass(frozen=True)
class Sampler:
    """Source of the samples of a training.

    Attributes
    ----------
    ansatz, inputs, scale
        Supports as built in, and inputs of the network at a point.
    cells
        Of the grid, along xi1 and xi2.
    modulus_factor
        Factor s of Young's modulus: with u = lift + s M F the loss is 1/s times the energy of the shell.
    edges
        Resolution of the rule for loads along edges.
    placement
        Of the tensors.
    every
        Number of iterations on the same samples.
    singular
        Features beside the network, the first of them its constant.
    """

    ansatz: Ansatz
    inputs: Inputs
    scale: InputScale
    cells: tuple[int, int]
    seed: int
    modulus_factor: float
    edges: RuleSpec
    placement: Placement
    every: int = 1
    singular: FixedFeatures | None = None

    @property
    def end(self) -> float:
        """Load factor."""
        return self.ansatz.t

    def samples(self, start: int, stop: int) -> Iterator[Sample]:
        """Yield the samples of iterations start, ..., stop - 1.

        They are tabulated in the same blocks wherever a training starts, since the last bit of a sine can depend on its
        place in a block.
        """
        case, count = self.ansatz.case, math.prod(self.cells)
        exact = self.placement._replace(dtype=torch.float64)
        forces = concentrated(self.ansatz, self.edges, focal_points(case), exact)
        area = surface_area(self.ansatz, area_rule(case.surface.domain, NOWHERE, self.edges))
        step = (
            1 if self.ansatz.lift.moves else max(1, SAMPLES_AT_ONCE // count)
        )  # the work on a lift is that of one sample
        for first in range(start - start % step, stop, step):
            points = [stratified_samples(case, self.cells, self.seed, (first + k) // self.every) for k in range(step)]
            samples = self._tabulate(np.concatenate(points), count, forces, area, exact)
            yield from islice(samples, max(start - first, 0), min(stop - first, step))

    def _tabulate(
        self, points: Array, count: int, forces: Concentrated, area: float, exact: Placement
    ) -> Iterator[Sample]:
        """Yield the samples of `count` points each."""
        weights = np.full(len(points), math.prod(self.ansatz.case.surface.domain.size) / count)
        table = tabulate(self.ansatz, Rule(points, weights), exact, area)
        root, dtype = math.sqrt(self.modulus_factor), self.placement.dtype
        rows = (root * table.rows).view(-1, count, 6, 18).to(dtype)
        offset = (table.offset / root).view(-1, count, 6).to(dtype)
        force = table.force.view(-1, count, 3).to(dtype)
        seen, at_loads = (self._network_inputs(places, exact) for places in (points, forces.points))
        concentrated_force = forces.force.to(dtype)
        for k in range(len(rows)):
            yield Sample(
                torch.cat([seen[:, k * count : (k + 1) * count], at_loads], dim=1),
                rows[k],
                offset[k],
                torch.cat([force[k], concentrated_force]),
                (table.work + forces.work) / self.modulus_factor,
            )

    def _network_inputs(self, points: Array, exact: Placement) -> Tensor:
        """Return the jets (6, N, n) of the published inputs, and of singular features."""
        seen = self.scale.apply(self.inputs.jets(points, exact).to(self.placement.dtype))
        if not self.singular or self.singular.count == 1:
            return seen
        return torch.cat([seen, self.singular.jets(points, exact)[..., 1:].to(seen)], dim=-1)


def deflection_of_a_plate(ansatz: Ansatz) -> float:
    """Return the deflection, m, of a plate of the shell's area, stiffness and total load."""
    case = ansatz.case
    spec = RuleSpec((6, 6), 6)
    rule = area_rule(case.surface.domain, NOWHERE, spec)
    area = rule.areas(case.surface)
    density = np.linalg.norm(force_density(case, rule.points, ansatz.t), axis=-1)
    _, forces = concentrated_forces(case, spec, NOWHERE, ansatz.t)
    load = float(area @ density) + float(np.linalg.norm(forces, axis=-1).sum())
    return PLATE * load * float(area.sum()) / case.material.bending_stiffness


def largest_prescribed(ansatz: Ansatz) -> float:
    """Return the largest prescribed displacement, m; 0 if no support moves."""
    rule = area_rule(ansatz.case.surface.domain, NOWHERE, RuleSpec((6, 6), 6))
    return float(ansatz.lift.jet(rule.points, Placement())[VALUE].abs().max()) if ansatz.lift.moves else 0.0


def expected_displacement(ansatz: Ansatz) -> float:
    """Return the displacement, m, expected from load and stiffness; 1 if nothing loads or moves the shell."""
    return max(deflection_of_a_plate(ansatz), largest_prescribed(ansatz)) or 1.0


def usual_modulus_factor(ansatz: Ansatz) -> float:
    """Return the power of ten by which Young's modulus is scaled in training, from the case alone.

    A network starts with displacements of order one and leaves that order slowly. If a plate of the shell's area, under
    the same total load, deflects within `ORDER_ONE`, the modulus is not scaled. Otherwise the estimate is scaled to
    about `AIM`, since a curved shell is stiffer than the plate. For the obstacle course these are the published
    choices: no scaling of plate and roof, and E = 30 for 3e6 of the pinched cylinders (Kairanda et al. 2023, section
    5.1). If only supports are moved, the largest prescribed motion is scaled to order one.
    """
    estimate, moved = deflection_of_a_plate(ansatz), largest_prescribed(ansatz)
    if ORDER_ONE[0] <= max(estimate, moved) <= ORDER_ONE[1] or max(estimate, moved) == 0.0:
        return 1.0
    return float(10 ** round(math.log10(max(estimate / AIM, moved))))
