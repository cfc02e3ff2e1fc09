r"""A free plate under constant forces: cases/pushed_plate.toml. All forces are alike everywhere, and so is the acceleration.

With f = (4, -2, 1) + 3 (0, 0, 1) N/m^2 and the density rho of the plate, u = f t^2 / (2 rho) at each point, nothing is
strained, and the kinetic energy A |f|^2 t^2 / (2 rho) is the work A f . u.

The second form integrates Newton's law of the plate as one body, under the resultant of the loads that the case declares.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from shellbench.problems.shell.case import read_case
from shellbench.problems.shell.question.loads import AreaLoad, PressureLoad

from .estimate import Estimate
from .manufactured import CASES

FORCE = np.array([4.0, -2.0, 4.0])
DENSITY, AREA, CENTRE_Y = 2.5, 2 * 0.8 * 0.5, 0.2
ASKEW = np.array([2.0, -1.0, 2.0]) / 3
TOLERANCE, INTEGRATED = 1e-11, 1e-10
"""Of the Runge-Kutta method, which is exact for this motion but for rounding, and what rounding leaves, relative."""


def pushed_plate() -> dict[str, Estimate]:
    """Known values in closed form."""

    def flight(t: float) -> Estimate:
        return Estimate.exact(float(ASKEW @ FORCE) * t**2 / (2 * DENSITY), "m")

    def kinetic(t: float) -> Estimate:
        return Estimate.exact(AREA * float(FORCE @ FORCE) * t**2 / (2 * DENSITY), "J")

    return {
        "flight_100ms": flight(0.1),
        "kinetic_energy_100ms": kinetic(0.1),
        "flight_200ms": flight(0.2),
        "centre_y_200ms": Estimate.exact(CENTRE_Y + FORCE[1] * 0.2**2 / (2 * DENSITY), "m"),
        "kinetic_energy_200ms": kinetic(0.2),
        "strain_energy_200ms": Estimate.exact(0.0, "J"),
        "total_energy_200ms": Estimate.exact(0.0, "J"),
        "energy_balance_200ms": Estimate.exact(0.0, "J"),
    }


def pushed_plate_by_newton() -> dict[str, Estimate]:
    """Known values by Newton's law of one body."""
    case = read_case(CASES / "pushed_plate.toml")
    # 1. The resultant. The plate is a parallelogram: its edges span it.
    corners = case.surface.position(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.5]]))
    along, up = corners[1] - corners[0], corners[2] - corners[0]
    spanned = np.cross(along, up)
    area = float(np.linalg.norm(spanned))
    normal, first = spanned / area, along / np.linalg.norm(along)
    frame = np.stack([first, np.cross(normal, first), normal])
    force, middle = np.zeros(3), np.array([[0.5, 0.25]])
    for load in case.loads:
        if isinstance(load, AreaLoad):
            force += area * case.evaluate(load.vector, middle)[0, 0][0] @ frame
        elif isinstance(load, PressureLoad):
            force += area * case.formula(load.value).derivatives(middle, 0)[0, 0] * normal
    # 2. Newton's law, and the work of the resultant.
    density = case.material.areal_density
    assert density is not None
    mass = density * area

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:6], force / mass, [force @ y[3:6]]])

    found = solve_ivp(rates, (0.0, 0.2), np.zeros(7), method="DOP853", rtol=TOLERANCE, atol=1e-14, t_eval=[0.1, 0.2])
    (early, late) = found.y.T
    centre = float((corners[0] + (along + up) / 2)[1])
    energies = [mass * float(y[3:6] @ y[3:6]) / 2 for y in (early, late)]
    lost = [energy - float(y[6]) for energy, y in zip(energies, (early, late), strict=True)]
    values = {
        "flight_100ms": (float(ASKEW @ early[:3]), "m"),
        "kinetic_energy_100ms": (energies[0], "J"),
        "flight_200ms": (float(ASKEW @ late[:3]), "m"),
        "centre_y_200ms": (centre + float(late[1]), "m"),
        "kinetic_energy_200ms": (energies[1], "J"),
        "strain_energy_200ms": (0.0, "J"),
        "total_energy_200ms": (lost[1], "J"),
        "energy_balance_200ms": (max(map(abs, lost)), "J"),
    }
    return {name: Estimate(value, INTEGRATED * max(abs(value), 0.1), unit) for name, (value, unit) in values.items()}
