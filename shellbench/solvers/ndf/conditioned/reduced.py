"""The energy of a linear shell as a function of its material, and its least within the span of a few solved fields.

The energy density is W = 1/2 (D H eps eps + B H kappa kappa), with H = nu G + (1 - nu) S (Kairanda et al. 2023, eqs.
(17) to (19)), G = a^ab a^cd and S the symmetric rest. Therefore the stiffness of any field is exactly

    K(material) = D nu K_1 + D (1 - nu) K_2 + B nu K_3 + B (1 - nu) K_4,

with four matrices that do not depend on the material. Integrated once, they give the energy of any material.

Within the span of n fields that were solved for at n materials, the best field of another material follows from an n x
n system: the reduced basis method (Hesthaven, Rozza & Stamm 2016, chapter 3). It is Ritz's method on few functions. Its
energy is an upper bound, and its derivative by the material is exact: K u' = -K' u.

The module also computes the four parts for features, and for fields. The parts are the trace and the rest of the
membrane's energy, then of the bending's. Each is half the sum of squares of rows, as in `energy`: one row for a trace,
three for a rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.series.conditioned import ASKED, Material
from shellbench.problems.series.quantities import Parameter
from shellbench.problems.shell.posed.rigid import free_motions
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.solvers.ndf.field.ansatz import DEPENDENT, Ansatz
from shellbench.solvers.ndf.field.field import Features
from shellbench.solvers.ndf.field.geometry import apply_rows, elasticity_tensor, geometry, pull_back_rows, strain_rows
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.field.quadrature import Rule, RuleSpec
from shellbench.solvers.ndf.field.supports import quantity_points
from shellbench.solvers.ndf.strains.energy import (
    NormalEquations,
    Table,
    add_gram,
    concentrated,
    strain_matrix,
    surface_area,
    symmetric,
    tabulate,
    value_vector,
)

ENERGY_PARTS = 4  # trace and rest of the membrane's energy, then of the bending's
MEMBRANE, BENDING = slice(0, 3), slice(3, 6)  # of the six strains


def stiffnesses(material: Material) -> Array:
    """Return the factors (4,) of the parts: D nu, D (1 - nu), B nu, B (1 - nu)."""
    h, young, nu = material
    membrane = young * h / (1 - nu**2)
    bending = membrane * h**2 / 12
    return np.array([membrane * nu, membrane * (1 - nu), bending * nu, bending * (1 - nu)])


def stiffness_rates(material: Material, by: Parameter) -> Array:
    """Return the derivatives (4,) of the factors: by log h, by log E, or by nu."""
    h, young, nu = material
    if by == "youngs_modulus":
        return stiffnesses(material)
    if by == "thickness":
        return np.asarray(stiffnesses(material) * np.array([1, 1, 3, 3]))
    # nu / (1 - nu^2) has the derivative (1 + nu^2) / (1 - nu^2)^2; (1 - nu) / (1 - nu^2) = 1 / (1 + nu).
    membrane = young * h * np.array([(1 + nu**2) / (1 - nu**2) ** 2, -1 / (1 + nu) ** 2])
    return np.concatenate([membrane, membrane * h**2 / 12])


@dataclass(frozen=True)
class Reduced:
    """The energy 1/2 c K(material) c - f c of c, the coefficients of n fields.

    Attributes
    ----------
    parts, coarse
        (4, n, n): the four matrices on the fine quadrature, by which c is found, and on that of the solves.
    load
        (n,): work of the loads on each field, J.
    asked
        (n,): the asked displacement of each field, m.
    span
        (n, m): orthonormal combinations of the fields.
    """

    parts: Array
    coarse: Array
    load: Array
    asked: Array
    span: Array

    @classmethod
    def from_fields(cls, parts: Array, coarse: Array, load: Array, asked: Array, middle: Material) -> Reduced:
        """Choose combinations that are orthonormal in the energy of one material, without those at rounding."""
        gram = np.tensordot(stiffnesses(middle), parts, 1)
        unit = 1 / np.sqrt(gram.diagonal())
        values, vectors = np.linalg.eigh(gram * unit[:, None] * unit)
        kept = values > DEPENDENT * values[-1]
        return cls(parts, coarse, load, asked, unit[:, None] * vectors[:, kept] / np.sqrt(values[kept]))

    def without_last(self, number: int, middle: Material) -> Reduced:
        """Return the same without the last fields."""
        n = len(self.load) - number
        return Reduced.from_fields(self.parts[:, :n, :n], self.coarse[:, :n, :n], self.load[:n], self.asked[:n], middle)

    def _matrix(self, factors: Array) -> Array:
        return np.asarray(self.span.T @ np.tensordot(factors, self.parts, 1) @ self.span)

    def coefficients(self, material: Material) -> Array:
        """Return the c (n,) of least energy."""
        return np.asarray(self.span @ np.linalg.solve(self._matrix(stiffnesses(material)), self.span.T @ self.load))

    def coefficient_rates(self, material: Material, by: Parameter) -> Array:
        """Return the derivative of c (n,) by the material: K c' = -K' c."""
        change = np.tensordot(stiffness_rates(material, by), self.parts, 1) @ self.coefficients(material)
        return np.asarray(-self.span @ np.linalg.solve(self._matrix(stiffnesses(material)), self.span.T @ change))

    def value(self, material: Material) -> float:
        """Return the asked displacement, m."""
        return float(self.asked @ self.coefficients(material))

    def sensitivity(self, material: Material, by: Parameter) -> float:
        """Return the derivative of its logarithm."""
        return float(self.asked @ self.coefficient_rates(material, by)) / self.value(material)

    def energy(self, material: Material) -> float:
        """Return the least potential energy, J: minus half the work of the loads."""
        return -0.5 * float(self.load @ self.coefficients(material))

    def gap(self, material: Material) -> float:
        """Return the quadrature gap: the relative difference of the answer's stiffness on the coarser quadrature."""
        c, factors = self.coefficients(material), stiffnesses(material)
        fine, coarse = (float(c @ np.tensordot(factors, one, 1) @ c) for one in (self.parts, self.coarse))
        return abs(coarse / fine - 1)

    def arrays(self) -> Mapping[str, Array]:
        """Return all arrays by name."""
        return {name: getattr(self, name) for name in ("parts", "coarse", "load", "asked", "span")}


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
        return cls(torch.stack([symmetric(part) for part in parts]), load, anchor)

    def at(self, material: Material) -> NormalEquations:
        """Return the equations of a material."""
        factors = torch.as_tensor(stiffnesses(material)).to(self.parts)
        return NormalEquations(torch.tensordot(factors, self.parts, 1), self.load, self.anchor, 0.0)

    def reduced_matrices(self, layers: Tensor) -> Array:
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
            found.append(pull_back_rows(rows, matrix))
    return tuple(found)


def _split_tables(
    ansatz: Ansatz, rule: Rule, placement: Placement
) -> Iterator[tuple[Array, Table, tuple[Tensor, ...]]]:
    """Yield points, table and rows of the parts, batch by batch of a rule."""
    area = surface_area(ansatz, rule)
    for batch in rule.batches():
        table = tabulate(ansatz, batch, placement, area)
        yield batch.points, table, part_rows(ansatz, batch.points, batch.weights, placement)


def matrices_on_rule(
    ansatz: Ansatz, features: Features, layers: Tensor, rule: Rule, spec: RuleSpec, focal: Array
) -> tuple[Array, Array]:
    """Return the four matrices (4, n, n) of fields with output layers (n, 3 M) on a rule, and the loads' works (n,).

    They come from the strains of each field, not from the matrices of the features, whose large weights would cancel.
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
    points, directions = quantity_points(case, quantity)
    wanted = features.placement.tensor(directions / len(points))
    matrix = ansatz.factors.matrix(points, features.placement)[VALUE]
    along = (matrix.mT @ wanted[..., None])[..., 0]
    return value_vector(along, features.values(points))
