"""Quantities of a shell that is solved many times: for a range of materials, and before and after an edit."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from shellbench.problem import Quantity
from shellbench.protocol.schema import Name, Vector

Parameter = Literal["thickness", "youngs_modulus", "poissons_ratio"]


class Value(Quantity):
    """The asked displacement at a held-out material, m."""

    kind: Literal["value"]
    material: int = Field(ge=0, strict=True, description="number of the held-out material, from 0")

    def measure(self, solution: Any) -> float:
        """Return the displacement, m."""
        return float(solution.value(self.material))


class Sensitivity(Quantity):
    """A derivative of the logarithm of the asked displacement, without unit.

    The derivative is by the logarithm of the thickness or of Young's modulus, or by Poisson's ratio itself.
    """

    kind: Literal["sensitivity"]
    unit: str = ""
    material: int = Field(ge=0, strict=True, description="number of the held-out material, from 0")
    by: Parameter = Field(description="what it is derived by")

    def measure(self, solution: Any) -> float:
        """Return the derivative."""
        return float(solution.sensitivity(self.material, self.by))


ConditionedQuantity = Annotated[Value | Sensitivity, Field(discriminator="kind")]


class EditedDisplacement(Quantity):
    """The displacement of the edited shell along a direction, m, the mean over points; from the earlier solution."""

    kind: Literal["edited_displacement"]
    points: Annotated[tuple[Name, ...], Field(min_length=1)] = Field(description="points of the shell")
    direction: Vector | Annotated[tuple[Vector, ...], Field(min_length=1)] = Field(
        description="one for all points, or one for each"
    )

    def measure(self, solution: Any) -> float:
        """Return the displacement, m."""
        return float(solution.value(self.name))
