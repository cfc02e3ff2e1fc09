r"""A square that falls freely from rest: Newton's law, and what the published functional makes of it.

Newton: u_z = -g t^2 / 2. The published functional is the time integral of potential plus kinetic energy (Kairanda et
al., eq. (35)). Of the fall s = -u_z it is, per area,

    J[s] = rho int_0^T (s'^2 / 2 - g s) dt,   dJ = rho ( [s' ds]_0^T - int_0^T (s'' + g) ds dt ),

so that it is stationary, and smallest, for s'' = -g, Newton's law with inertia of the other sign. With s(0) = 0 and, as
the end is free, s'(T) = 0,

    s = g (T t - t^2 / 2),   J = -rho g^2 T^3 / 6:

3 times the true fall at T/2 (3/8 against 1/8 of g T^2), the same at T, at rest there, and with the velocity g T at the
start. The published factor t^2 of the field, meant to hold the start at rest, excludes this motion but not ones as
close to it as one likes: J has an infimum there and no minimum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .estimate import Estimate
from .explicit_motion import motion
from .spline_motion import Cloth
from .spline_shell import Splines

TIMES = (0.5, 1.0)
TOLERANCE, INTEGRATED = 1e-10, 1e-9
"""Of the Runge-Kutta method, which is exact for this motion but for rounding, and what rounding leaves, m and J."""


@dataclass(frozen=True)
class FreeFall:
    """Side of the square in m, density in kg/m^2, gravity in m/s^2, last time in s."""

    side: float = 1.0
    density: float = 0.144
    gravity: float = 9.8
    until: float = 1.0

    def fall(self, time: float) -> float:
        """Distance fallen under Newton's law, m."""
        return self.gravity * time**2 / 2

    def kinetic_energy(self, time: float) -> float:
        """Kinetic energy under Newton's law, J."""
        return self.density * self.side**2 * (self.gravity * time) ** 2 / 2

    def published_fall(self, time: float) -> float:
        """Distance fallen where the published functional is stationary, m."""
        return self.gravity * (self.until * time - time**2 / 2)

    @property
    def published_functional(self) -> float:
        """The functional's least value over the square, J s."""
        return -self.density * self.side**2 * self.gravity**2 * self.until**3 / 6


def free_fall() -> dict[str, Estimate]:
    """Known values of the falling square."""
    case = FreeFall()
    values = {}
    for time in TIMES:
        label = f"{1000 * time:.0f}ms"
        values[f"fall_{label}"] = Estimate.exact(case.fall(time), "m")
        values[f"centre_z_{label}"] = Estimate.exact(-case.fall(time), "m")
        values[f"kinetic_energy_{label}"] = Estimate.exact(case.kinetic_energy(time), "J")
        values |= {f"{kind}_energy_{label}": Estimate.exact(0.0, "J") for kind in ("strain", "total")}
    return values


def free_fall_of_splines() -> dict[str, Estimate]:
    """Values of the falling square as a spline cloth whose motion is integrated: the second form."""
    line = Splines(np.array([0.0, 0.4, 1.0]), 3)
    cloth = Cloth((line, line), 5000.0, 0.25, 0.0012, 0.144, (0.0, 0.0, -9.8))
    values = {}
    for moment in motion(cloth, TIMES, TOLERANCE):
        energies = cloth.energies(moment.coefficients, moment.velocity)
        height = float(cloth.position(moment.coefficients, 0.5, 0.5)[2])
        numbers = {
            "fall": -height,
            "centre_z": float(cloth.centre(moment.coefficients)[2]),
            "kinetic_energy": energies.kinetic,
            "strain_energy": energies.membrane + energies.bending,
            "total_energy": energies.total,
        }
        for name, value in numbers.items():
            unit = "J" if name.endswith("energy") else "m"
            values[f"{name}_{1000 * moment.time:.0f}ms"] = Estimate(value, INTEGRATED, unit)
    return values
