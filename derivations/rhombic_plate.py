r"""Rhombic plates, simply supported under uniform load: particular solutions of their corners, fitted on one side.

Only w is held on the straight rim, so that the bending moment across it vanishes: there w = 0 and laplace w = 0, and the
answer does not depend on Poisson's ratio but for B. At a corner of angle omega it goes like r^(pi/omega): 6/5 at 150
degrees, where moments are infinite and meshes converge slowly (Morley 1963). The steps:

1. w = q r^4 / (64 B) plus functions r^lambda sin(lambda theta) and r^(lambda + 2) sin(lambda theta) about each corner,
   lambda = k pi / omega, which meet both conditions on its two sides, and harmonic polynomials H and r^2 H about the
   centre. All is even about both diagonals: k is odd, opposite corners share their coefficients.
2. Least squares on one side, for w and laplace w, at points that cluster toward both ends.
3. The energy is half the work of the load, by Gauss points on a quarter, graded toward its obtuse corner.

Below, lengths are in units of the side and w in units of q side^4 / B.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .estimate import Estimate
from .plate import OBLIQUE, Mean, estimates_of, points_of

ROUNDING = 1e-10
"""Relative rounding of the fit."""


@dataclass(frozen=True)
class Rhombus:
    """A rhombic plate: its acute angle in degrees, side and thickness in m, Young's modulus and pressure in Pa."""

    angle: float
    side: float = 100.0
    thickness: float = 1.0
    young: float = 1e7
    poisson: float = 0.3
    pressure: float = 1.0

    @property
    def unit(self) -> float:
        """Unit of the deflection, q side^4 / B, m."""
        stiffness = self.young * self.thickness**3 / (12.0 * (1.0 - self.poisson**2))
        return self.pressure * self.side**4 / stiffness

    @property
    def half_diagonals(self) -> tuple[float, float]:
        """Distances of the acute and of the obtuse corners from the centre, in units of the side."""
        return float(np.cos(np.radians(self.angle / 2))), float(np.sin(np.radians(self.angle / 2)))

    def places(self, points: np.ndarray) -> np.ndarray:
        """Complex places in units of the side, long diagonal real, of oblique coordinates (N, 2), m; from the centre."""
        half = np.radians(self.angle / 2)
        first, second = (points / self.side - 0.5).T
        return first * np.exp(-1j * half) + second * np.exp(1j * half)


@dataclass(frozen=True)
class Fit:
    """Coefficients of the trial functions of a rhombus: so many powers at each corner, and at the centre."""

    rhombus: Rhombus
    corner_powers: int
    centre_powers: int

    def functions(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Trial functions at places z (N,) and their Laplacians, (N, J)."""
        values, laplacians = [], []
        long, short = self.rhombus.half_diagonals
        acute = np.radians(self.rhombus.angle)
        for corner, omega in ((long, acute), (1j * short, np.pi - acute)):
            toward = -corner / abs(corner)
            for k in range(1, 2 * self.corner_powers, 2):
                power = k * np.pi / omega
                sign = (-1) ** (k // 2)
                harmonic = value = 0.0
                for end, axis in ((corner, toward), (-corner, -toward)):
                    d = (z - end) / axis  # seen from the corner: the bisector is real
                    r, theta = np.abs(d), np.angle(d)
                    h = sign * r**power * np.cos(power * theta)  # sin(lambda theta) from a side
                    harmonic = harmonic + h
                    value = value + r**2 * h
                values += [harmonic, value]
                laplacians += [0 * harmonic, 4 * (power + 1) * harmonic]
        for k in range(0, 2 * self.centre_powers, 2):
            h = (z**k).real
            values += [h, np.abs(z) ** 2 * h]
            laplacians += [0 * h, 4 * (k + 1) * h]
        return np.array(values).T, np.array(laplacians).T

    @cached_property
    def coefficients(self) -> np.ndarray:
        """The (J,) coefficients."""
        long, short = self.rhombus.half_diagonals
        # Distances from both ends of the side down to 1e-10, equally many a decade.
        near = np.logspace(-10, np.log10(0.5), 60 * self.corner_powers // 8 + 60)
        z = np.concatenate([long + near * (1j * short - long), 1j * short + near * (long - 1j * short)])
        values, laplacians = self.functions(z)
        rows = np.vstack([values, laplacians])
        right = -np.concatenate([np.abs(z) ** 4 / 64, np.abs(z) ** 2 / 4])
        size = np.linalg.norm(rows, axis=0)
        return np.linalg.lstsq(rows / size, right, rcond=1e-15)[0] / size

    def deflection(self, z: np.ndarray) -> np.ndarray:
        """Deflection at places z (N,)."""
        return np.abs(z) ** 4 / 64 + self.functions(z)[0] @ self.coefficients

    def mean(self) -> float:
        """Integral of the deflection over the plate."""
        long, short = self.rhombus.half_diagonals
        t, weights = np.polynomial.legendre.leggauss(40)
        t, weights = (1 + t) / 2, weights / 2
        s = t**5  # distance from the obtuse corner: what goes as r^1.2 is smooth in t
        z = 1j * short + s[:, None] * ((1 - t) * -1j * short + t * (long - 1j * short))
        area = np.outer(weights * 5 * t**4 * s, weights) * long * short
        return float(4 * np.sum(area.ravel() * self.deflection(z.ravel())))


def solve(rhombus: Rhombus, corner_powers: int, points: np.ndarray) -> tuple[np.ndarray, float]:
    """Deflections at oblique coordinates (N, 2), m, and strain energy, J."""
    fit = Fit(rhombus, corner_powers, corner_powers)
    energy = rhombus.pressure * fit.mean() * rhombus.unit * rhombus.side**2 / 2
    return fit.deflection(rhombus.places(points)) * rhombus.unit, energy


ASKED = {
    "centre_deflection": Mean(((50.0, 50.0),)),
    "off_centre_deflection": Mean(((30.0, 60.0),)),
    "mean_oblique": Mean(((30.0, 60.0), (80.0, 35.0), (40.0, 15.0)), OBLIQUE),
}


def by_corners(angle: float, powers: int = 12) -> dict[str, Estimate]:
    """Values of the plate of an angle, degrees; the uncertainty is the change from 2/3 of the powers."""
    fine, coarse = (solve(Rhombus(angle), count, points_of(ASKED)) for count in (powers, 2 * powers // 3))
    return estimates_of(ASKED, fine, coarse, ROUNDING)
