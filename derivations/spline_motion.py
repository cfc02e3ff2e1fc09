r"""Newton's law of a flat Kirchhoff-Love shell on tensor-product splines: a third mechanics of cloth.

The displacement's components are splines of one patch, x = (xi1, xi2, 0) + sum_ij C_ij B_i(xi1) B_j(xi2), and Hamilton's
principle with the energy of `spline_shell`,

    W = 1/2 D eps.H.eps + 1/2 B kappa.H.kappa,   eps = (a - 1) / 2,   kappa = -b,

gives M C'' = f - dW/dC. Everything on the patch is a product of the two directions: the mass is rho M1 (x) M2, inverted
exactly by two small factors, the derivatives at the Gauss points are two matrix products, and an elastic pin with a
Gaussian stiffness is k S1 (x) S2. Coefficients that are held take the multipliers that keep their acceleration as
prescribed; these are the reactions. With two components the motion is plane and b vanishes identically.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .spline_shell import Splines
from .surface_strains import DERIVATIVES, Array

FINE_GAUSS = 24
"""Gauss points of a span for the stiffness of a pin, which is no polynomial."""


BAND = 5000
"""Gauss points whose forces are formed at once: the arrays fit into a cache."""


@dataclass(frozen=True)
class Pin:
    """Elastic support with energy density k/2 exp(-r^2 / (2 s^2)) abs(u)^2, r the distance to a place.

    Attributes
    ----------
    place : xi1 and xi2
    stiffness : k, N/m^3
    width : s, m
    """

    place: tuple[float, float]
    stiffness: float
    width: float


@dataclass(frozen=True)
class Energies:
    """Energies, J; the potential is that of gravity and pin."""

    kinetic: float
    membrane: float
    bending: float
    potential: float

    @property
    def total(self) -> float:
        """Their sum, which supports at rest conserve."""
        return self.kinetic + self.membrane + self.bending + self.potential


@dataclass(frozen=True)
class Cloth:
    """A flat patch under gravity.

    Attributes
    ----------
    splines : along xi1 and xi2
    young, poisson, thickness, density : Pa, 1, m, kg/m^2
    gravity : acceleration, as many components as the motion has: 2 for a plane one, else 3
    bending_factor : factor of the bending stiffness
    pin : elastic support of all components
    held : numbers (i, j) of coefficients whose acceleration is prescribed
    moved : acceleration of these at a time, (components, held); None for none
    """

    splines: tuple[Splines, Splines]
    young: float
    poisson: float
    thickness: float
    density: float
    gravity: tuple[float, ...]
    bending_factor: float = 1.0
    pin: Pin | None = None
    held: tuple[tuple[int, int], ...] = ()
    moved: Callable[[float], Array] | None = field(default=None, compare=False)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the coefficients: components, functions of xi1, functions of xi2."""
        return len(self.gravity), self.splines[0].count, self.splines[1].count

    @cached_property
    def _at_gauss(self) -> tuple[list[Array], list[Array]]:
        """Functions and derivatives up to the second at the Gauss points, for each direction (points, functions)."""
        one, two = ([s.matrix(s.gauss[0].ravel(), order) for order in range(3)] for s in self.splines)
        return one, two

    @cached_property
    def _masses(self) -> tuple[Array, Array]:
        """Integrals of products of functions, for each direction."""
        one, two = (
            a[0].T @ (s.gauss[1].ravel()[:, None] * a[0]) for a, s in zip(self._at_gauss, self.splines, strict=True)
        )
        return one, two

    @cached_property
    def _inverses(self) -> tuple[Array, Array]:
        one, two = (np.asarray(np.linalg.inv(m), dtype=np.float64) for m in self._masses)
        return one, two

    @cached_property
    def _pin(self) -> tuple[Array, Array] | None:
        """Factors of the stiffness of the pin."""
        if self.pin is None:
            return None
        x, w = np.polynomial.legendre.leggauss(FINE_GAUSS)
        factors = []
        for spline, place in zip(self.splines, self.pin.place, strict=True):
            half = np.diff(spline.breaks) / 2
            points = (spline.breaks[:-1, None] + half[:, None] * (1 + x)).ravel()
            weight = (half[:, None] * w).ravel() * np.exp(-((points - place) ** 2) / (2 * self.pin.width**2))
            values = spline.matrix(points, 0)
            factors.append(values.T @ (weight[:, None] * values))
        return self.pin.stiffness * factors[0], factors[1]

    @cached_property
    def _integrals(self) -> Array:
        """Integral of every function, (functions of xi1, functions of xi2)."""
        one, two = (m.sum(axis=0) for m in self._masses)
        return np.outer(one, two)

    @cached_property
    def _weight(self) -> Array:
        """Work of gravity on every coefficient."""
        return self.density * np.array(self.gravity)[:, None, None] * self._integrals

    @cached_property
    def _holding(self) -> tuple[tuple[Array, Array], Array, Array]:
        """Numbers of the held coefficients, their columns of the inverse mass, and the inverse of its part there."""
        rows, columns = (np.array(numbers) for numbers in zip(*self.held, strict=True))
        one, two = self._inverses
        inverse = np.einsum("ik,jk->ijk", one[:, rows], two[:, columns]) / self.density
        return (rows, columns), inverse, np.linalg.inv(inverse[rows, columns])

    @cached_property
    def _bands(self) -> list[tuple[slice, list[Array], Array]]:
        """Bands of a few spans of xi1, which fit into a cache: the functions that live there, these and their
        derivatives at the Gauss points (points, functions), and the weights there (points of xi1, points of xi2).
        """
        spline, across = self.splines[0], self.splines[1].gauss[1].ravel()
        points, weights = spline.gauss
        spans = max(1, BAND // (points.shape[1] * len(across)))
        bands = []
        for start in range(0, len(points), spans):
            stop = min(start + spans, len(points))
            functions = slice(start, stop + spline.degree)
            values = [spline.matrix(points[start:stop].ravel(), order)[:, functions].copy() for order in range(3)]
            bands.append((functions, values, weights[start:stop].reshape(-1, 1) * across))
        return bands

    def _vectors(self, coefficients: Array, one: list[Array]) -> list[Array]:
        """Derivatives of the position at the Gauss points of a band, each (components, points of xi1, of xi2)."""
        orders = DERIVATIVES if self.shape[0] == 3 else DERIVATIVES[:2]
        two = self._at_gauss[1]
        halves = {o: coefficients @ two[o].T for o in {o[1] for o in orders}}
        vectors = [one[o[0]] @ halves[o[1]] for o in orders]
        vectors[0][0] += 1.0
        vectors[1][1] += 1.0
        return vectors

    def _stresses(self, strain: Sequence[Array], stiffness: Array) -> tuple[Array, Array, Array]:
        """Stiffness times H times a strain (11, 22, doubled 12)."""
        nu = self.poisson
        return (
            stiffness * (strain[0] + nu * strain[1]),
            stiffness * (strain[1] + nu * strain[0]),
            (1 - nu) / 2 * stiffness * strain[2],
        )

    @property
    def _stiffnesses(self) -> tuple[float, float]:
        stretching = self.young * self.thickness / (1 - self.poisson**2)
        return stretching, stretching * self.thickness**2 / 12 * self.bending_factor

    def _densities(self, x: list[Array], weight: Array) -> tuple[list[Array], float, float]:
        """Derivatives by the vectors of a band, its membrane and bending energy."""
        a1, a2 = x[:2]
        stretching, bending = self._stiffnesses
        strain = (_dot(a1, a1) - 1) / 2, (_dot(a2, a2) - 1) / 2, _dot(a1, a2)
        n11, n22, n12 = self._stresses(strain, stretching * weight)
        membrane = _sum(strain, (n11, n22, n12)) / 2
        densities = [n11 * a1 + n12 * a2, n22 * a2 + n12 * a1]
        if len(x) == 2:
            return densities, membrane, 0.0
        c = _cross(a1, a2)
        area = np.sqrt(_dot(c, c))
        n = c / area
        b11, b22, b12 = (_dot(n, second) for second in x[2:])
        bent = b11, b22, 2 * b12
        m11, m22, m12 = self._stresses(bent, bending * weight)
        # M.b changes with x,1 by (x,2 cross m) . dx,1, m the part across n of M_ab x,ab over the area
        lever = m11 * x[2] + m22 * x[3] + 2 * m12 * x[4] - (m11 * b11 + m22 * b22 + 2 * m12 * b12) * n
        lever /= area
        densities[0] += _cross(a2, lever)
        densities[1] += _cross(lever, a1)
        return [*densities, m11 * n, m22 * n, 2 * m12 * n], membrane, _sum(bent, (m11, m22, m12)) / 2

    def strain_forces(self, coefficients: Array) -> tuple[Array, float, float]:
        """Return the derivative of the strain energy by the coefficients, membrane and bending energy (J)."""
        two = self._at_gauss[1]
        force, membrane, bending = np.zeros(self.shape), 0.0, 0.0
        for functions, one, weight in self._bands:
            x = self._vectors(coefficients[:, functions], one)
            densities, stretched, bent = self._densities(x, weight)
            membrane, bending = membrane + stretched, bending + bent
            halves: dict[int, Array] = {}
            for (first, second), density in zip(DERIVATIVES, densities, strict=False):
                half = one[first].T @ density
                halves[second] = halves[second] + half if second in halves else half
            for second, half in halves.items():
                force[:, functions] += half @ two[second]
        return force, membrane, bending

    def forces(self, coefficients: Array) -> Array:
        """Force on every coefficient, of strain, pin and gravity."""
        force = self._weight - self.strain_forces(coefficients)[0]
        if self._pin is not None:
            force -= self._pin[0] @ coefficients @ self._pin[1]
        return np.asarray(force)

    def acceleration(self, time: float, coefficients: Array) -> tuple[Array, Array]:
        """Second time derivative of the coefficients, and the reactions of the held ones (components, held)."""
        one, two = self._inverses
        free = one @ self.forces(coefficients) @ two / self.density
        if not self.held:
            return free, np.zeros((self.shape[0], 0))
        (rows, columns), columns_of_inverse, small = self._holding
        wanted = 0.0 if self.moved is None else self.moved(time)
        reaction = (wanted - free[:, rows, columns]) @ small
        return free + np.einsum("ijk,ck->cij", columns_of_inverse, reaction), reaction

    def energies(self, coefficients: Array, velocity: Array) -> Energies:
        """Energies at a state."""
        one, two = self._masses
        kinetic = self.density / 2 * float(np.sum(velocity * (one @ velocity @ two)))
        _, membrane, bending = self.strain_forces(coefficients)
        potential = -float(np.sum(self._weight * coefficients))
        if self._pin is not None:
            potential += float(np.sum(coefficients * (self._pin[0] @ coefficients @ self._pin[1]))) / 2
        return Energies(kinetic, membrane, bending, potential)

    def centre(self, coefficients: Array) -> Array:
        """Centre of mass, (components,)."""
        sides = [s.breaks[[0, -1]] for s in self.splines]
        middle = np.array([side.mean() for side in sides] + [0.0])[: self.shape[0]]
        area = float(np.prod([side[1] - side[0] for side in sides]))
        return np.asarray(middle + np.sum(coefficients * self._integrals, axis=(1, 2)) / area)

    def displacements(self, coefficients: Array, one: Array, two: Array) -> Array:
        """Displacement on the grid of the given coordinates, (xi1, xi2, components)."""
        first, second = (s.matrix(np.asarray(at), 0) for s, at in zip(self.splines, (one, two), strict=True))
        return np.moveaxis(first @ coefficients @ second.T, 0, -1)

    def position(self, coefficients: Array, one: float, two: float) -> Array:
        """Position of a point, (components,)."""
        start = np.array([one, two, 0.0])[: self.shape[0]]
        return np.asarray(start + self.displacements(coefficients, np.array([one]), np.array([two]))[0, 0])


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("cij,cij->ij", a, b))


def _sum(strain: Sequence[Array], stress: Sequence[Array]) -> float:
    return float(sum(np.vdot(e, s) for e, s in zip(strain, stress, strict=True)))


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
