r"""A held strip under a pressure that begins at once: a sum over modes in closed form, and by polynomials.

Without Poisson's effect the strip is a beam, whose odd modes m move the middle by

    w = sum_m 4 p / (m pi rho omega_m^2) sin(m pi / 2) (1 - cos omega_m t),  omega_m = (m pi / L)^2 sqrt(B / rho).

The case asks for large displacements. As its ends are held the strip stretches, which stiffens it by a fraction of
order (w / h)^2, here below 2e-7: `STIFFENING`.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from .estimate import Estimate
from .plate_modes import _line

LENGTH, BENDING, DENSITY, PRESSURE = 1.0, 0.1, 1.0, 1e-5
TIMES = (0.5, 1.0)
MODES = 20_000
FUNCTIONS = 40, 32
STIFFENING = 2e-7


def named(time: float) -> str:
    """Name of a quantity of cases/vibrating_strip.toml."""
    return f"deflection_{1000 * time:.0f}ms"


def vibrating_strip() -> dict[str, Estimate]:
    """Known values by the closed form."""
    m = np.arange(1, MODES, 2)
    squares = (m * np.pi / LENGTH) ** 4 * BENDING / DENSITY
    sizes = 4 * PRESSURE / (m * np.pi * DENSITY * squares) * np.sin(m * np.pi / 2)
    moved = {time: float(sizes @ (1 - np.cos(np.sqrt(squares) * time))) for time in TIMES}
    return {named(time): Estimate(value, STIFFENING * value, "m") for time, value in moved.items()}


def vibrating_strip_by_polynomials() -> dict[str, Estimate]:
    """The same in polynomials that are zero at both ends, of which modes are found."""
    fine, coarse = (_by_polynomials(count) for count in FUNCTIONS)
    return {named(t): Estimate.between(fine[t], coarse[t], "m", 1e-7 * fine[t]) for t in TIMES}


def _by_polynomials(count: int) -> dict[float, float]:
    x, weights = np.polynomial.legendre.leggauss(2 * count + 1)  # one of them is the middle
    table = _line(count, 1, x, weights) * (2 / LENGTH) ** np.arange(3)[:, None, None]
    weights = weights * LENGTH / 2
    stiffness, mass, load = (
        np.einsum("qi,q,qj->ij", table[2], weights, table[2]) * BENDING,
        np.einsum("qi,q,qj->ij", table[0], weights, table[0]) * DENSITY,
        PRESSURE * (weights @ table[0]),
    )
    squares, shapes = eigh(stiffness, mass)
    sizes = (table[0, count] @ shapes) * (load @ shapes) / squares
    return {time: float(sizes @ (1 - np.cos(np.sqrt(squares) * time))) for time in TIMES}
