"""Linear isotropic shell material (Kairanda et al., eqs. (17)-(19))."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from shellbench.model import Finite, Model, Positive


class Material(Model):
    """Young's modulus, Poisson's ratio, thickness and density of a shell.

    The strain energy per reference area is W = 1/2 (D H eps eps + B H kappa kappa).
    """

    youngs_modulus: Positive = Field(description="E, Pa")
    poissons_ratio: Annotated[Finite, Field(gt=-1, lt=0.5)] = Field(description="nu")
    thickness: Positive = Field(description="h, metres")
    areal_density: Annotated[Finite, Field(ge=0)] = Field(0.0, description="rho, kg per square metre")
    bending_factor: Positive = Field(1.0, description="scales B alone; 1 for a homogeneous shell")

    @property
    def membrane_stiffness(self) -> float:
        """D = E h / (1 - nu^2), N/m (eq. (18))."""
        return self.youngs_modulus * self.thickness / (1 - self.poissons_ratio**2)

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / (12 (1 - nu^2)), N m (eq. (18)). Timoshenko's books call it D."""
        return self.bending_factor * self.membrane_stiffness * self.thickness**2 / 12
