r"""Newton's law of a flat Kirchhoff-Love shell on tensor-product splines: a third mechanics of cloth.

The displacement's components are splines of one patch, x = (xi1, xi2, 0) + sum_ij C_ij B_i(xi1) B_j(xi2), and Hamilton's
principle with the energy of `spline_shell`,

    W = 1/2 D eps.H.eps + 1/2 B kappa.H.kappa,   eps = (a - 1) / 2,   kappa = -b,

gives M C'' = f - dW/dC. Everything on the patch is a product of the two directions: the mass is rho M1 (x) M2, inverted
exactly by two small factors, the derivatives at the Gauss points are two matrix products, and an elastic pin with a
Gaussian stiffness is k S1 (x) S2. Coefficients that are held take the multipliers that keep their acceleration as
prescribed; these are the reactions. With two components the motion is plane and b vanishes identically.

The time is left to an explicit Runge-Kutta method of order 8 with a tight tolerance (Hairer, Norsett & Wanner,
"Solving ordinary differential equations I", DOP853): these cloths are so soft that its steps are not short.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.integrate import DOP853

from .spline_shell import Splines
from .surface_strains import DERIVATIVES, Array

FINE_GAUSS = 24
"""Gauss points of a span for the stiffness of a pin, which is no polynomial."""


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
    def _weights(self) -> Array:
        one, two = (s.gauss[1].ravel() for s in self.splines)
        return one[:, None] * two

    @cached_property
    def _masses(self) -> tuple[Array, Array]:
        """Integrals of products of functions, for each direction."""
        one, two = (a[0].T @ (s.gauss[1].ravel()[:, None] * a[0]) for a, s in zip(self._at_gauss, self.splines, strict=True))
        return one, two

    @cached_property
    def _inverses(self) -> tuple[Array, Array]:
        one, two = (np.linalg.inv(m) for m in self._masses)
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

    def _derivative(self, coefficients: Array, orders: tuple[int, int]) -> Array:
        one, two = self._at_gauss
        return np.asarray(one[orders[0]] @ (coefficients @ two[orders[1]].T))

    def _vectors(self, coefficients: Array) -> list[Array]:
        """Derivatives of the position at the Gauss points, each (components, points of xi1, points of xi2)."""
        orders = DERIVATIVES if self.shape[0] == 3 else DERIVATIVES[:2]
        one, two = self._at_gauss
        halves = {o: coefficients @ two[o].T for o in {o[1] for o in orders}}
        vectors = [one[o[0]] @ halves[o[1]] for o in orders]
        vectors[0][0] += 1.0
        vectors[1][1] += 1.0
        return vectors

    def _stresses(self, strain: Sequence[Array], stiffness: float) -> tuple[Array, Array, Array]:
        """Stiffness times H times a strain (11, 22, doubled 12), with the weights of the Gauss points."""
        nu, weight = self.poisson, stiffness * self._weights
        return (
            weight * (strain[0] + nu * strain[1]),
            weight * (strain[1] + nu * strain[0]),
            weight * (1 - nu) / 2 * strain[2],
        )

    @property
    def _stiffnesses(self) -> tuple[float, float]:
        stretching = self.young * self.thickness / (1 - self.poisson**2)
        return stretching, stretching * self.thickness**2 / 12 * self.bending_factor

    def _collect(self, densities: Sequence[Array]) -> Array:
        """Sum derivatives by the vectors over the Gauss points to derivatives by the coefficients."""
        one, two = self._at_gauss
        halves: dict[int, Array] = {}
        for (first, second), density in zip(DERIVATIVES, densities, strict=False):
            half = one[first].T @ density
            halves[second] = halves[second] + half if second in halves else half
        return np.asarray(sum(half @ two[second] for second, half in halves.items()))

    def strain_forces(self, coefficients: Array) -> tuple[Array, float, float]:
        """Return the derivative of the strain energy by the coefficients, membrane and bending energy (J)."""
        x = self._vectors(coefficients)
        a1, a2 = x[:2]
        stretching, bending = self._stiffnesses
        strain = (_dot(a1, a1) - 1) / 2, (_dot(a2, a2) - 1) / 2, _dot(a1, a2)
        n11, n22, n12 = self._stresses(strain, stretching)
        membrane = _sum(strain, (n11, n22, n12)) / 2
        densities = [n11 * a1 + n12 * a2, n22 * a2 + n12 * a1]
        if len(x) == 2:
            return self._collect(densities), membrane, 0.0
        c = _cross(a1, a2)
        area = np.sqrt(_dot(c, c))
        n = c / area
        b = [_dot(n, second) for second in x[2:]]
        bent = b[0], b[1], 2 * b[2]
        m11, m22, m12 = self._stresses(bent, bending)
        # the derivative of b by x,1 is (x,2 cross m) . dx,1 with m the part of x,ab M_ab across n over the area
        m12 = 2 * m12
        lever = (m11 * x[2] + m22 * x[3] + m12 * x[4] - (m11 * b[0] + m22 * b[1] + m12 * b[2]) * n) / area
        densities[0] += _cross(a2, lever)
        densities[1] += _cross(lever, a1)
        densities += [m11 * n, m22 * n, m12 * n]
        return self._collect(densities), membrane, _sum(bent, (m11, m22, m12 / 2)) / 2

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
        return middle + np.sum(coefficients * self._integrals, axis=(1, 2)) / area

    def displacements(self, coefficients: Array, one: Array, two: Array) -> Array:
        """Displacement on the grid of the given coordinates, (xi1, xi2, components)."""
        first, second = (s.matrix(np.asarray(at), 0) for s, at in zip(self.splines, (one, two), strict=True))
        return np.moveaxis(first @ coefficients @ second.T, 0, -1)

    def position(self, coefficients: Array, one: float, two: float) -> Array:
        """Position of a point, (components,)."""
        start = np.array([one, two, 0.0])[: self.shape[0]]
        return np.asarray(start + self.displacements(coefficients, np.array([one]), np.array([two]))[0, 0])


@dataclass(frozen=True)
class Moment:
    """A cloth at a time: coefficients, their velocity, reactions of the held ones, evaluations of forces so far."""

    cloth: Cloth
    time: float
    coefficients: Array
    velocity: Array
    reaction: Array
    evaluations: int


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("cij,cij->ij", a, b))


def _sum(strain: Sequence[Array], stress: Sequence[Array]) -> float:
    return float(sum(np.vdot(e, s) for e, s in zip(strain, stress, strict=True)))


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def motion(cloth: Cloth, times: Sequence[float], tolerance: float, start_velocity: Array | None = None) -> Iterator[Moment]:
    """Yield the cloth at rising times, from its reference at time 0.

    Parameters
    ----------
    tolerance : relative of the displacement and of the velocity, and a tenth of it absolute, a step
    start_velocity : velocity of the coefficients at time 0; None for rest

    Raises
    ------
    RuntimeError
        If the step of time underflows.
    """
    shape = cloth.shape
    size = int(np.prod(shape))

    def rate(time: float, state: Array) -> Array:
        return np.concatenate([state[size:], cloth.acceleration(time, state[:size].reshape(shape))[0].ravel()])

    state = np.zeros(2 * size)
    if start_velocity is not None:
        state[size:] = start_velocity.ravel()
    now, evaluations = 0.0, 0
    for time in times:
        solver = DOP853(rate, now, state, time, rtol=tolerance, atol=tolerance / 10)
        while solver.status == "running":
            solver.step()
        if solver.status == "failed":
            raise RuntimeError(f"the step of time underflows at {solver.t:.4g} s")
        now, state = float(time), solver.y
        evaluations += solver.nfev
        coefficients, velocity = (part.reshape(shape) for part in (state[:size], state[size:]))
        reaction = cloth.acceleration(now, coefficients)[1]
        yield Moment(cloth, now, coefficients, velocity, reaction, evaluations)
