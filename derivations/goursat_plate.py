r"""Clamped plates by Goursat's functions: the second form of `clamped_plate`.

Every biharmonic function is Re(conj(z) f(z) + g(z)) with f and g analytic (Goursat 1898). The deflection is a particular
solution, q r^4 / (64 B) or P r^2 log(r) / (8 pi B), and such a function. f and g are polynomials and simple poles that
cluster exponentially toward the corners, where the deflection is not analytic (Brubeck & Trefethen 2022). Least squares on
the rim, w = w_n = 0, give the coefficients: no energy is minimised, and nothing inside the plate is sampled.

Powers of z are made orthogonal on the rim as they are built (Arnoldi), and functions and derivatives are recombined alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .estimate import Estimate
from .plate import LoadedPlate, Point, Uniform

ROUNDING = 1e-11
"""Relative rounding of the fitted deflection."""
CLUSTERING = 4.0
"""Distances of the poles from their corner are exp(-CLUSTERING (sqrt(K) - sqrt(k))), k = 1..K, in units of the plate."""


@dataclass(frozen=True)
class Goursat:
    """Trial functions of a plate centred at 0 with half sides below 1, and the recurrence of its polynomials.

    Attributes
    ----------
    half_sides : of the plate, in units of the half diagonal
    degree : of the polynomials
    poles : how many at each corner
    """

    half_sides: tuple[float, float]
    degree: int
    poles: int

    @cached_property
    def corners(self) -> np.ndarray:
        """The four corners, (4,) complex."""
        a, b = self.half_sides
        return np.array([complex(p * a, q * b) for p in (-1, 1) for q in (-1, 1)])

    @cached_property
    def rim(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (N,) that cluster toward the corners as the poles do, and unit normals."""
        t = np.tanh(np.linspace(-14.0, 14.0, 12 * self.poles + 4 * self.degree))
        a, b = self.half_sides
        sides = [(t * a + 1j * side * b, 1j * side) for side in (-1, 1)]
        sides += [(side * a + 1j * t * b, side) for side in (-1, 1)]
        return np.concatenate([z for z, _ in sides]), np.repeat([n for _, n in sides], len(t))

    @cached_property
    def _recurrence(self) -> np.ndarray:
        """Hessenberg matrix of z times the orthonormal polynomials on the rim."""
        z, _ = self.rim
        q = np.zeros((len(z), self.degree + 1), complex)
        h = np.zeros((self.degree + 1, self.degree), complex)
        q[:, 0] = 1.0
        for k in range(self.degree):
            v = z * q[:, k]
            for j in range(k + 1):
                h[j, k] = np.vdot(q[:, j], v) / len(z)
                v = v - h[j, k] * q[:, j]
            h[k + 1, k] = np.linalg.norm(v) / np.sqrt(len(z))
            q[:, k + 1] = v / h[k + 1, k]
        return h

    def functions(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Polynomials and poles at z, (N, F), and their first and second derivatives."""
        h = self._recurrence
        value, slope, second = (np.zeros((len(z), self.degree + 1), complex) for _ in range(3))
        value[:, 0] = 1.0
        for k in range(self.degree):
            done = slice(0, k + 1)
            value[:, k + 1] = (z * value[:, k] - value[:, done] @ h[done, k]) / h[k + 1, k]
            slope[:, k + 1] = (z * slope[:, k] + value[:, k] - slope[:, done] @ h[done, k]) / h[k + 1, k]
            second[:, k + 1] = (z * second[:, k] + 2 * slope[:, k] - second[:, done] @ h[done, k]) / h[k + 1, k]
        k = np.arange(1, self.poles + 1)
        distance = np.exp(-CLUSTERING * (np.sqrt(self.poles) - np.sqrt(k)))
        outward = self.corners / np.abs(self.corners)
        place = (self.corners[:, None] + outward[:, None] * distance).ravel()
        size = np.tile(distance, len(self.corners))
        inverse = 1 / (z[:, None] - place)
        poles = size * inverse, -size * inverse**2, 2 * size * inverse**3
        value, slope, second = (np.hstack(pair) for pair in zip((value, slope, second), poles, strict=True))
        return value, slope, second

    def biharmonic(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Real trial functions (N, J) and their gradients, complex w_x + i w_y (N, J)."""
        f, slope, _ = self.functions(z)
        bar = np.conj(z)[:, None]
        values, gradients = [], []
        for unit in (1.0, 1j):
            values += [(bar * unit * f).real, (unit * f).real]
            # d/dx and d/dy of Re(conj(z) f) and Re f.
            gradients.append(unit * f + np.conj(bar * unit * slope))
            gradients.append(np.conj(unit * slope))
        return np.hstack(values), np.hstack(gradients)


def particular(case: LoadedPlate, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Particular deflection (N,), m, at points (N, 2), m, and its gradient as complex numbers."""
    b = case.plate.bending_stiffness
    if isinstance(case.load, Point):
        d = points @ np.array([1, 1j]) - complex(*case.load.place)
        square = np.abs(d) ** 2
        log = np.log(np.where(square > 0, square, 1.0))
        factor = case.load.force / (16 * np.pi * b)
        return factor * square * log, factor * 2 * d * (log + 1)
    d = points @ np.array([1, 1j]) - complex(case.plate.a, case.plate.b) / 2
    factor = case.load.pressure / (64 * b)
    return factor * np.abs(d) ** 4, factor * 4 * np.abs(d) ** 2 * d


def solve_goursat(case: LoadedPlate, degree: int, poles: int) -> tuple[Goursat, np.ndarray, float]:
    """The trial functions, their coefficients, and the length, m, that is 1 in their coordinates."""
    a, b = case.plate.a, case.plate.b
    unit = np.hypot(a, b) / 2
    trial = Goursat((a / 2 / unit, b / 2 / unit), degree, poles)
    centre = complex(a, b) / 2
    z, normal = trial.rim
    place = z * unit + centre
    w, gradient = particular(case, np.column_stack([place.real, place.imag]))
    value, slope = trial.biharmonic(z)
    rows = np.vstack([value, (np.conj(normal)[:, None] * slope).real])
    right = -np.concatenate([w, unit * (np.conj(normal) * gradient).real])
    size = np.linalg.norm(rows, axis=0)
    size[size == 0.0] = 1.0  # the imaginary constant of g
    return trial, np.linalg.lstsq(rows / size, right, rcond=1e-15)[0] / size, unit


def goursat(case: LoadedPlate, degree: int, poles: int) -> tuple[np.ndarray, float]:
    """Deflections at the plate's points, m, and strain energy, J."""
    trial, coefficients, unit = solve_goursat(case, degree, poles)
    a, b = case.plate.a, case.plate.b
    centre = complex(a, b) / 2

    def deflection(points: np.ndarray) -> np.ndarray:
        inside = (points @ np.array([1, 1j]) - centre) / unit
        return particular(case, points)[0] + trial.biharmonic(inside)[0] @ coefficients

    if isinstance(case.load, Uniform):
        t, weights = np.polynomial.legendre.leggauss(48)
        grid = np.stack(np.meshgrid((1 + t) * a / 2, (1 + t) * b / 2, indexing="ij"), axis=-1).reshape(-1, 2)
        work = case.load.pressure * np.outer(weights, weights).ravel() @ deflection(grid) * a * b / 4
    else:
        work = case.load.force * deflection(np.array([case.load.place]))[0]
    return deflection(case.points), float(work / 2)


def by_goursat(case: LoadedPlate, degree: int = 30, poles: int = 16) -> dict[str, Estimate]:
    """Values by Goursat's functions; the uncertainty is the change from 2/3 of the degree and the poles."""
    return case.estimates(goursat(case, degree, poles), goursat(case, 2 * degree // 3, 2 * poles // 3), ROUNDING)
