"""Reference geometry of the midsurface at points: what strains, loads and supports are made of.

Written for this package alone and in its own form, by jets of the base vectors; the finite element reference has its
own. Index letters as in Kairanda et al., section 3: a_1, a_2, a3 covariant, a^1, a^2 contravariant base vectors.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.problems.shell.surface import Surface
from shellbench.solvers.ndf.jets import (
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
