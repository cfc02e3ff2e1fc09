"""The energy of u = lift + M F, tabulated at quadrature points.

The strain energy is half the sum of squares of rows that are linear in the jets of F, and the work of the loads is
linear in its values: what any recipe needs to solve for an output layer, or to train the layers below it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.rigid import free_motions, rigid_modes
from shellbench.solvers.ndf.field import Ansatz, Features
from shellbench.solvers.ndf.geometry import geometry
from shellbench.solvers.ndf.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.loads import concentrated_forces, force_density
from shellbench.solvers.ndf.quadrature import Rule, RuleSpec
from shellbench.solvers.ndf.strain import apply_rows, energy_rows, through_matrix

BATCH = 1024  # points whose strain rows are held in memory at once
BLOCK = 256  # columns of a block of the normal matrix; only blocks on and above the diagonal are computed


@dataclass(frozen=True)
class Table:
    """What the energy needs at N points, quadrature weights included.

    Attributes
    ----------
    rows
        (N, 6, 3, 6), on the jet of F; half the sum of squares is the strain energy, J. Three rows of membrane, three of
        bending.
    offset
        (N, 6): the same rows of the lift.
    force
        (N, 3): work of the loads on a unit of F's components, N.
    work
        Work of the loads on the lift, J.
    anchors
        (r, N, 3): on F's values, the means of u along the rigid motions left free, times the root of the membrane
        stiffness. Their squares pin those motions and cost nothing: loads in balance do no work on them.
    """

    rows: Tensor
    offset: Tensor
    force: Tensor
    work: float
    anchors: Tensor


def tabulate(ansatz: Ansatz, rule: Rule, placement: Placement, area: float = 1.0) -> Table:
    """Return the table at the points of an area rule; `area` (m^2) divides the means of the anchors."""
    case, points = ansatz.case, rule.points
    reference = geometry(case.surface, points, placement)
    matrix = ansatz.factors.matrix(points, placement)
    weights = placement.tensor(rule.weights) * reference.jacobian
    rows = energy_rows(reference, case.material) * weights.sqrt()[:, None, None, None]
    force = placement.tensor(force_density(case, points, ansatz.t)) * weights[:, None]
    offset, work = rows.new_zeros(rows.shape[:2]), 0.0
    if ansatz.lift.moves:
        lift = ansatz.lift.jet(points, placement)
        offset, work = apply_rows(rows, lift), float((force * lift[VALUE]).sum())
    modes = placement.tensor(rigid_modes(case.surface, points)[0, 0] @ free_motions(case)).permute(2, 0, 1)
    anchors = modes * (weights / area)[:, None] * case.material.membrane_stiffness**0.5
    transposed = matrix[VALUE].mT
    return Table(
        through_matrix(rows, matrix),
        offset,
        (transposed @ force[..., None])[..., 0],
        work,
        (transposed @ anchors[..., None])[..., 0],
    )


def tables(ansatz: Ansatz, rule: Rule, placement: Placement, batch: int = BATCH) -> Iterator[tuple[Array, Table]]:
    """Yield the points and the table of one batch of a rule after the other."""
    area = surface_area(ansatz, rule)
    for start in range(0, len(rule.points), batch):
        part = slice(start, start + batch)
        points = rule.points[part]
        yield points, tabulate(ansatz, Rule(points, rule.weights[part]), placement, area)


def surface_area(ansatz: Ansatz, rule: Rule) -> float:
    """Return the area of the midsurface, m^2."""
    x = ansatz.case.surface.derivatives(rule.points, 1)
    return float(rule.weights @ np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1))


@dataclass(frozen=True)
class Concentrated:
    """Edge and point loads: `force` (P, 3) is their work on a unit of F at `points` (P, 2), `work` that on the lift."""

    points: Array
    force: Tensor
    work: float


def concentrated(ansatz: Ansatz, spec: RuleSpec, focal: Array, placement: Placement) -> Concentrated:
    """Tabulate edge loads (by an edge rule as fine as `spec`) and point loads."""
    points, forces = concentrated_forces(ansatz.case, spec, focal, ansatz.t)
    if not len(points):
        return Concentrated(points, placement.tensor(forces), 0.0)
    force = placement.tensor(forces)
    matrix = ansatz.factors.matrix(points, placement)[VALUE]
    work = float((force * ansatz.lift.jet(points, placement)[VALUE]).sum()) if ansatz.lift.moves else 0.0
    return Concentrated(points, (matrix.mT @ force[..., None])[..., 0], work)


def strain_matrix(table: Table, jets: Tensor) -> Tensor:
    """Return the rows (6 N, 3 M) of all (component, feature) pairs, from feature jets (6, N, M)."""
    count, width = jets.shape[1:]
    return (table.rows.reshape(count, 18, 6) @ jets.permute(1, 0, 2)).view(6 * count, 3 * width)


def value_vector(force: Tensor, values: Tensor) -> Tensor:
    """Return the work (3 M,) on all (component, feature) pairs of forces (N, 3) on F, from values (N, M)."""
    return (force.T @ values).reshape(-1)


@dataclass(frozen=True)
class NormalEquations:
    """The energy 1/2 w K w - f w + c of the output weights w (3 M,), component by component.

    Attributes
    ----------
    stiffness, load
        K (3 M, 3 M) and f (3 M,), J.
    anchor
        (r, 3 M): rows whose squares may be added to K to pin the rigid motions left free.
    constant
        c: the potential energy of the lift alone, J.
    uncancelled
        The largest work of all loads on a feature if none of it cancelled, J.
    """

    stiffness: Tensor
    load: Tensor
    anchor: Tensor
    constant: float
    uncancelled: float = 0.0


def normal_equations(ansatz: Ansatz, features: Features, rule: Rule, forces: Concentrated) -> NormalEquations:
    """Integrate the energy of the output weights on a rule."""
    unknowns, placement = 3 * features.count, features.placement
    like = features.network.weights[0]
    stiffness, load = like.new_zeros((unknowns, unknowns)), like.new_zeros(unknowns)
    anchor, constant = like.new_zeros((free_motions(ansatz.case).shape[1], unknowns)), -forces.work
    uncancelled = torch.zeros_like(load)
    for points, table in tables(ansatz, rule, placement):
        jets = features.jets(points)
        rows = strain_matrix(table, jets)
        add_gram(stiffness, rows)
        load += value_vector(table.force, jets[VALUE]) - rows.T @ table.offset.reshape(-1)
        anchor += (table.anchors.mT @ jets[VALUE]).reshape(len(anchor), unknowns)
        constant += 0.5 * float((table.offset**2).sum()) - table.work
        uncancelled += value_vector(table.force.abs(), jets[VALUE].abs())
    if len(forces.points):
        values = features.values(forces.points)
        load += value_vector(forces.force, values)
        uncancelled += value_vector(forces.force.abs(), values.abs())
    return NormalEquations(mirrored(stiffness), load, anchor, constant, float(uncancelled.max()))


def add_gram(total: Tensor, rows: Tensor) -> None:
    """Add rows^T rows to the blocks on and above the diagonal: nearly half the work of one product."""
    for start in range(0, total.shape[1], BLOCK):
        stop = start + BLOCK
        total[:stop, start:stop].addmm_(rows[:, :stop].T, rows[:, start:stop])


def mirrored(upper: Tensor) -> Tensor:
    """Return the symmetric matrix whose upper half is given."""
    return torch.triu(upper) + torch.triu(upper, 1).T
