"""The published loss: the energy of a shell by one random point in each cell of a grid, redrawn at every iteration.

L = |Omega|/N sum_i (W - f . u) sqrt(a) at N stratified samples, less the work f . u of point loads (Kairanda et al.,
eqs. (35), (62), (67)); forces on edges are integrated along them. Strains are the linear part of eq. (30).

Samples are numbers of a counter-based generator, keyed by the seed and counted by the iteration: whichever iteration a
training goes on from, and on whichever device, it sees the samples that it would have seen. All that does not depend
on the network is tabulated for many iterations at once, in float64.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.case import Case
from shellbench.ndf.build import focal_points
from shellbench.ndf.energy import Concentrated, concentrated, surface_area, tabulate
from shellbench.ndf.field import Ansatz
from shellbench.ndf.inputs import Inputs
from shellbench.ndf.jets import VALUE, Array, Placement
from shellbench.ndf.loads import force_density
from shellbench.ndf.published_network import InputScale, Siren
from shellbench.ndf.quadrature import Rule, RuleSpec, area_rule

BLOCK = 10_000  # sampled points that are tabulated at once
PLATE = 0.00406  # deflection of a simply supported square plate: w = PLATE q L^4 / B (Timoshenko, article 30)
ORDER_ONE = (0.1, 10.0)  # metres: estimated deflections for which the modulus stays as it is
AIM = 100.0  # metres: what the estimate is brought to where it does not; E = 30 brings the pinched cylinders' to 124


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
    """What the loss of one iteration needs beside the network.

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
        """Return the potential energy of the field, as the samples see it."""
        jets = siren.jets(self.inputs)
        count = len(self.rows)
        strains = (self.rows @ jets[:, :count].permute(1, 2, 0).reshape(count, 18, 1))[..., 0] + self.offset
        return 0.5 * strains.square().sum() - (self.force * jets[VALUE]).sum() - self.work


@dataclass(frozen=True)
class Sampler:
    """Makes the samples of a training.

    Attributes
    ----------
    ansatz, inputs, scale
        The way supports are built in, and what the network sees of a point.
    cells
        Of the grid, along xi1 and xi2.
    modulus_factor
        Factor s of Young's modulus: with u = lift + s M F the loss is 1/s times the energy of the shell.
    edges
        How finely loads along edges are integrated.
    placement
        Of the tensors.
    """

    ansatz: Ansatz
    inputs: Inputs
    scale: InputScale
    cells: tuple[int, int]
    seed: int
    modulus_factor: float
    edges: RuleSpec
    placement: Placement

    def samples(self, start: int, stop: int) -> Iterator[Sample]:
        """Yield the samples of iterations start, ..., stop - 1."""
        count = math.prod(self.cells)
        exact = self.placement._replace(dtype=torch.float64)
        forces = concentrated(self.ansatz, self.edges, focal_points(self.ansatz.case), exact)
        area = surface_area(self.ansatz, area_rule(self.ansatz.case.surface.domain, np.zeros((0, 2)), self.edges))
        step = max(1, BLOCK // count)
        for first in range(start, stop, step):
            drawn = range(first, min(first + step, stop))
            points = np.stack([stratified_samples(self.ansatz.case, self.cells, self.seed, i) for i in drawn])
            yield from self._tabulated(points, forces, area, exact)

    def _tabulated(self, points: Array, forces: Concentrated, area: float, exact: Placement) -> Iterator[Sample]:
        case = self.ansatz.case
        number, count = points.shape[:2]
        weight = math.prod(case.surface.domain.size) / count
        flat = points.reshape(-1, 2)
        table = tabulate(self.ansatz, Rule(flat, np.full(len(flat), weight)), exact, area)
        root = math.sqrt(self.modulus_factor)
        rows = (root * table.rows).view(number, count, 6, 18).to(self.placement.dtype)
        offset = (table.offset / root).view(number, count, 6).to(self.placement.dtype)
        force = table.force.view(number, count, 3)
        seen = self.inputs.jets(flat, exact)
        at_loads = self.inputs.jets(forces.points, exact)
        density = torch.as_tensor(force_density(case, flat, self.ansatz.t)).view(number, count, 3)
        lift = self._lift_work(flat, density, weight) if self.ansatz.lift.moves else np.zeros(number)
        for k in range(number):
            inputs = torch.cat([seen[:, k * count : (k + 1) * count], at_loads], dim=1).to(self.placement.dtype)
            yield Sample(
                self.scale.apply(inputs),
                rows[k],
                offset[k],
                torch.cat([force[k], forces.force]).to(self.placement.dtype),
                float(lift[k] + forces.work) / self.modulus_factor,
            )
