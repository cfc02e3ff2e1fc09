"""The undeformed surface at points: what strain measures need of it, and its elasticity."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.problems.shell.conditions import Material
from shellbench.problems.shell.surface import Surface
from shellbench.solvers.ndf.choices import StrainName
from shellbench.solvers.ndf.geometry import Geometry, geometry
from shellbench.solvers.ndf.jets import D11, D12, D22, Array, Placement, from_derivatives
from shellbench.solvers.ndf.strain import elasticity_tensor
from shellbench.solvers.ndf.strain_measures import MEASURES, Reference, Strained, gradient_map


@dataclass(frozen=True)
class Undeformed:
    """Geometry at N points, and in the form that strain measures take."""

    geometry: Geometry
    reference: Reference

    @classmethod
    def at_points(cls, surface: Surface, points: Array, placement: Placement) -> Undeformed:
        """Look at points (N, 2) of a surface."""
        found = geometry(surface, points, placement)
        jet = from_derivatives(surface.derivatives(points, 2), placement)
        second = torch.stack([jet[D11], jet[D22], jet[D12]], dim=1)
        curvature = (second @ found.normal[..., None])[..., 0]
        return cls(found, Reference(found.tangents, found.normal, found.inverse_metric, curvature))

    def gradients(self, jet: Tensor) -> Tensor:
        """Return u,1, u,2, d_11, d_22, d_12 (N, 5, 3) of a displacement with jet (6, N, 3)."""
        return gradient_map(self.geometry) @ jet.permute(1, 0, 2)

    def strained(self, measure: StrainName, gradients: Tensor) -> Strained:
        """Return the strains that displacement gradients (N, 5, 3) make."""
        return MEASURES[measure].from_gradients(self.reference, gradients)

    def elasticity(self, material: Material) -> Tensor:
        """Return D H and B H (eqs. (17)-(19)) as (N, 2, 3, 3), N/m and N m."""
        tensor = elasticity_tensor(self.geometry, material.poissons_ratio)[:, None]
        stiffness = tensor.new_tensor([material.membrane_stiffness, material.bending_stiffness])
        return tensor * stiffness[:, None, None]


def stresses(elasticity: Tensor, strains: Tensor) -> Tensor:
    """Return what is conjugate to strains (N, 6), for an elasticity (N, 2, 3, 3)."""
    return (elasticity @ strains.view(-1, 2, 3, 1)).view(-1, 6)
