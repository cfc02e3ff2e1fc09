r"""One harmonic of a cylinder: a boundary value problem on a line, solved by a Legendre-Ritz method.

Minimise 1/2 int (S q) . C (S q) ds - l(q) over q = (U, V, W) on an interval, where
S q = S[0] q + S[1] q' + S[2] q'' (see `cylinder`). U and V need one derivative, W two. The trial
functions are those of the hp finite element of one cell: two linear end functions and integrated
Legendre polynomials for U and V, four Hermite cubics and twice integrated ones for W. All but
the end functions vanish at the ends (with their slopes for W), so that essential conditions are met
by leaving out coefficients; everything else is a natural condition of the energy and needs no
formula. The solution is analytic inside the interval: convergence is exponential in the degree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

END_COEFFICIENTS = {
    "U(left)": ("U", 0),
    "U(right)": ("U", 1),
    "V(left)": ("V", 0),
    "V(right)": ("V", 1),
    "W(left)": ("W", 0),
    "W'(left)": ("W", 1),
    "W(right)": ("W", 2),
    "W'(right)": ("W", 3),
}


def _h1_basis(t: np.ndarray, degree: int) -> np.ndarray:
    """(3, len(t), degree + 1): values, first and second derivatives (unused: zero) on [-1, 1]."""
    legendre = np.polynomial.legendre.legvander(t, degree)
    k = np.arange(1, degree)
    scale = np.sqrt((2 * k + 1) / 2.0)
    out = np.zeros((3, len(t), degree + 1))
    out[0, :, 0], out[0, :, 1] = (1 - t) / 2, (1 + t) / 2
    out[1, :, 0], out[1, :, 1] = -0.5, 0.5
    out[0, :, 2:] = scale * (legendre[:, k + 1] - legendre[:, k - 1]) / (2 * k + 1)
    out[1, :, 2:] = scale * legendre[:, k]
    return out


def _h2_basis(t: np.ndarray, degree: int, half_length: float) -> np.ndarray:
    """(3, len(t), degree + 1): values and two derivatives on [-1, 1]; end slopes are per unit s."""
    legendre = np.polynomial.legendre.legvander(t, degree)
    k = np.arange(2, degree - 1)
    scale = np.sqrt((2 * k + 1) / 2.0)
    out = np.zeros((3, len(t), degree + 1))
    ones = np.ones_like(t)
    for j, (side, slope) in enumerate([(-1, False), (-1, True), (1, False), (1, True)]):
        if slope:
            cubic = (t**3 + side * t**2 - t - side) / 4, (3 * t**2 + 2 * side * t - 1) / 4
            cubic = *cubic, (3 * t + side) / 2
        else:
            cubic = (2 + 3 * side * t - side * t**3) / 4, 3 * side * (1 - t**2) / 4
            cubic = *cubic, -1.5 * side * t
        for order in range(3):
            out[order, :, j] = cubic[order] * ones * (half_length if slope else 1.0)
    integral = (legendre[:, k + 1] - legendre[:, k - 1]) / (2 * k + 1)
    upper = (legendre[:, k + 2] - legendre[:, k]) / (2 * k + 3)
    lower = (legendre[:, k] - legendre[:, k - 2]) / (2 * k - 1)
    out[0, :, 4:] = scale * (upper - lower) / (2 * k + 1)
    out[1, :, 4:] = scale * integral
    out[2, :, 4:] = scale * legendre[:, k]
    return out


@dataclass(frozen=True)
class Strip:
    """Trial functions of q = (U, V, W) on [left, right], and quadrature that is exact for them."""

    left: float
    right: float
    degree: int

    @property
    def half_length(self) -> float:
        """Half the interval's length."""
        return (self.right - self.left) / 2

    def basis(self, s: np.ndarray) -> np.ndarray:
        """Trial functions (derivative 0..2, point, component 0..2, coefficient) at points s (N,)."""
        half, size = self.half_length, self.degree + 1
        t = (np.asarray(s, float) - (self.left + self.right) / 2) / half
        out = np.zeros((3, len(t), 3, 3 * size))
        out[:, :, 0, :size] = out[:, :, 1, size : 2 * size] = _h1_basis(t, self.degree)
        out[:, :, 2, 2 * size :] = _h2_basis(t, self.degree, half)
        return out / (half ** np.arange(3))[:, None, None, None]

    @cached_property
    def quadrature(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gauss points s, weights and `basis(s)`: exact for the product of two trial functions."""
        t, weights = np.polynomial.legendre.leggauss(self.degree + 1)
        s = (self.left + self.right) / 2 + self.half_length * t
        return s, self.half_length * weights, self.basis(s)

    def end_coefficient(self, name: str) -> int:
        """Position of an end value such as "W(left)" among the coefficients."""
        component, position = END_COEFFICIENTS[name]
        return "UVW".index(component) * (self.degree + 1) + position

    def stiffnesses(self, strains: np.ndarray, elasticities: tuple[np.ndarray, ...]) -> list[np.ndarray]:
        """Int (S phi_i) . C (S phi_j) ds for S (3, 6, 3) and each C (6, 6)."""
        _, weights, basis = self.quadrature
        strain = np.tensordot(strains, basis, axes=([0, 2], [0, 2]))
        size = strain.shape[-1]
        return [
            strain.reshape(-1, size).T @ (weights[:, None] * np.tensordot(c, strain, axes=1)).reshape(-1, size)
            for c in elasticities
        ]

    def distributed_load(self, density: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Int density(s) . phi_i ds for a density that maps (N,) to (N, 3)."""
        s, weights, basis = self.quadrature
        return np.einsum("p,pc,pcj->j", weights, density(s), basis[0], optimize=True)

    def minimise(self, stiffness: np.ndarray, load: np.ndarray, held: tuple[str, ...]) -> np.ndarray:
        """Coefficients of the minimiser, the named end values held at zero."""
        free = np.setdiff1d(np.arange(len(load)), [self.end_coefficient(name) for name in held])
        # Symmetric scaling to a unit diagonal: the three components differ by (R/h)^2 in stiffness.
        scale = 1.0 / np.sqrt(np.diag(stiffness)[free])
        matrix = scale[:, None] * stiffness[np.ix_(free, free)] * scale
        factor = cho_factor(matrix)
        right_side = scale * load[free]
        solution = cho_solve(factor, right_side)
        solution += cho_solve(factor, right_side - matrix @ solution)
        out = np.zeros_like(load)
        out[free] = scale * solution
        return out
