"""The certificate: the energy of a found field on an independent, finer quadrature.

On any exact quadrature (f . u)^2 / (u K u) is a lower bound of the compliance, and the potential energy of a field that
moves as prescribed an upper bound of the true one. A field that exploits the points it was trained on shows a gap
between the two rules. The gap is no bound on the error of a displacement.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.rigid import free_motions, rigid_modes
from shellbench.solvers.ndf.energy import Concentrated, tables
from shellbench.solvers.ndf.field import Ansatz, Features, Field
from shellbench.solvers.ndf.jets import VALUE
from shellbench.solvers.ndf.quadrature import Rule
from shellbench.solvers.ndf.strain import apply_rows

Polynomial = tuple[float, float, float]


@dataclass(frozen=True)
class Certified:
    """Energies on one rule of lift + s (u - lift), as polynomials in s with ascending coefficients, J.

    Attributes
    ----------
    membrane, bending
        Parts of the strain energy (second degree).
    work
        Work of the loads (first degree).
    springs
        Energy of soft supports (second degree); it is part of the potential energy, and of no strain energy.
    """

    membrane: Polynomial
    bending: Polynomial
    work: tuple[float, float]
    springs: Polynomial = (0.0, 0.0, 0.0)

    @property
    def gain(self) -> float:
        """Work gained along u - lift, less what the lift's strains resist: -dE/ds at s = 0."""
        return self.work[1] - self.membrane[1] - self.bending[1] - self.springs[1]

    @property
    def stiffness(self) -> float:
        """U K u of u - lift: the second derivative of the energy in s."""
        return 2 * (self.membrane[2] + self.bending[2] + self.springs[2])

    @property
    def compliance(self) -> float:
        """(f . u)^2 / (u K u) where nothing is moved: a lower bound of the shell's compliance."""
        return self.gain**2 / self.stiffness if self.stiffness > 0 else 0.0

    @property
    def best(self) -> float:
        """The multiple s of least energy."""
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
    ansatz: Ansatz, features: Features, outputs: list[Tensor], rule: Rule, forces: Concentrated
) -> list[Certified]:
    """Return the energies on a rule of the fields with these output layers (3, M), all of the same features."""
    # All energies are polynomials in s for lift + s (u - lift), as strains are linear here:
    # 1. Strains of the lift (offset) and of u - lift (row) at the points. The rows hold roots of stiffness and weight.
    # 2. Products by powers of s: offset^2 / 2, offset . row, row^2 / 2. Work likewise, in two powers.
    # 3. Forces at points and edges add to the work only.
    # One sweep over the points gives the energy of any multiple, and so the best one, without another integration.
    stacked = torch.cat(outputs)
    strain = np.zeros((len(outputs), 2, 3))  # output layer, membrane and bending, power of s
    work = np.zeros((len(outputs), 2))
    work[:, 0] = forces.work
    for points, table in tables(ansatz, rule, features.placement):
        free = features.jets(points) @ stacked.T
        work[:, 0] += table.work
        for k in range(len(outputs)):
            jet = free[..., 3 * k : 3 * k + 3]
            rows = apply_rows(table.rows, jet)
            work[k, 1] += float((table.force * jet[VALUE]).sum())
            for part, kind in enumerate((slice(0, 3), slice(3, 6))):
                offset, row = table.offset[:, kind], rows[:, kind]
                products = ((offset * offset).sum() / 2, (offset * row).sum(), (row * row).sum() / 2)
                strain[k, part] += [float(value) for value in products]
    if len(forces.points):
        free = features.values(forces.points) @ stacked.T
        for k in range(len(outputs)):
            work[k, 1] += float((forces.force * free[:, 3 * k : 3 * k + 3]).sum())
    return [
        Certified(tuple(m.tolist()), tuple(b.tolist()), tuple(w.tolist()))
        for (m, b), w in zip(strain, work, strict=True)
    ]


def energy_gap(potential: float, fine: Certified, moved: bool) -> float:
    """Return |C_train / C_fine - 1| from the potential energy on the training rule and the certified energies.

    Where only loads act, the compliance is C = -2 E. Where supports are moved it is the disagreement of the two
    potential energies, relative to the magnitudes they are made of. With soft supports both energies have the springs'
    in them: the gap then says how well the two rules agree on shell and springs together, and nothing of how far the
    supports give.
    """
    if not moved:
        # With loads only E = -C / 2 at the minimum: -2 E is the compliance on the training rule.
        return abs(-2 * potential / fine.compliance - 1) if fine.compliance > 0 else 0.0
    membrane, bending, work = fine.parts()
    magnitude = membrane + bending + fine.spring_energy() + abs(work)
    return abs(potential - fine.potential()) / magnitude if magnitude > 0 else 0.0


def rigid_part(field: Field, rule: Rule) -> Tensor:
    """Return the rigid motion (6,) left free by the supports that a field has in the mean over the area."""
    case, placement = field.ansatz.case, field.features.placement
    free = free_motions(case)
    if not free.shape[1]:
        return torch.zeros_like(field.rigid)
    x = case.surface.derivatives(rule.points, 1)
    area = rule.weights * np.linalg.norm(np.cross(x[1, 0], x[0, 1]), axis=-1)
    modes = rigid_modes(case.surface, rule.points)[0, 0] @ free
    displacement = field.less_rigid(torch.zeros_like(field.rigid)).displacement(rule.points).cpu().numpy()
    # Least squares over the area, for the modes that no support holds.
    gram = np.einsum("p,pik,pil->kl", area, modes, modes)
    moments = np.einsum("p,pik,pi->k", area, modes, displacement)
    return placement.tensor(free @ np.linalg.solve(gram, moments))
