r"""Functions around and along a sleeve: harmonics of theta, and polynomials of y that respect the clamped rims.

Legendre combinations with clamped or held ends: J. Shen, SIAM J. Sci. Comput. 15 (1994) 1489, secs. 2 and 3. Their
highest derivatives are orthogonal, which keeps stiffness matrices of a hundred of them well conditioned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from .surface_strains import Array

Matrix = NDArray[Any]
"""Real or complex."""


@dataclass(frozen=True)
class Around:
    """Functions of theta: derivatives of orders 0, 1, 2 at the quadrature points, (3, points, functions)."""

    values: Matrix

    @classmethod
    def real(cls, angles: Array, fold: int, harmonics: int) -> Around:
        """1, cos, sin, ... of fold theta, 2 fold theta, ..."""
        columns = [np.stack([np.ones_like(angles), 0 * angles, 0 * angles])]
        for k in fold * np.arange(1, harmonics + 1):
            c, s = np.cos(k * angles), np.sin(k * angles)
            columns += [np.stack([c, -k * s, -k * k * c]), np.stack([s, k * c, -k * k * s])]
        return cls(np.stack(columns, -1))

    @classmethod
    def waves(cls, angles: Array, numbers: Array) -> Around:
        """exp(i m theta) for the given wave numbers m."""
        wave = np.exp(1j * np.outer(angles, numbers))
        return cls(np.stack([wave, 1j * numbers * wave, -(numbers**2) * wave]))


def along(count: int, clamped: bool, s: Array) -> Array:
    """Polynomials of -1 <= s <= 1 that vanish at the ends, and their slopes too if clamped: (3, points, count).

    Orders 0, 1, 2; the function of number k is even or odd with k, and its highest derivatives are of order one.
    """
    k = np.arange(count)
    coefficients = np.zeros((count + 4, count))
    if clamped:
        scale = 1 / np.sqrt(2 * (2 * k + 3) ** 2 * (2 * k + 5))
        coefficients[k, k] = scale
        coefficients[k + 2, k] = -scale * 2 * (2 * k + 5) / (2 * k + 7)
        coefficients[k + 4, k] = scale * (2 * k + 3) / (2 * k + 7)
    else:
        scale = 1 / np.sqrt(4 * k + 6)
        coefficients[k, k] = scale
        coefficients[k + 2, k] = -scale
    return np.stack([legendre.legval(s, legendre.legder(coefficients, order)).T for order in range(3)])
