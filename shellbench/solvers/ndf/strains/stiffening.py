"""The membrane of woven cloth that stiffens (`question.orthotropic`), with the energy of Clyde et al. 2017.

Only the energy is written down: stresses and moduli are its derivatives by automatic differentiation, and so are the
slopes and second derivatives with which a curve goes on beyond its range.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from shellbench.problems.shell.question.orthotropic import AnyMaterial, OrthotropicMaterial, StiffeningCurve
from shellbench.solvers.ndf.field.geometry import Geometry, direction_products


@dataclass(frozen=True)
class StiffeningMembrane:
    """The membrane at N points; strains (N, 3) are eps_11, eps_22, 2 eps_12.

    Attributes
    ----------
    material
        One with `stiffening`.
    products
        (3, N, 3) see `direction_products`.
    """

    material: OrthotropicMaterial
    products: Tensor

    def respond(self, strains: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return energies (N,), stresses (N, 3) conjugate to the strains, and moduli (N, 3, 3), per area."""
        stresses, moduli = _two_derivatives(self._energies, strains)
        return self._energies(strains), stresses, moduli

    def _energies(self, strains: Tensor) -> Tensor:
        own = (self.products * strains).sum(-1)  # E11, E22 and E12 of the material, each (N,)
        energy = self.material.stiffnesses[0].item(0, 1) * own[0] * own[1]
        for strain, (curve, factor, least) in zip(own, self.material.curves, strict=True):
            energy = energy + factor * _continued(curve, strain, least)
        return energy


def stiffening_membrane(geometry: Geometry, material: AnyMaterial) -> StiffeningMembrane | None:
    """Return the membrane of a material that stiffens; None for a linear one."""
    if not isinstance(material, OrthotropicMaterial) or material.stiffening is None:
        return None
    return StiffeningMembrane(material, direction_products(geometry, material))


def _continued(curve: StiffeningCurve, strain: Tensor, least: float) -> Tensor:
    """Return eta(E^2)/2 of strains (N,), and its Taylor series of second degree beyond the range."""
    found = _half_eta(curve, strain.clamp(least, curve.until))
    for end, beyond in ((least, strain < least), (curve.until, strain > curve.until)):
        value, slope, second = _taylor(curve, end)
        step = strain - end
        found = torch.where(beyond, value + slope * step + second * step**2 / 2, found)
    return found


def _half_eta(curve: StiffeningCurve, strain: Tensor) -> Tensor:
    terms = zip(curve.mu, curve.alpha, strict=True)
    return torch.stack([mu / alpha * torch.expm1(alpha * torch.log1p(strain**2)) for mu, alpha in terms]).sum(0) / 2


@lru_cache(maxsize=32)
def _taylor(curve: StiffeningCurve, end: float) -> tuple[float, float, float]:
    """Return eta(E^2)/2 and its first two derivatives at an end of the range."""
    at = torch.full((1, 1), end, dtype=torch.float64)
    slope, second = _two_derivatives(lambda e: _half_eta(curve, e), at)
    return _half_eta(curve, at).item(), slope.item(), second.item()


def _two_derivatives(function: Callable[[Tensor], Tensor], at: Tensor) -> tuple[Tensor, Tensor]:
    """Return the gradients (N, k) and second derivatives (N, k, k) of a function of each row of points (N, k)."""
    with torch.enable_grad():
        x = at.detach().requires_grad_()
        (first,) = torch.autograd.grad(function(x).sum(), x, create_graph=True)
        second = [torch.autograd.grad(first[:, k].sum(), x, retain_graph=True)[0] for k in range(at.shape[1])]
    return first.detach(), torch.stack(second, dim=1)
