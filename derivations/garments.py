r"""Known values of garments in the wind: Newton's law on a spline patch (flag), and on Fourier terms times splines (skirt).

Both are as soft as the paper's cloth; the wind is a force per reference area, .5 sin(2 t + 1) d, so that it acts on the
mass as a gravity would that changes in time.

- flag: two elastic pins at the ends of one side, `spline_motion` with both; bending ten thousand times stiffer: with a
  hundred it wrinkled beside the pins as finely as a mesh allows, and no energies converged from .1 s on.
- skirt: a cone whose upper rim is held. Of a surface of revolution r(xi2) with the metric a = diag(r^2, 1 + r'^2) mass
  is a product of the two directions as well, and so is all of `spline_motion` but the metric and the reference
  curvature, b_11 = r / sqrt(1 + r'^2). Around, the functions are cos(m xi1) and sin(m xi1).

A value is that of the finer of two discretisations, its uncertainty their distance as in `over_time`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .estimate import Estimate
from .explicit_motion import motion
from .motion import quantities
from .over_time import between
from .spline_motion import Cloth, Pin, _cross, _dot, _sum
from .spline_shell import Splines
from .surface_strains import Array

YOUNG, POISSON, THICKNESS, DENSITY = 5000.0, 0.25, 0.0012, 0.144
GRAVITY = (0.0, -9.8, 0.0)
FLAG_SIDES, FLAG_WIND = (1.0, 0.7), (0.3, -0.2, 0.15)  # m, N/m^2
STIFFNESS, WIDTH, BENDING = 5e3, 0.1, 1e4  # of the pins, N/m^3 and m; factor of the flag's bending stiffness
TIMES = (0.1, 0.2, 0.3)
TOLERANCE = 1e-6  # of the Runge-Kutta method
ROUNDING = 1e-6
"""Error left by time steps and rounding, m and J."""
LOWER, UPPER, LENGTH, SKIRT_WIND = 0.4, 0.2, 0.6, (-0.35, 0.3, 0.0)  # m, N/m^2


@dataclass(frozen=True)
class Blown(Cloth):
    """A cloth in a uniform wind.

    Attributes
    ----------
    wind : force per reference area where the sine of 2 t + 1 is one, N/m^2
    """

    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def acceleration(self, time: float, coefficients: Array) -> tuple[Array, Array]:
        """Second time derivative of the coefficients, and the reactions of the held ones (components, held)."""
        one, two = self._inverses
        blown = np.sin(2 * time + 1) * np.multiply.outer(np.array(self.wind), self._integrals)
        free = one @ (self.forces(coefficients) + blown) @ two / self.density
        if not self.held:
            return free, np.zeros((3, 0))
        (rows, columns), of_inverse, small = self._holding
        reaction = -free[:, rows, columns] @ small
        return free + np.einsum("ijk,ck->cij", of_inverse, reaction), reaction


@dataclass(frozen=True)
class Flag(Blown):
    """A flag between two elastic pins."""

    other_pin: Pin | None = None

    @cached_property
    def _other(self) -> Cloth:
        return Cloth(self.splines, YOUNG, POISSON, THICKNESS, DENSITY, GRAVITY, pin=self.other_pin)

    def forces(self, coefficients: Array) -> Array:
        """Force on every coefficient, of strain, both pins and gravity."""
        factors = self._other._pin
        assert factors is not None
        return super().forces(coefficients) - factors[0] @ coefficients @ factors[1]


@dataclass(frozen=True)
class Fourier:
    """cos(m xi1) and sin(m xi1) up to a number of waves, 1 first: what `Splines` tells, for functions that close."""

    waves: int

    @property
    def count(self) -> int:
        """Number of functions."""
        return 2 * self.waves + 1

    @property
    def degree(self) -> int:
        """One less than the functions of the only span."""
        return self.count - 1

    @cached_property
    def gauss(self) -> tuple[Array, Array]:
        """Points and weights of the trapezoidal rule, (1, points): three for each wave's two."""
        n = 6 * self.waves
        return 2 * np.pi * np.arange(n)[None] / n, np.full((1, n), 2 * np.pi / n)

    def matrix(self, points: Array, order: int) -> Array:
        """Derivative of every function at the points, (points, functions)."""
        m = np.arange(1, self.waves + 1)
        phase = np.multiply.outer(points, m) + order * np.pi / 2
        first = np.full((len(points), 1), 0.0 if order else 1.0)
        return np.concatenate([first, m**order * np.cos(phase), m**order * np.sin(phase)], axis=1)


@dataclass(frozen=True)
class Skirt(Blown):
    """A cone that hangs from its upper rim; its first direction is `Fourier`."""

    @cached_property
    def _radii(self) -> Array:
        return LOWER + self._slope * self.splines[1].gauss[0].ravel()

    @property
    def _slope(self) -> float:
        return (UPPER - LOWER) / LENGTH

    @cached_property
    def _masses(self) -> tuple[Array, Array]:
        area = self._radii * np.sqrt(1 + self._slope**2)  # per xi1 and xi2
        weights = self.splines[0].gauss[1].ravel(), self.splines[1].gauss[1].ravel() * area
        one, two = (a[0].T @ (w[:, None] * a[0]) for a, w in zip(self._at_gauss, weights, strict=True))
        return one, two

    @cached_property
    def _integrals(self) -> Array:
        one, two = self._masses
        return np.outer(one[0], two.sum(axis=0))  # the first Fourier term is 1

    @cached_property
    def _bands(self) -> list[tuple[slice, list[Array], Array]]:
        [(functions, values, weights)] = super()._bands
        return [(functions, values, weights * self._radii * np.sqrt(1 + self._slope**2))]

    @cached_property
    def _reference(self) -> list[Array]:
        """The five vectors of the cone at rest."""
        angle, r, s = self.splines[0].gauss[0].ravel()[:, None], self._radii, self._slope
        one = np.ones_like(angle * r)
        cos, sin, zero = np.cos(angle) * one, np.sin(angle) * one, 0 * one
        around, out = np.stack([-sin, zero, cos]), np.stack([cos, zero, sin])
        return [r * around, s * out + np.stack([zero, one, zero]), -r * out, 0 * out, s * around]

    def _vectors(self, coefficients: Array, one: list[Array]) -> list[Array]:
        moved = super()._vectors(coefficients, one)
        moved[0][0] -= 1.0  # of the plane
        moved[1][1] -= 1.0
        return [u + x for u, x in zip(moved, self._reference, strict=True)]

    def _densities(self, x: list[Array], weight: Array) -> tuple[list[Array], float, float]:
        """Derivatives by the vectors, membrane and bending energy; strains by lengths of the cone at rest."""
        r, side = self._radii, np.sqrt(1 + self._slope**2)
        scale = r**2, side**2, r * side
        stretching, bending = self._stiffnesses
        a1, a2 = x[:2]
        strain = ((_dot(a1, a1) / scale[0] - 1) / 2, (_dot(a2, a2) / scale[1] - 1) / 2, _dot(a1, a2) / scale[2])
        stress = self._stresses(strain, stretching * weight)
        n11, n22, n12 = (n / length for n, length in zip(stress, scale, strict=True))
        c = _cross(a1, a2)
        area = np.sqrt(_dot(c, c))
        n = c / area
        b11, b22, b12 = (_dot(n, second) for second in x[2:])
        bent = ((b11 - r / side) / scale[0], b22 / scale[1], 2 * b12 / scale[2])
        moment = self._stresses(bent, bending * weight)
        m11, m22, m12 = (m / length for m, length in zip(moment, scale, strict=True))
        lever = m11 * x[2] + m22 * x[3] + 2 * m12 * x[4] - (m11 * b11 + m22 * b22 + 2 * m12 * b12) * n
        lever /= area
        forces = [n11 * a1 + n12 * a2 + _cross(a2, lever), n22 * a2 + n12 * a1 + _cross(lever, a1)]
        energies = _sum(strain, stress) / 2, _sum(bent, moment) / 2
        return [*forces, m11 * n, m22 * n, 2 * m12 * n], *energies

    def position(self, coefficients: Array, one: float, two: float) -> Array:
        """Position of a point, (3,)."""
        r = LOWER + self._slope * two
        rest = np.array([r * np.cos(one), two, r * np.sin(one)])
        return np.asarray(rest + self.displacements(coefficients, np.array([one]), np.array([two]))[0, 0])

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return self.density * np.pi * (LOWER + UPPER) * float(np.hypot(LENGTH, LOWER - UPPER))

    def centre(self, coefficients: Array) -> Array:
        """Centre of mass, (3,); at rest it is that of a trapezium's sides."""
        height = LENGTH * (LOWER + 2 * UPPER) / (3 * (LOWER + UPPER))
        moved = self.density * np.sum(coefficients * self._integrals, axis=(1, 2)) / self.mass
        return np.asarray(np.array([0.0, height, 0.0]) + moved)


def skirt_of(waves: int, spans: int, degree: int = 5) -> Skirt:
    """The skirt by so many waves around and spans along."""
    around, along = Fourier(waves), Splines(np.linspace(0.0, LENGTH, spans + 1), degree)
    rim = tuple((i, along.count - 1) for i in range(around.count))
    return Skirt((around, along), YOUNG, POISSON, THICKNESS, DENSITY, GRAVITY, held=rim, wind=SKIRT_WIND)  # type: ignore[arg-type]


def flag_of(spans: int, degree: int = 4, grading: float = 0.4) -> Flag:
    """The flag by so many spans along its longer side, dense toward its pins."""
    long, short = FLAG_SIDES
    breaks = grading * np.sinh(np.linspace(0.0, 1.0, spans + 1) * np.arcsinh(long / grading))
    half = short / 2
    across = grading * np.sinh(np.linspace(0.0, 1.0, round(spans * half) + 1) * np.arcsinh(half / grading))
    lines = Splines(breaks, degree), Splines(np.concatenate([across, (short - across)[-2::-1]]), degree)
    pins = (Pin((0.0, y), STIFFNESS, WIDTH) for y in (0.0, short))
    material = YOUNG, POISSON, THICKNESS, DENSITY, GRAVITY, BENDING
    return Flag(lines, *material, pin=next(pins), wind=FLAG_WIND, other_pin=next(pins))


def skirt() -> dict[str, Estimate]:
    """Known values of the skirt."""
    hem = ("hem", (np.pi, 0.0))
    fine, coarse = (quantities(motion(skirt_of(*n), TIMES, TOLERANCE / 10), hem, "xy") for n in ((32, 16), (24, 12)))
    return between(fine, coarse, ROUNDING)


def flag() -> dict[str, Estimate]:
    """Known values of the flag."""
    corner = ("corner", (FLAG_SIDES[0], 0.0))
    fine, coarse = (quantities(motion(flag_of(n), TIMES, TOLERANCE), corner) for n in (16, 12))
    return between(fine, coarse, ROUNDING)


JUDGES = {"skirt": skirt, "flag": flag}
