r"""Rhombic plates, simply supported under uniform load, by two Poisson problems on graded elements: the second form.

Where w and laplace w vanish on a straight rim, B laplace^2 w = q is a pair of Poisson problems, -laplace m = q and
-B laplace w = m, both zero on the rim (Marcus 1932); the plate is convex, so that no paradox of corners arises. By symmetry a
quarter is solved for: a triangle with the centre O, the obtuse corner A and the acute corner C. The steps:

1. Places are A + s [(1 - t) (O - A) + t (C - A)], s and t in [0, 1]: the obtuse corner is s = 0. With e = C - O,
   d(t) = (O - A) + t e and J = abs(d x e), which is constant,
   int abs(grad u)^2 = 1/J int [s e.e u_s^2 - 2 d.e u_s u_t + d.d u_t^2 / s] ds dt: sums of products of one-dimensional
   integrals.
2. In s the unknowns are polynomials on intervals that shrink geometrically toward the corner, continuous; in t
   polynomials on the whole. They vanish at s = 0 and t = 1; the diagonals t = 0 and s = 1 are natural.
3. One factorisation serves both problems. At the acute corners (30 or 60 degrees) the answer is analytic.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .estimate import Estimate
from .plate import estimates_of, points_of
from .rhombic_plate import ASKED, Rhombus

SHRINK = 0.15
"""Ratio of successive intervals toward the corner."""


def _shapes(degree: int, t: np.ndarray) -> np.ndarray:
    """(2, len(t), degree + 1): hat functions and integrated Legendre polynomials on [-1, 1], and slopes."""
    out = np.zeros((2, len(t), degree + 1))
    out[:, :, 0] = (1 - t) / 2, np.full_like(t, -0.5)
    out[:, :, degree] = (1 + t) / 2, np.full_like(t, 0.5)
    legendre = np.polynomial.legendre.legvander(t, degree)
    for k in range(1, degree):
        out[0, :, k] = (legendre[:, k + 1] - legendre[:, k - 1]) / np.sqrt(4 * k + 2)
        out[1, :, k] = legendre[:, k] * np.sqrt((2 * k + 1) / 2)
    return out


@dataclass(frozen=True)
class Line:
    """Continuous piecewise polynomials between breaks."""

    breaks: np.ndarray
    degree: int

    @property
    def count(self) -> int:
        """Number of functions."""
        return (len(self.breaks) - 1) * self.degree + 1

    def at(self, x: np.ndarray) -> np.ndarray:
        """Values and slopes at points, (2, len(x), count)."""
        out = np.zeros((2, len(x), self.count))
        element = np.clip(np.searchsorted(self.breaks, x, side="right") - 1, 0, len(self.breaks) - 2)
        for e in np.unique(element):
            here = np.flatnonzero(element == e)
            left, right = self.breaks[e : e + 2]
            shapes = _shapes(self.degree, (2 * x[here] - left - right) / (right - left))
            columns = slice(e * self.degree, (e + 1) * self.degree + 1)
            out[0, here, columns] = shapes[0]
            out[1, here, columns] = shapes[1] * 2 / (right - left)
        return out

    @cached_property
    def gauss(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gauss points of all intervals, weights, and functions there."""
        t, weights = np.polynomial.legendre.leggauss(self.degree + 2)
        half, middle = np.diff(self.breaks) / 2, (self.breaks[1:] + self.breaks[:-1]) / 2
        x = (middle[:, None] + half[:, None] * t).ravel()
        return x, np.outer(half, weights).ravel(), self.at(x)

    def integral(self, factor: np.ndarray, i: int, j: int) -> np.ndarray:
        """Int factor f^(i) f^(j), (count, count), the factor given at the Gauss points."""
        _, weights, f = self.gauss
        return (f[i] * (weights * factor)[:, None]).T @ f[j]


@dataclass(frozen=True)
class Quarter:
    """The quarter's unknowns: intervals in s, degrees in s and t."""

    rhombus: Rhombus
    intervals: int
    degree: int

    @cached_property
    def lines(self) -> tuple[Line, Line]:
        """Functions of s and of t."""
        breaks = np.append(0.0, SHRINK ** np.arange(self.intervals - 1, -1.0, -1.0))
        return Line(breaks, self.degree), Line(np.array([0.0, 1.0]), self.degree + 6)

    @cached_property
    def solution(self) -> tuple[np.ndarray, float]:
        """Coefficients of w in units of q side^4 / B, zero where it is held, and its integral over the plate."""
        long, short = self.rhombus.half_diagonals
        one, two = self.lines
        s, t = one.gauss[0], two.gauss[0]
        to_centre, e = np.array([0.0, -short]), np.array([long, 0.0])
        d = to_centre + t[:, None] * e
        jacobian = long * short
        full = (
            np.kron(one.integral(s, 1, 1), two.integral(np.full_like(t, e @ e), 0, 0))
            - np.kron(one.integral(np.ones_like(s), 1, 0), two.integral(d @ e, 0, 1))
            - np.kron(one.integral(np.ones_like(s), 0, 1), two.integral(d @ e, 1, 0))
            + np.kron(one.integral(1 / s, 0, 0), two.integral((d**2).sum(axis=1), 1, 1))
        ) / jacobian
        mass = jacobian * np.kron(one.integral(s, 0, 0), two.integral(np.ones_like(t), 0, 0))
        load = jacobian * np.kron(*(line.gauss[1] * f @ line.gauss[2][0] for line, f in ((one, s), (two, 1.0))))
        held = np.zeros((one.count, two.count), bool)
        held[0] = held[:, -1] = True
        free = np.flatnonzero(~held.ravel())
        factor = cho_factor(full[np.ix_(free, free)])
        moment = cho_solve(factor, load[free])
        w = np.zeros(one.count * two.count)
        w[free] = cho_solve(factor, mass[np.ix_(free, free)] @ moment)
        return w.reshape(one.count, two.count), float(4 * load @ w)

    def deflection(self, z: np.ndarray) -> np.ndarray:
        """Deflection at places z (N,), long diagonal real, from the centre."""
        long, short = self.rhombus.half_diagonals
        x, y = np.abs(z.real), np.abs(z.imag)
        s = 1 - y / short  # e has no part along the short diagonal
        t = x / (s * long)
        one, two = self.lines
        return np.einsum("pi,ij,pj->p", one.at(s)[0], self.solution[0], two.at(t)[0])


def solve(rhombus: Rhombus, intervals: int, degree: int, points: np.ndarray) -> tuple[np.ndarray, float]:
    """Deflections at oblique coordinates (N, 2), m, and strain energy, J."""
    quarter = Quarter(rhombus, intervals, degree)
    energy = rhombus.pressure * quarter.solution[1] * rhombus.unit * rhombus.side**2 / 2
    return quarter.deflection(rhombus.places(points)) * rhombus.unit, energy


FINE, COARSE = (12, 10), (8, 8)
"""Intervals in s and degree."""
ROUNDING = 1e-10
"""Relative rounding of the solved coefficients."""


def by_elements(angle: float) -> dict[str, Estimate]:
    """Values of the plate of an angle, degrees; the uncertainty is the change from fewer intervals and lower degrees."""
    fine, coarse = (solve(Rhombus(angle), *level, points_of(ASKED)) for level in (FINE, COARSE))
    return estimates_of(ASKED, fine, coarse, ROUNDING)
