"""The energy of u = lift + M F, tabulated at quadrature points.

The strain energy is half the sum of squares of rows that are linear in the jets of F, and the work of the loads is
linear in the values of F. Every recipe uses this table to solve for an output layer, or to train the layers below it.

The certificate: the energy of a found field on an independent, finer quadrature.

On any exact quadrature (f . u)^2 / (u K u) is a lower bound of the compliance, and the potential energy of a field that
moves as prescribed is an upper bound of the true one. A field that exploits its training points has a gap between the
two rules. The gap is no bound on the error of a displacement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from scipy.linalg.blas import dsyrk, ssyrk
from torch import Tensor

from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.solvers.ndf.field.ansatz import Ansatz, FeatureSet
from shellbench.solvers.ndf.field.geometry import apply_rows, energy_rows, geometry, pull_back_rows, rigidities
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.field.quadrature import Rule, RuleSpec
from shellbench.solvers.ndf.field.supports import concentrated_forces, force_density


@dataclass(frozen=True)
class Table:
    """Data of the energy at N points, quadrature weights included.

    Attributes
    ----------
    rows
        (N, r, 3, 6), on the jet of F; half the sum of squares is the energy of strains and springs, J. Three rows of
        membrane, three of bending, and on springs three of u times the root of their stiffness.
    offset
        (N, r): the same rows of the lift.
    force
        (N, 3): work of the loads on a unit of F's components, N.
    work
        Work of the loads on the lift, J.
    anchors
        (r, N, 3): on F's values, the means of u along the rigid motions left free, times the root of the membrane
        stiffness. Their squares pin those motions without effect: loads in balance do no work on them.
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
    rigidity = rigidities(case.surface, case.material, points, placement)
    rows = energy_rows(reference, case.material, rigidity)
    if case.springs:
        rows = torch.cat([rows, spring_rows(placement.tensor(case.spring_stiffness(points)))], dim=1)
    rows = rows * weights.sqrt()[:, None, None, None]
    force = placement.tensor(force_density(case, points, ansatz.t)) * weights[:, None]
    offset, work = rows.new_zeros(rows.shape[:2]), 0.0
    if ansatz.lift.moves:
        lift = ansatz.lift.jet(points, placement)
        offset, work = apply_rows(rows, lift), float((force * lift[VALUE]).sum())
    modes = placement.tensor(rigid_modes(case.surface, points)[0, 0] @ ansatz.free_motions).permute(2, 0, 1)
    anchors = modes * (weights / area)[:, None] * case.material.membrane_stiffness**0.5
    transposed = matrix[VALUE].mT
    return Table(
        pull_back_rows(rows, matrix),
        offset,
        (transposed @ force[..., None])[..., 0],
        work,
        (transposed @ anchors[..., None])[..., 0],
    )


def spring_rows(stiffness: Tensor) -> Tensor:
    """Return rows (N, 3, 3, 6) whose half sum of squares is the energy of springs of a stiffness (N, 3), J/m^2."""
    rows = stiffness.new_zeros((len(stiffness), 3, 3, 6))
    rows[..., VALUE] = torch.diag_embed(stiffness.sqrt())
    return rows


def tables(ansatz: Ansatz, rule: Rule, placement: Placement) -> Iterator[tuple[Array, Table]]:
    """Yield the points and the table, batch by batch of a rule."""
    area = surface_area(ansatz, rule)
    for batch in rule.batches():
        yield batch.points, tabulate(ansatz, batch, placement, area)


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
    """Return the rows (r N, 3 M) of all (component, feature) pairs, from feature jets (6, N, M)."""
    (count, width), number = jets.shape[1:], table.rows.shape[1]
    return (table.rows.reshape(count, 3 * number, 6) @ jets.permute(1, 0, 2)).view(number * count, 3 * width)


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


def normal_equations(ansatz: Ansatz, features: FeatureSet, rule: Rule, forces: Concentrated) -> NormalEquations:
    """Integrate the energy of the output weights on a rule."""
    unknowns, placement = 3 * features.count, features.placement
    stiffness, load = placement.zeros(unknowns, unknowns), placement.zeros(unknowns)
    anchor, constant = placement.zeros(ansatz.free_motions.shape[1], unknowns), -forces.work
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
    return NormalEquations(symmetric(stiffness), load, anchor, constant, float(uncancelled.max()))


def add_gram(total: Tensor, rows: Tensor) -> None:
    """Add rows^T rows on and above the diagonal, half the work of a product; entries below it are undefined."""
    if total.device.type == "cpu":
        # LAPACK stores its triangles by columns: its lower triangle is the upper one here.
        syrk = dsyrk if rows.dtype == torch.float64 else ssyrk
        syrk(1.0, rows.numpy().T, beta=1.0, c=total.numpy().T, overwrite_c=1, lower=1)
    else:
        total.addmm_(rows.T, rows)


def symmetric(upper: Tensor) -> Tensor:
    """Return the symmetric matrix whose upper half is given."""
    return upper.triu() + upper.triu(1).T


Polynomial = tuple[float, float, float]


@dataclass(frozen=True)
class Certificate:
    """Energies on one rule of lift + s (u - lift), as polynomials in s with ascending coefficients, J.

    Attributes
    ----------
    membrane, bending
        Parts of the strain energy (second degree).
    work
        Work of the loads (first degree).
    springs
        Energy of springs and soft supports (second degree): part of the potential energy, but not of the strain energy.
    """

    membrane: Polynomial
    bending: Polynomial
    work: tuple[float, float]
    springs: Polynomial = (0.0, 0.0, 0.0)

    @property
    def gain(self) -> float:
        """Work gained along u without moved supports: -dE/ds at s = 0."""
        return self.work[1]

    @property
    def stiffness(self) -> float:
        """U K u of u - lift: the second derivative of the energy in s."""
        return 2 * (self.membrane[2] + self.bending[2] + self.springs[2])

    @property
    def compliance(self) -> float:
        """(f . u)^2 / (u K u) without moved supports: a lower bound of the shell's compliance."""
        return self.gain**2 / self.stiffness if self.stiffness > 0 else 0.0

    @property
    def best(self) -> float:
        """The multiple s of least energy, without moved supports."""
        return self.gain / self.stiffness if self.stiffness > 0 else 1.0

    def parts(self, s: float = 1.0) -> tuple[float, float, float]:
        """Return membrane energy, bending energy and work of the loads at s, J."""
        membrane, bending = (c[0] + s * (c[1] + s * c[2]) for c in (self.membrane, self.bending))
        return membrane, bending, self.work[0] + s * self.work[1]

    def potential(self, s: float = 1.0) -> float:
        """Return the potential energy at s, J."""
        membrane, bending, work = self.parts(s)
        return membrane + bending + self.spring_energy(s) - work

    def spring_energy(self, s: float = 1.0) -> float:
        """Return the energy of soft supports at s, J."""
        return self.springs[0] + s * (self.springs[1] + s * self.springs[2])


def certify(
    ansatz: Ansatz, features: FeatureSet, outputs: list[Tensor], rule: Rule, forces: Concentrated
) -> list[Certificate]:
    """Return the energies on a rule of the fields with these output layers (3, M), all of the same features."""
    # All energies are polynomials in s for lift + s (u - lift), since strains are linear here:
    # 1. Compute strains of the lift (offset) and of u - lift (row) at the points. The rows contain roots of stiffness
    #    and weight.
    # 2. Sum products by powers of s: offset^2 / 2, offset . row, row^2 / 2. Sum work likewise, in two powers.
    # 3. Add forces at points and edges to the work.
    # One sweep over the points gives the energy of any multiple, and therefore the best one, without another
    # integration.
    stacked = torch.cat(outputs)
    strain = np.zeros((len(outputs), 3, 3))  # output layer; membrane, bending and springs; power of s
    work = np.zeros((len(outputs), 2))
    work[:, 0] = forces.work
    for points, table in tables(ansatz, rule, features.placement):
        free = features.jets(points) @ stacked.T
        work[:, 0] += table.work
        for k in range(len(outputs)):
            jet = free[..., 3 * k : 3 * k + 3]
            rows = apply_rows(table.rows, jet)
            work[k, 1] += float((table.force * jet[VALUE]).sum())
            for part, kind in enumerate((slice(0, 3), slice(3, 6), slice(6, None))):
                offset, row = table.offset[:, kind], rows[:, kind]
                products = ((offset * offset).sum() / 2, (offset * row).sum(), (row * row).sum() / 2)
                strain[k, part] += [float(value) for value in products]
    if len(forces.points):
        free = features.values(forces.points) @ stacked.T
        for k in range(len(outputs)):
            work[k, 1] += float((forces.force * free[:, 3 * k : 3 * k + 3]).sum())
    return [
        Certificate(tuple(m.tolist()), tuple(b.tolist()), tuple(w.tolist()), tuple(s.tolist()))
        for (m, b, s), w in zip(strain, work, strict=True)
    ]


def energy_gap(potential: float, fine: Certificate, moved: bool, rounding: float = 0.0) -> float:
    """Return |C_train / C_fine - 1| from the potential energy on the training rule and the certified energies.

    With loads only, the compliance is C = -2 E. With moved supports the gap is the difference of the two potential
    energies, relative to the magnitudes of their parts. With soft supports both energies include that of the springs:
    the gap then compares the two rules for shell and springs together, and does not show the yield of the supports.
    `rounding`, J, is the least energy in the denominator, as for a shell that moves as a rigid body.
    """
    if not moved:
        # With loads only, E = -C / 2 at the minimum: -2 E is the compliance on the training rule.
        return abs(-2 * potential / fine.compliance - 1) if fine.compliance > 0 else 0.0
    membrane, bending, work = fine.parts()
    magnitude = membrane + bending + fine.spring_energy() + abs(work) + rounding
    return abs(potential - fine.potential()) / magnitude if magnitude > 0 else 0.0


def why_exploited(gap: float, largest: float, rule: str = "finer") -> str | None:
    """Return the clause that refuses a field whose energies on two rules disagree too much, or None if they do not."""
    if gap <= largest:  # False if it is NaN
        return None
    return (
        f"the field exploits its quadrature: its energy on the {rule} one differs by {gap:.2g},"
        f" more than the {largest:g} allowed"
    )
