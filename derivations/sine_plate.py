r"""Simply supported square plate under a pressure of one half wave each way: closed form, and Ritz with polynomials.

With q = q0 sin(pi x / L) sin(pi y / L) the deflection of a Kirchhoff plate is q0 L^4 / (4 pi^4 B) times the same sines, as
each derivative of second order gives -(pi / L)^2. Its largest value, .00256649 q0 L^4 / B, is what Guo, Zhuang & Rabczuk
(2021) print as 2.56649. The strain energy is half the work of the load, q0 L^2 w0 / 8.

Ritz: w is a sum of products of (1 - s^2) P_i(s), i even, on [-1, 1]. The energy

    B / 2 int (w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2)

also has the twist, whose part with nu vanishes for exact supports only.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre

from .estimate import ROUNDING, Estimate

SIDE, THICKNESS, YOUNG, POISSON, PRESSURE = 1.0, 0.01, 1.092e7, 0.3, 1.0  # m, m, Pa, 1, Pa: B = 1 N m
STIFFNESS = YOUNG * THICKNESS**3 / (12 * (1 - POISSON**2))
OBLIQUE = (0.2, 0.35), np.array([1.0, 2.0, -2.0]) / 3  # a point, m, and a direction
FUNCTIONS = 9, 7  # a direction, fine and coarse


def _values(centre: float, oblique: float, energy: float) -> dict[str, float]:
    return {
        "centre_deflection": centre,
        "oblique_displacement": oblique,
        "largest_displacement": centre,
        "strain_energy": energy,
        "bending_energy": energy,
    }


def _estimates(fine: dict[str, float], coarse: dict[str, float]) -> dict[str, Estimate]:
    return {
        name: Estimate.between(value, coarse[name], "J" if name.endswith("energy") else "m", ROUNDING * abs(value))
        for name, value in fine.items()
    } | {"membrane_energy": Estimate(0.0, 0.0, "J")}


def sine_plate() -> dict[str, Estimate]:
    """Known values in closed form."""
    centre = PRESSURE * SIDE**4 / (4 * np.pi**4 * STIFFNESS)
    (x, y), direction = OBLIQUE
    oblique = -direction[2] * centre * np.sin(np.pi * x / SIDE) * np.sin(np.pi * y / SIDE)
    closed = _values(float(centre), float(oblique), float(PRESSURE * SIDE**2 * centre / 8))
    return _estimates(closed, closed)


def _by_polynomials(count: int) -> dict[str, float]:
    half = SIDE / 2
    even = [legendre.legmul([2 / 3, 0, -2 / 3], np.eye(2 * k + 1)[-1]) for k in range(count)]  # (1 - s^2) P_2k
    s, weights = legendre.leggauss(2 * count + 12)

    def table(at: np.ndarray, order: int) -> np.ndarray:
        return np.stack([legendre.legval(at, legendre.legder(of, order)) for of in even], -1) / half**order

    f = [table(s, order) for order in range(3)]
    one = [[f[i].T @ (weights[:, None] * half * f[j]) for j in range(3)] for i in range(3)]
    matrix = STIFFNESS * (
        np.kron(one[2][2], one[0][0]) + np.kron(one[0][0], one[2][2])
        + POISSON * (np.kron(one[2][0], one[0][2]) + np.kron(one[0][2], one[2][0]))
        + 2 * (1 - POISSON) * np.kron(one[1][1], one[1][1])
    )  # fmt: skip
    along = f[0].T @ (weights * half * np.cos(np.pi * s / 2))
    force = PRESSURE * np.kron(along, along)
    scale = 1 / np.sqrt(np.diag(matrix))
    answer = scale * np.linalg.solve(matrix * np.outer(scale, scale), scale * force)

    def deflection(x: float, y: float) -> float:
        return float(np.kron(*(table(np.array([at / half - 1]), 0)[0] for at in (x, y))) @ answer)

    place, direction = OBLIQUE
    energy = float(answer @ force) / 2
    return _values(deflection(half, half), -float(direction[2]) * deflection(*place), energy)


def sine_plate_by_polynomials() -> dict[str, Estimate]:
    """The same by the Ritz method; the uncertainty is the change from fewer functions."""
    return _estimates(*(_by_polynomials(count) for count in FUNCTIONS))
