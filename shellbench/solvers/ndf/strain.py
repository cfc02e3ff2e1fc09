"""Linear strains of a displacement field, from its gradients and the reference geometry.

eps_ab = 1/2 (phi_ab + phi_ba), phi_ab = u,a . a_b, and kappa_ab = -(u,ab - Gamma^m_ab u,m) . a3
(Kairanda et al., eq. (30), its linear part), with reference Christoffel symbols. Everything here is linear in
the jet of u, so strains are kept as rows: (N, 6, 3, 6), strain by component of u by plane of the jet.
"""

from __future__ import annotations

import torch
from torch import Tensor

from shellbench.problems.shell.conditions import Material
from shellbench.solvers.ndf.geometry import Geometry
from shellbench.solvers.ndf.jets import D1, D2, D11, D12, D22

E11, E22, E12, K11, K22, K12 = range(6)
PAIRS = ((0, 0), (1, 1), (0, 1))


def strain_rows(geometry: Geometry) -> Tensor:
    """Return the rows (N, 6, 3, 6) of eps_11, eps_22, 2 eps_12, kappa_11, kappa_22, 2 kappa_12.

    The strain s of a displacement with jet u (6, N, 3) is sum over c, p of rows[n, s, c, p] u[p, n, c].
    """
    a, a3 = geometry.tangents, geometry.normal
    rows = a.new_zeros((len(a3), 6, 3, 6))
    rows[:, E11, :, D1], rows[:, E22, :, D2] = a[:, 0], a[:, 1]
    rows[:, E12, :, D1], rows[:, E12, :, D2] = a[:, 1], a[:, 0]
    for row, plane, pair, times in ((K11, D11, 0, 1), (K22, D22, 1, 1), (K12, D12, 2, 2)):
        gamma = geometry.christoffel[:, pair]
        rows[:, row, :, plane] = -times * a3
        rows[:, row, :, D1] = times * gamma[:, :1] * a3
        rows[:, row, :, D2] = times * gamma[:, 1:] * a3
    return rows


def apply_rows(rows: Tensor, jet: Tensor) -> Tensor:
    """Return the strains (N, r) of a field with jet (6, N, 3), by rows (N, r, 3, 6)."""
    count, number = rows.shape[:2]
    return (rows.reshape(count, number, 18) @ jet.permute(1, 2, 0).reshape(count, 18, 1))[..., 0]


def elasticity_tensor(geometry: Geometry, poissons_ratio: float) -> Tensor:
    """Return H^{abcd} (eq. (19)) as (N, 3, 3) over the pairs 11, 22, 12.

    It acts on (s_11, s_22, 2 s_12) from both sides.
    """
    nu, g = poissons_ratio, geometry.inverse_metric
    entries = [
        [
            nu * g[:, a, b] * g[:, c, d] + (1 - nu) / 2 * (g[:, a, c] * g[:, b, d] + g[:, a, d] * g[:, b, c])
            for c, d in PAIRS
        ]
        for a, b in PAIRS
    ]
    return torch.stack([torch.stack(row, dim=-1) for row in entries], dim=-2)


def energy_rows(geometry: Geometry, material: Material) -> Tensor:
    """Return rows (N, 6, 3, 6) whose half sum of squares is the energy density W (eq. (17)), J/m^2.

    The first three carry the membrane part, the last three the bending part.
    """
    root = torch.linalg.cholesky(elasticity_tensor(geometry, material.poissons_ratio)).mT
    rows = strain_rows(geometry)
    count = len(rows)
    membrane = material.membrane_stiffness**0.5 * root @ rows[:, :3].reshape(count, 3, 18)
    bending = material.bending_stiffness**0.5 * root @ rows[:, 3:].reshape(count, 3, 18)
    return torch.cat([membrane, bending], dim=1).view(count, 6, 3, 6)


def through_matrix(rows: Tensor, matrix: Tensor) -> Tensor:
    """Rewrite rows (N, r, 3, 6) on the jet of M F as rows on the jet of F, M a jet (6, N, 3, 3).

    The product rule, transposed: sum over planes of M's and F's contributions.
    """

    def times(plane: int, factor: int) -> Tensor:
        return rows[..., plane] @ matrix[factor]

    value = sum((times(k, k) for k in range(1, 6)), times(0, 0))
    return torch.stack(
        [
            value,
            times(D1, 0) + 2 * times(D11, D1) + times(D12, D2),
            times(D2, 0) + 2 * times(D22, D2) + times(D12, D1),
            times(D11, 0),
            times(D12, 0),
            times(D22, 0),
        ],
        dim=-1,
    )
