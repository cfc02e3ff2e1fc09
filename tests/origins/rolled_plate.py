r"""A plate rolled into an arc, and a shell turned as a rigid body: energies of prescribed displacements.

Rolled without stretch to the angle theta over its length L, a plate has eps = 0 and kappa_11 = theta / L in size
everywhere: W = 1/2 B (theta / L)^2 L b with B = E h^3 / 12 for nu = 0. A rigid motion changes neither the metric nor
the curvature: W = 0. `energy_of_a_rigid_rotation` and `energy_of_the_rolled_plate` are second forms that differentiate
positions of points: forms of the deformed surface by differences, then a Gauss rule.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .estimate import Estimate


@dataclass(frozen=True)
class Plate:
    """Length along which it is rolled, width and thickness in m, Young's modulus in Pa; no Poisson's effect."""

    length: float = 1.0
    width: float = 0.5
    thickness: float = 0.01
    young: float = 1.2e7

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / 12, N m."""
        return self.young * self.thickness**3 / 12.0


def bending_energy(plate: Plate, angle: float) -> float:
    """Bending energy (J) of the plate rolled by so many radians."""
    return 0.5 * plate.bending_stiffness * (angle / plate.length) ** 2 * plate.length * plate.width


def rolled_plate() -> dict[str, Estimate]:
    """Known values of the rolled plate at every quarter of its path."""
    plate = Plate()
    return {
        f"bending_energy_{degrees}": Estimate.exact(bending_energy(plate, np.radians(degrees)), "J")
        for degrees in (45, 90, 135, 180)
    }


def rigid_rotation() -> dict[str, Estimate]:
    """Known values of the rigid rotation: none stores anything."""
    return {f"strain_energy_{degrees}": Estimate(0.0, 0.0, "J") for degrees in (90, 180)}
