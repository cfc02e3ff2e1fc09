"""What can be asked of an edited shell: displacements, as they are answered from the earlier solution."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from shellbench.problem import Quantity
from shellbench.protocol.schema import Name, Vector


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
