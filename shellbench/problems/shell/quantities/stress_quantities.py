"""Stresses at the faces of a shell, from its stress resultants.

Over the thickness h the stresses that belong to membrane forces n and moments m are linear:

    sigma_ij = n_ij / h + 12 z m_ij / h^3,    z = h/2 at the top, 0 at the middle, -h/2 at the bottom.

The top is the side to which the normal points. Any solver that gives resultants gives stresses.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.field import DisplacementField
from shellbench.problems.shell.quantities.displacement_quantities import Direction
from shellbench.problems.shell.quantities.resultant_quantities import PlacedQuantity, tensor_component, turned_tensor

Array = NDArray[np.float64]

SIDES = {"top": 6.0, "middle": 0.0, "bottom": -6.0}  # of m / h^2
STEEP = 1e-6  # least share of a direction within the surface


class Stress(PlacedQuantity):
    """A stress at a face or at the midsurface, Pa, from membrane force and moment.

    Attributes
    ----------
    side
        The top is the side to which the normal points.
    component
        In the shell's frame, or in that of `direction`; a principal value, of which the first is the larger one; or the
        equivalent stress of von Mises.
    direction
        Direction in space whose projection on the surface is the axis 1 of the component, of any length; along the
        coordinate line of xi1 by default. Axis 2 is normal to it within the surface.
    """

    powers = (-2, 1)
    kind: Literal["stress"]
    side: Literal["top", "middle", "bottom"]
    component: Literal["11", "22", "12", "principal_1", "principal_2", "von_mises"]
    direction: Direction | None = None
    unit: str = "Pa"

    def check(self, shell: Any) -> None:
        """Raise ValueError if it has no value there: at a corner, or with a direction along the normal, as well."""
        super().check(shell)
        if getattr(shell.material, "membrane", None) is not None:
            raise ValueError(f"quantity '{self.name}' is a stress, and a shell of given stiffnesses has none")
        if corner := self.corner_of(shell):
            raise ValueError(f"quantity '{self.name}' has no value at the corner '{corner[0]}': ask for a moment there")
        if self.direction is not None and np.any(
            np.linalg.norm(self._axis(shell, self.rule(shell)[0]), axis=1) < STEEP
        ):
            raise ValueError(f"quantity '{self.name}' has a direction along the normal, which lies in no surface")

    def _axis(self, shell: Any, points: Array) -> Array:
        """Return the share of the direction along e_1 and e_2 of the shell's frame, (n, 2)."""
        x = shell.surface.derivatives(points, order=1)
        first, normal = x[1, 0], np.cross(x[1, 0], x[0, 1])
        second = np.cross(normal, first)
        along = np.array(self.direction) / np.linalg.norm(np.array(self.direction))
        return np.stack([e @ along / np.linalg.norm(e, axis=1) for e in (first, second)], axis=1)

    def measure(self, solution: DisplacementField) -> float:
        """Return the stress, Pa, or its mean."""
        case = solution.case
        points, weights = self.rule(case)
        forces, moments = (solution.evaluate(name, points, at=self.at) for name in ("membrane_force", "moment"))
        h = case.material.thickness * case.material.factors(points, case.surface.named_constants)[1][:, None]
        return float(
            weights @ self.component_of(self._turned(case, points, forces / h + SIDES[self.side] * moments / h**2))
        )

    def _turned(self, shell: Any, points: Array, stresses: Array) -> Array:
        """Return stresses 11, 22, 12 (n, 3) in the frame of the direction."""
        if self.direction is None:
            return stresses
        axis = self._axis(shell, points)
        return turned_tensor(stresses, *(axis / np.linalg.norm(axis, axis=1)[:, None]).T)

    def component_of(self, values: Array) -> Array:
        """Return the component (n,) of stresses 11, 22, 12 (n, 3)."""
        if self.component != "von_mises":
            return tensor_component(values, self.component)
        first, second, shear = values.T
        return np.asarray(np.sqrt(first**2 - first * second + second**2 + 3 * shear**2))
