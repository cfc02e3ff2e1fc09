"""The energy of a linear shell in four parts that know no material: of features, and of fields that they make.

The parts are those of `reduced`: the trace and the rest of the membrane's energy, then of the bending's. Each is the
half sum of squares of rows, as in `energy`: one row a trace, three a rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.conditioned.case import ASKED, Material
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.measure import unit
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.problems.shell.question.places import Point
from shellbench.solvers.ndf.conditioned.reduced import ENERGY_PARTS, stiffnesses
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.geometry import apply_rows, elasticity_tensor, geometry, strain_rows, through_matrix
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.field.quadrature import Rule, RuleSpec
from shellbench.solvers.ndf.strains.energy import (
    NormalEquations,
    Table,
    add_gram,
    concentrated,
    mirrored,
    strain_matrix,
    surface_area,
    tabulate,
    value_vector,
)

MEMBRANE, BENDING = slice(0, 3), slice(3, 6)  # of the six strains


@dataclass(frozen=True)
class Equations:
    """The energy of output weights as a function of the material: K(material) in its four parts, (4, 3 M, 3 M)."""

    parts: Tensor
    load: Tensor
    anchor: Tensor

    @classmethod
    def from_rule(cls, ansatz: Ansatz, features: Features, rule: Rule, spec: RuleSpec, focal: Array) -> Equations:
        """Integrate on a rule; `focal` (k, 2) are points toward which it is graded."""
        unknowns, like = 3 * features.count, features.network.weights[0]
        parts, load = like.new_zeros((ENERGY_PARTS, unknowns, unknowns)), like.new_zeros(unknowns)
        anchor = like.new_zeros((free_motions(ansatz.case).shape[1], unknowns))
        for points, table, split in _split_tables(ansatz, rule, features.placement):
            jets = features.jets(points)
            for part, rows in zip(parts, split, strict=True):
                add_gram(part, strain_matrix(replace(table, rows=rows), jets))
            load += value_vector(table.force, jets[VALUE])
            anchor += (table.anchors.mT @ jets[VALUE]).reshape(len(anchor), unknowns)
        forces = concentrated(ansatz, spec, focal, features.placement)
        if len(forces.points):
            load += value_vector(forces.force, features.values(forces.points))
        return cls(torch.stack([mirrored(part) for part in parts]), load, anchor)

    def at(self, material: Material) -> NormalEquations:
        """Return the equations of a material."""
        factors = torch.as_tensor(stiffnesses(material)).to(self.parts)
        return NormalEquations(torch.tensordot(factors, self.parts, 1), self.load, self.anchor, 0.0)

    def of_fields(self, layers: Tensor) -> Array:
        """Return the four matrices (4, n, n) of fields with output layers (n, 3 M)."""
        found = np.stack([(layers @ (part @ layers.T)).cpu().numpy() for part in self.parts])
        return np.asarray((found + found.swapaxes(1, 2)) / 2)


def part_rows(ansatz: Ansatz, points: Array, weights: Array, placement: Placement) -> tuple[Tensor, ...]:
    """Return the rows (N, 1 or 3, 3, 6) of the four parts on the jet of F, quadrature weights (N,) included."""
    reference = geometry(ansatz.case.surface, points, placement)
    inverse = reference.inverse_metric
    # On (s_11, s_22, 2 s_12): the trace is a^11 s_11 + a^22 s_22 + a^12 (2 s_12). H at nu = 0 is the rest.
    trace = torch.stack([inverse[:, 0, 0], inverse[:, 1, 1], inverse[:, 0, 1]], dim=-1)[:, None, :]
    rest = torch.linalg.cholesky(elasticity_tensor(reference, 0.0)).mT
    strains, share = strain_rows(reference), (placement.tensor(weights) * reference.jacobian).sqrt()
    matrix = ansatz.factors.matrix(points, placement)
    found = []
    for kind in (MEMBRANE, BENDING):
        flat = strains[:, kind].reshape(len(points), 3, 18)
        for root in (trace, rest):
            rows = (root @ flat * share[:, None, None]).view(len(points), -1, 3, 6)
            found.append(through_matrix(rows, matrix))
    return tuple(found)


def _split_tables(
    ansatz: Ansatz, rule: Rule, placement: Placement
) -> Iterator[tuple[Array, Table, tuple[Tensor, ...]]]:
    """Yield points, table and rows of the parts of one batch of a rule after the other."""
    area = surface_area(ansatz, rule)
    for batch in rule.batches():
        table = tabulate(ansatz, batch, placement, area)
        yield batch.points, table, part_rows(ansatz, batch.points, batch.weights, placement)


def of_fields_on(
    ansatz: Ansatz, features: Features, layers: Tensor, rule: Rule, spec: RuleSpec, focal: Array
) -> tuple[Array, Array]:
    """Return the four matrices (4, n, n) of fields with output layers (n, 3 M) on a rule, and the loads' works (n,).

    From the strains of each field, not from the matrices of the features, whose large weights would cancel.
    """
    n = len(layers)
    stacked = layers.view(n * 3, -1)
    parts, load = layers.new_zeros((ENERGY_PARTS, n, n)), layers.new_zeros(n)
    for points, table, split in _split_tables(ansatz, rule, features.placement):
        jets = (features.jets(points) @ stacked.T).view(6, len(points), n, 3)
        for part, rows in zip(parts, split, strict=True):
            strains = torch.stack([apply_rows(rows, jets[:, :, k]).reshape(-1) for k in range(n)])
            part += strains @ strains.T
        load += torch.einsum("pc,pkc->k", table.force, jets[VALUE])
    forces = concentrated(ansatz, spec, focal, features.placement)
    if len(forces.points):
        values = (features.values(forces.points) @ stacked.T).view(-1, n, 3)
        load += torch.einsum("pc,pkc->k", forces.force, values)
    return parts.cpu().numpy(), load.cpu().numpy()


def asked_row(ansatz: Ansatz, features: Features) -> Tensor:
    """Return the asked displacement (3 M,), m, of a unit of each (component, feature) pair."""
    case = ansatz.case
    quantity = case.quantity(ASKED)
    assert isinstance(quantity, DisplacementQuantity)
    places = [case.places[name] for name in quantity.points]
    points = np.array([place.xi for place in places if isinstance(place, Point)])
    directions = features.placement.tensor(np.array([unit(d) for d in quantity.directions]) / len(points))
    matrix = ansatz.factors.matrix(points, features.placement)[VALUE]
    along = (matrix.mT @ directions[..., None])[..., 0]
    return value_vector(along, features.values(points))
