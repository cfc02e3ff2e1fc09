"""A disc of cloth that is held at its rim and sags in its own plane: cases/field_disc.toml.

The sheet stands upright and moves only downward, by f at a place (x, y) from the middle. For small slopes the strain loss
is 3 (3 f_y^2 + f_x^2)/8 in the mean over orientations, so that f obeys w_s (3 f_yy + f_xx) 3/4 = q with the weight q of
a sample: a paraboloid. Data of the case are repeated here on purpose.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from derivations.estimate import Estimate

RADIUS, STRAIN_WEIGHT, WEIGHT = 0.4, 0.005, 1e-4  # m; weights of the strain loss and of a sample
DIRECTIONS, RINGS, AROUND, DEGREE = 24, 12, 48, 5
LINEAR = 1e-5
"""Relative error of the paraboloid: about the squares of slopes, 2.7e-3. (A load upward turns the answer upside down, so
slopes themselves cancel on the level of the middle, and in means.)"""


def paraboloid() -> dict[str, Estimate]:
    """Return the figures for small slopes."""
    drop = WEIGHT * RADIUS**2 / (6 * STRAIN_WEIGHT)
    values = {"middle": -drop, "half": -0.75 * drop, "strain": 1.5 * drop**2 / RADIUS**2}
    return {name: Estimate(value, LINEAR * abs(value), "") for name, value in values.items()}


def polynomials() -> dict[str, Estimate]:
    """Return those for any slopes: the least energy of polynomials that are zero on the rim, by Newton's method."""
    found = [_values(degree) for degree in (DEGREE, DEGREE - 2)]
    return {name: Estimate(fine, abs(fine - found[1][name]) + 1e-9 * abs(fine), "") for name, fine in found[0].items()}


def _values(degree: int) -> dict[str, float]:
    nodes, weights = np.polynomial.legendre.leggauss(RINGS)
    radii, angles = (nodes + 1) / 2, 2 * math.pi * (np.arange(AROUND) + 0.5) / AROUND
    x, y = (torch.tensor(np.outer(radii, turned(angles)).ravel()) for turned in (np.cos, np.sin))
    shares = torch.tensor(np.repeat(weights * radii / AROUND, AROUND))
    powers = [(i, j) for i in range(0, degree + 1, 2) for j in range(degree + 1 - i)]  # even in x
    level = 1 - x**2 - y**2

    def power(base: torch.Tensor, i: int) -> torch.Tensor:
        return base**i if i >= 0 else torch.zeros_like(base)

    whole = torch.stack([level * x**i * y**j for i, j in powers])
    along_x = torch.stack([level * i * power(x, i - 1) * y**j - 2 * x * x**i * y**j for i, j in powers]) / RADIUS
    along_y = torch.stack([level * j * x**i * power(y, j - 1) - 2 * y * x**i * y**j for i, j in powers]) / RADIUS
    turns = math.pi * torch.arange(DIRECTIONS, dtype=torch.float64) / DIRECTIONS
    t_x, t_y = torch.cos(turns), torch.sin(turns)

    def strain(c: torch.Tensor) -> torch.Tensor:
        slope = (c @ along_x)[:, None] * t_x + (c @ along_y)[:, None] * t_y
        return 3 * ((torch.sqrt(t_x**2 + (t_y + slope) ** 2) - 1) ** 2).mean(dim=1) @ shares

    def energy(c: torch.Tensor) -> torch.Tensor:
        return STRAIN_WEIGHT * strain(c) + WEIGHT * (c @ whole) @ shares

    found = torch.zeros(len(powers), dtype=torch.float64)
    for _ in range(8):
        slope = torch.autograd.functional.jacobian(energy, found)
        found = found - torch.linalg.solve(torch.autograd.functional.hessian(energy, found), slope)
    half = sum(c * 0.75 * 0.5**i for c, (i, j) in zip(found.tolist(), powers, strict=True) if j == 0)
    middle = found[powers.index((0, 0))]
    return {"middle": float(middle), "half": float(half), "strain": float(strain(found))}
