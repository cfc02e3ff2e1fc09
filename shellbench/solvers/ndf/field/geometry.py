"""Reference geometry of the midsurface at points, and the linear strains of a displacement field on it.

This package has its own implementation, by jets of the base vectors; the finite element reference has another. Index
letters as in Kairanda et al. 2023, section 3: a_1, a_2, a3 covariant, a^1, a^2 contravariant base vectors.

Strains follow from the displacement's gradients and this geometry,

    eps_ab = 1/2 (phi_ab + phi_ba),  phi_ab = u,a . a_b,  and  kappa_ab = -(u,ab - Gamma^m_ab u,m) . a3

(Kairanda et al. 2023, eq. (30), its linear part), with reference Christoffel symbols. They are linear in the jet of u,
and kept as rows: (N, 6, 3, 6), strain by component of u by plane of the jet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.orthotropic import AnyMaterial, OrthotropicMaterial
from shellbench.problems.shell.question.surface import Surface
from shellbench.solvers.ndf.field.jets import (
    D1,
    D2,
    D11,
    D12,
    D22,
    VALUE,
    Array,
    Placement,
    cross,
    dot,
    from_derivatives,
    power,
    product,
)

SURFACE_SAMPLES = 9  # points a side of the grid on which a surface is sampled

LINE = 65  # points of a coordinate line that is measured


@dataclass(frozen=True)
class Geometry:
    """Geometry at N points.

    Attributes
    ----------
    position
        (N, 3).
    tangents
        (N, 2, 3): a_1, a_2.
    normal
        (N, 3): a3 (eq. (5)).
    inverse_metric
        (N, 2, 2): a^{ab}.
    christoffel
        (N, 3, 2): Gamma^m_ab, pairs ab = 11, 22, 12.
    jacobian
        (N,): sqrt(a), area per parametric area (eq. (7)).
    """

    position: Tensor
    tangents: Tensor
    normal: Tensor
    inverse_metric: Tensor
    christoffel: Tensor
    jacobian: Tensor


def geometry(surface: Surface, points: Array, placement: Placement) -> Geometry:
    """Return the geometry at points (N, 2)."""
    x = from_derivatives(surface.derivatives(points, 2), placement)
    tangents = torch.stack([x[D1], x[D2]], dim=1)
    inverse = torch.linalg.inv(tangents @ tangents.mT)
    area = torch.linalg.cross(x[D1], x[D2], dim=-1)
    jacobian = area.norm(dim=-1)
    curving = torch.stack([x[D11], x[D22], x[D12]], dim=1)
    christoffel = curving @ tangents.mT @ inverse
    return Geometry(x[VALUE], tangents, area / jacobian[:, None], inverse, christoffel, jacobian)


def normal_jet(surface: Surface, points: Array, placement: Placement) -> Tensor:
    """Return the jet (6, N, 3) of a3 at points (N, 2)."""
    x = surface.derivatives(points, 3)
    area = cross(from_derivatives(x, placement, (1, 0)), from_derivatives(x, placement, (0, 1)))
    return product(area, power(dot(area, area), -0.5)[..., None])


def contravariant_basis_jet(surface: Surface, points: Array, placement: Placement) -> Tensor:
    """Return the jet (6, N, 3, 3) of the matrix whose columns are a^1, a^2, a3, at points (N, 2)."""
    x = surface.derivatives(points, 3)
    a1, a2 = from_derivatives(x, placement, (1, 0)), from_derivatives(x, placement, (0, 1))
    area = cross(a1, a2)
    square = power(dot(area, area), -1.0)[..., None]
    normal = product(area, power(dot(area, area), -0.5)[..., None])
    return torch.stack([product(cross(a2, area), square), product(cross(area, a1), square), normal], dim=-1)


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


def direction_products(geometry: Geometry, material: OrthotropicMaterial) -> Tensor:
    """Return S (3, N, 3): d1 d1, d2 d2 and the symmetric part of d1 d2 over the pairs 11, 22, 12.

    d1 and d2 are the material's directions, by their contravariant components d^a = g^{ab} a_b . d.
    """
    number = 0 if material.along == "xi1" else 1
    tangent, normal = geometry.tangents[:, number], geometry.normal
    line = tangent / tangent.norm(dim=-1, keepdim=True)
    turned = torch.linalg.cross(normal, line)
    angle = math.radians(material.angle)
    directions = torch.stack([math.cos(angle) * line + math.sin(angle) * turned,
                              math.cos(angle) * turned - math.sin(angle) * line])  # fmt: skip
    first, second = torch.einsum("nab,nbi,dni->dna", geometry.inverse_metric, geometry.tangents, directions)
    products = [(first, first), (second, second), (first, second)]
    return torch.stack(
        [torch.stack([(d[:, a] * e[:, b] + d[:, b] * e[:, a]) / 2 for a, b in PAIRS], dim=-1) for d, e in products]
    )


def elasticity_tensors(geometry: Geometry, material: AnyMaterial) -> tuple[Tensor, Tensor]:
    """Return the tensors (N, 3, 3) of stretching and bending over D and B; they act as `elasticity_tensor` does.

    An orthotropic C^{abcd} is the sum over i and j of M_ij S_i^{ab} S_j^{cd}, with `direction_products` S; the third
    of them meets 2 e12 = 2 S_3^{ab} e_ab.
    """
    if not isinstance(material, OrthotropicMaterial):
        first, second = (elasticity_tensor(geometry, nu) for nu in material.poissons_ratios)
        return first, second
    products = direction_products(geometry, material) * geometry.tangents.new_tensor([1.0, 1.0, 2.0])[:, None, None]
    scaled = zip(material.stiffnesses, (material.membrane_stiffness, material.bending_stiffness), strict=True)
    membrane, bending = (
        torch.einsum("inp,jnq,ij->npq", products, products, products.new_tensor(matrix / scale))
        for matrix, scale in scaled
    )
    return membrane, bending


def rigidities(surface: Surface, material: AnyMaterial, points: Array, placement: Placement) -> tuple[Tensor, Tensor]:
    """Return D and B (eq. (18)) of the modulus and thickness at points (N, 2), each (N, 1, 1)."""
    young, height = (placement.tensor(f)[:, None, None] for f in material.factors(points, surface.named_constants))
    stretch = material.membrane_stiffness * young * height
    return stretch, stretch * height.square() * (material.bending_stiffness / material.membrane_stiffness)


def energy_rows(geometry: Geometry, material: AnyMaterial, rigidity: tuple[Tensor, Tensor]) -> Tensor:
    """Return rows (N, 6, 3, 6) whose half sum of squares is the energy density W (eq. (17)), J/m^2.

    The first three carry the membrane part, the last three the bending part;
    `rigidity` is D and B, as (N, 1, 1).
    """
    stretching, turning = (torch.linalg.cholesky(tensor).mT for tensor in elasticity_tensors(geometry, material))
    rows = strain_rows(geometry)
    count = len(rows)
    membrane = rigidity[0].sqrt() * stretching @ rows[:, :3].reshape(count, 3, 18)
    bending = rigidity[1].sqrt() * turning @ rows[:, 3:].reshape(count, 3, 18)
    return torch.cat([membrane, bending], dim=1).view(count, 6, 3, 6)


def pull_back_rows(rows: Tensor, matrix: Tensor) -> Tensor:
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


def surface_size(case: Case) -> float:
    """Return the largest distance from the middle of the surface, metres."""
    sample = case.surface.position(case.surface.domain.grid(SURFACE_SAMPLES, SURFACE_SAMPLES)).reshape(-1, 3)
    return float(np.linalg.norm(sample - sample.mean(axis=0), axis=1).max())


def side_lengths(case: Case) -> tuple[float, float]:
    """Return the lengths of the coordinate lines through the middle, metres."""
    domain = case.surface.domain
    lines = []
    for axis in (0, 1):
        middle = (np.asarray(domain.lower) + np.asarray(domain.upper)) / 2
        points = np.tile(middle, (LINE, 1))
        points[:, axis] = np.linspace(domain.lower[axis], domain.upper[axis], LINE)
        lines.append(float(np.linalg.norm(np.diff(case.surface.position(points), axis=0), axis=-1).sum()))
    return lines[0], lines[1]
