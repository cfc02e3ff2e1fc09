"""A quadrature with all that does not change in training: strain rows, input jets, fixed features, loads.

A trainer asks the same points many times, so what costs geometry is tabulated once. Three parts: the points of an area
rule (`Sample`), the points of edge and point loads (`Tips`), and the energy of a field on both (`Energy`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.energy import (
    Concentrated,
    NormalEquations,
    Table,
    add_gram,
    mirrored,
    strain_matrix,
    surface_area,
    tabulate,
    value_vector,
)
from shellbench.solvers.ndf.field import Ansatz, Features
from shellbench.solvers.ndf.jets import VALUE
from shellbench.solvers.ndf.network import Network
from shellbench.solvers.ndf.quadrature import Rule
from shellbench.solvers.ndf.strain import apply_rows

PART = 1024  # points whose feature strains are held in memory at once


@dataclass(frozen=True)
class Sample:
    """The points of a rule: the energy's table, jets of inputs (6, N, n) and of fixed features (6, N, k)."""

    table: Table
    inputs: Tensor
    fixed: Tensor

    @classmethod
    def from_rule(cls, ansatz: Ansatz, features: Features, rule: Rule) -> Sample:
        """Tabulate a rule."""
        placement = features.placement
        table = tabulate(ansatz, rule, placement, surface_area(ansatz, rule))
        inputs = features.inputs.jets(rule.points, placement)
        return cls(table, inputs, features.fixed.jets(rule.points, placement))

    def __len__(self) -> int:
        return self.inputs.shape[1]

    def parts(self) -> Iterator[Sample]:
        """Yield the sample in portions of `PART` points; the lift's work is whole in each."""
        for start in range(0, len(self), PART):
            part, table = slice(start, start + PART), self.table
            yield Sample(
                Table(table.rows[part], table.offset[part], table.force[part], table.work, table.anchors[:, part]),
                self.inputs[:, part],
                self.fixed[:, part],
            )

    def jets(self, network: Network) -> Tensor:
        """Return the jets (6, N, M) of all features."""
        return torch.cat([network.features(self.inputs), self.fixed], dim=-1)


@dataclass(frozen=True)
class Tips:
    """Forces (P, 3) on F at single points, with jets of inputs and fixed features there."""

    force: Tensor
    work: float
    inputs: Tensor
    fixed: Tensor

    @classmethod
    def at_forces(cls, features: Features, forces: Concentrated) -> Tips:
        """Tabulate edge and point loads."""
        inputs = features.inputs.jets(forces.points, features.placement)
        return cls(forces.force, forces.work, inputs, features.fixed.jets(forces.points, features.placement))

    def __len__(self) -> int:
        return self.inputs.shape[1]

    def load(self, network: Network) -> Tensor:
        """Return the work (3 M,) on all (component, feature) pairs."""
        values = torch.cat([network.values(self.inputs[VALUE]), self.fixed[VALUE]], dim=-1)
        return value_vector(self.force, values)


@dataclass(frozen=True)
class Energy:
    """The least energy over multiples s of a field v in u = lift + s v, by one quadrature.

    Attributes
    ----------
    gain
        (b v)^2 / (v K v) with b = f - K lift, J: without a lift the compliance, and a lower bound of the true one.
    base
        Twice the potential energy of the lift alone, J.
    """

    gain: float
    base: float

    @property
    def potential(self) -> float:
        """Potential energy, J."""
        return 0.5 * (self.base - self.gain)

    def relative_gain(self, over: Energy) -> float:
        """Return by how much this energy is better than another one, relative to its own magnitude."""
        return (self.gain - over.gain) / max(abs(2 * self.potential), torch.finfo(torch.float64).tiny)


def normal_equations_on(sample: Sample, tips: Tips, network: Network) -> NormalEquations:
    """Integrate the energy of the output weights on a sample."""
    unknowns = 3 * (network.width + sample.fixed.shape[2])
    like = network.weights[0]
    stiffness, load = like.new_zeros((unknowns, unknowns)), like.new_zeros(unknowns)
    anchor = like.new_zeros((len(sample.table.anchors), unknowns))
    for part in sample.parts():
        jets = part.jets(network)
        rows = strain_matrix(part.table, jets)
        add_gram(stiffness, rows)
        load += value_vector(part.table.force, jets[VALUE]) - rows.T @ part.table.offset.reshape(-1)
        anchor += (part.table.anchors.mT @ jets[VALUE]).reshape(len(anchor), unknowns)
    return NormalEquations(mirrored(stiffness), load + tips.load(network), anchor, 0.0)


def energy_on(sample: Sample, tips: Tips, network: Network, output: Tensor) -> Energy:
    """Return the energy of the field with output layer (3, M) on a sample.

    Raises
    ------
    SolveFailure
        If it is not a number.
    """
    work, stored, base = 0.0, 0.0, -2 * (sample.table.work + tips.work)
    for part in sample.parts():
        jet = part.jets(network) @ output.T
        strain, table = apply_rows(part.table.rows, jet), part.table
        work += float((table.force * jet[VALUE]).sum() - (table.offset * strain).sum())
        stored += float((strain**2).sum())
        base += float((table.offset**2).sum())
    if len(tips):
        work += float(tips.load(network) @ output.reshape(-1))
    gain = work * work / stored if stored > 0 else 0.0
    if not gain < float("inf"):  # also where it is not a number
        raise SolveFailure("the energy of the field is not finite")
    return Energy(gain, base)
