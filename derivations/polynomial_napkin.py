r"""The napkins on a soft pin by global Legendre polynomials: a second form of their known values.

The positions x(xi1, xi2) on the unit square are sums of products of Legendre polynomials, whose mass is diagonal and
which resolve the pin at the corner by themselves. With F = grad x, E = (F^T F - 1) / 2 and b_ab = x,ab . n,

    dW = S_ab dE_ab + M_ab db_ab,   db_ab = (du,ab - Gamma^c_ab du,c) . n,   Gamma^c_ab = x,ab . a^c,

with the deformed contravariant basis a^c, where `surface_strains` differentiates the normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Legendre, legendre

from .estimate import Estimate
from .explicit_motion import motion
from .motion import GRAVITY, PIN, PLANE_TIMES, TILT, TILTED_TIMES, quantities
from .over_time import between
from .spline_motion import Energies
from .surface_strains import Array

YOUNG, POISSON, THICKNESS, DENSITY = 5000.0, 0.25, 0.0012, 0.144
TOLERANCE = 1e-7
ROUNDING = 1e-7


@dataclass(frozen=True)
class PolynomialNapkin:
    """A napkin of `count` polynomials along each side, under gravity of 2 (plane motion) or 3 components."""

    count: int
    gravity: tuple[float, ...]
    bending_factor: float = 1.0
    young: float = YOUNG
    poisson: float = POISSON
    thickness: float = THICKNESS

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the coefficients of the displacement."""
        return len(self.gravity), self.count, self.count

    def lines(self, points: Array, order: int) -> Array:
        """Derivative of the polynomials at points of [0, 1], (points, count)."""
        polynomials = [Legendre.basis(k, domain=[0.0, 1.0]).deriv(order) for k in range(self.count)]
        return np.stack([polynomial(points) for polynomial in polynomials], -1)

    @cached_property
    def _gauss(self) -> tuple[Array, list[Array]]:
        """Area weights, and polynomials with their derivatives at 3/2 as many points."""
        x, w = legendre.leggauss(3 * self.count // 2)
        return np.outer(w, w) / 4, [self.lines((1 + x) / 2, order) for order in range(3)]

    @cached_property
    def _mass(self) -> Array:
        line = 1 / (2 * np.arange(self.count) + 1)
        return DENSITY * np.outer(line, line)

    @cached_property
    def _pin(self) -> Array:
        """Stiffness of the pin at the points, with their weights."""
        x = (1 + legendre.leggauss(3 * self.count // 2)[0]) / 2
        square = (x[:, None] - PIN.place[0]) ** 2 + (x - PIN.place[1]) ** 2
        return np.asarray(self._gauss[0] * PIN.stiffness * np.exp(-square / (2 * PIN.width**2)))

    def _at_points(self, coefficients: Array, one: int, two: int) -> Array:
        lines = self._gauss[1]
        return np.asarray(lines[one] @ coefficients @ lines[two].T)

    def _strain_forces(self, coefficients: Array) -> tuple[Array, float, float]:
        """Derivative of the strain energy by the coefficients, membrane and bending energy."""
        weight, lines = self._gauss
        plate = self.young * self.thickness / (1 - self.poisson**2)
        gradient = np.stack([self._at_points(coefficients, 1, 0), self._at_points(coefficients, 0, 1)])
        gradient[0, 0] += 1.0
        gradient[1, 1] += 1.0
        metric = np.einsum("acij,bcij->abij", gradient, gradient)
        strain = (metric - np.eye(2)[:, :, None, None]) / 2
        stress = plate * weight * _isotropic(strain, self.poisson)
        by_first = np.einsum("abij,bcij->acij", stress, gradient)
        membrane = float(np.vdot(stress, strain)) / 2
        bending = 0.0
        force = np.zeros(self.shape)
        if len(self.gravity) == 3:
            mixed = self._at_points(coefficients, 1, 1)
            second = np.stack([self._at_points(coefficients, 2, 0), mixed, mixed, self._at_points(coefficients, 0, 2)])
            second = second.reshape(2, 2, *mixed.shape)
            normal = np.cross(gradient[0], gradient[1], axis=0)
            normal /= np.linalg.norm(normal, axis=0)
            dual = np.einsum("abij,bcij->acij", _inverse(metric), gradient)
            curvature = np.einsum("abcij,cij->abij", second, normal)
            moment = plate * self.thickness**2 / 12 * self.bending_factor * weight * _isotropic(curvature, self.poisson)
            bending = float(np.vdot(moment, curvature)) / 2
            turned = np.einsum("abij,abcij->cij", moment, second)
            by_first -= np.einsum("cij,dcij->dij", turned, dual)[:, None] * normal
            force += lines[2].T @ (moment[0, 0] * normal) @ lines[0]
            force += lines[0].T @ (moment[1, 1] * normal) @ lines[2]
            force += lines[1].T @ (2 * moment[0, 1] * normal) @ lines[1]
        force += lines[1].T @ by_first[0] @ lines[0] + lines[0].T @ by_first[1] @ lines[1]
        return force, membrane, bending

    def forces(self, coefficients: Array) -> Array:
        """Force on every coefficient, of strain, pin and gravity."""
        lines = self._gauss[1]
        pull = lines[0].T @ (self._pin * self._at_points(coefficients, 0, 0)) @ lines[0]
        force = -self._strain_forces(coefficients)[0] - pull
        force[:, 0, 0] += DENSITY * np.array(self.gravity)
        return np.asarray(force)

    def acceleration(self, time: float, coefficients: Array) -> tuple[Array, Array]:
        """Second time derivative of the coefficients; nothing is held, so there are no reactions."""
        return self.forces(coefficients) / self._mass, np.zeros((self.shape[0], 0))

    def energies(self, coefficients: Array, velocity: Array) -> Energies:
        """Energies at a state."""
        _, membrane, bending = self._strain_forces(coefficients)
        sprung = float(np.vdot(self._pin, np.sum(self._at_points(coefficients, 0, 0) ** 2, axis=0))) / 2
        fallen = DENSITY * float(np.dot(self.gravity, coefficients[:, 0, 0]))
        return Energies(float(np.sum(self._mass * velocity**2)) / 2, membrane, bending, sprung - fallen)

    def centre(self, coefficients: Array) -> Array:
        """Centre of mass, (components,)."""
        return np.asarray(np.array([0.5, 0.5, 0.0])[: self.shape[0]] + coefficients[:, 0, 0])

    def position(self, coefficients: Array, one: float, two: float) -> Array:
        """Position of a point, (components,)."""
        first, second = (self.lines(np.array([at]), 0)[0] for at in (one, two))
        moved = np.einsum("cij,i,j->c", coefficients, first, second)
        return np.asarray(np.array([one, two, 0.0])[: self.shape[0]] + moved)


def _isotropic(strain: Array, poisson: float) -> Array:
    """H of a flat reference applied to a symmetric tensor, (2, 2, ...)."""
    trace = strain[0, 0] + strain[1, 1]
    return np.asarray((1 - poisson) * strain + poisson * trace * np.eye(2)[:, :, None, None])


def _inverse(metric: Array) -> Array:
    adjugate = np.stack([metric[1, 1], -metric[0, 1], -metric[1, 0], metric[0, 0]]).reshape(metric.shape)
    return np.asarray(adjugate / (metric[0, 0] * metric[1, 1] - metric[0, 1] * metric[1, 0]))


def plane_values(count: int) -> dict[str, float]:
    """Values of napkin_plane with `count` polynomials along a side."""
    return quantities(motion(PolynomialNapkin(count, (0.0, -GRAVITY)), PLANE_TIMES, TOLERANCE))


def soft_pin_values(count: int) -> dict[str, float]:
    """Values of napkin_soft_pin with `count` polynomials along a side."""
    gravity = 0.0, -GRAVITY * float(np.cos(TILT)), GRAVITY * float(np.sin(TILT))
    return quantities(motion(PolynomialNapkin(count, gravity, 100.0), TILTED_TIMES, TOLERANCE))


def napkin_plane_polynomials() -> dict[str, Estimate]:
    """Values of the plane napkin by polynomials."""
    return between(plane_values(44), plane_values(32), ROUNDING)


def napkin_soft_pin_polynomials() -> dict[str, Estimate]:
    """Values of the napkin that leaves its plane by polynomials."""
    return between(soft_pin_values(44), soft_pin_values(34), ROUNDING)
