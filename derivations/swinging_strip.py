r"""A strip that swings in a vertical plane about a hinge: Newton's law of its positions in Legendre polynomials.

With p = x' and q = x'' along the reference length, eps = (p.p - 1) / 2, b = (p1 q2 - p2 q1) / abs(p) and the energy
1/2 D eps^2 + 1/2 B b^2 per area. The mass of Legendre polynomials is diagonal; the hinge at s = 0 is one multiplier for
each component, its force, which keeps the acceleration there at zero. Because gravity starts to act at once, a
bending wave leaves the hinge at the start: position and energies converge fast, the force as slowly as the sum of
the wave's harmonics.

The known values are those of the same strip as a cloth in space (`spline_motion`); the polynomials are their second form.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Legendre, legendre
from scipy.integrate import DOP853

from .estimate import Estimate
from .explicit_motion import motion
from .over_time import at_time, between
from .spline_motion import Cloth
from .spline_shell import Splines
from .surface_strains import Array

TIMES = (0.25, 0.5, 0.75, 1.0)
TOLERANCE = 1e-8
"""Of the Runge-Kutta method."""
ROUNDING = 1e-8
"""Error left by its time steps, m, N and J."""


@dataclass(frozen=True)
class Swing:
    """A strip at a time: position of the tip and of the centre of mass (m), energies (J), force of the hinge (N)."""

    time: float
    tip: Array
    centre: Array
    kinetic: float
    membrane: float
    bending: float
    potential: float
    hinge: Array


@dataclass(frozen=True)
class SwingingStrip:
    """Length, width and thickness in m, Young's modulus in Pa, density in kg/m^2, gravity in m/s^2; `count` polynomials."""

    count: int
    length: float = 1.0
    width: float = 0.1
    thickness: float = 0.0012
    young: float = 5000.0
    bending_factor: float = 1e4
    density: float = 0.144
    gravity: float = 9.8

    @cached_property
    def _gauss(self) -> tuple[Array, Array, Array]:
        """Weights, and first and second derivatives of the polynomials at the points (points, count)."""
        x, w = legendre.leggauss(2 * self.count)
        lines = [Legendre.basis(k, domain=[0.0, self.length]) for k in range(self.count)]
        s = (1 + x) * self.length / 2
        first, second = (
            np.asarray(np.stack([line.deriv(o)(s) for line in lines], -1), dtype=np.float64) for o in (1, 2)
        )
        return np.asarray(w * self.length / 2, dtype=np.float64), first, second

    @cached_property
    def _mass(self) -> Array:
        """Diagonal of the mass of a component."""
        return self.density * self.width * self.length / (2 * np.arange(self.count) + 1)

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """Values of the polynomials at the hinge and at the tip."""
        return np.where(np.arange(self.count) % 2, -1.0, 1.0), np.ones(self.count)

    @property
    def start(self) -> Array:
        """Coefficients of the positions (s, 0), (2, count)."""
        coefficients = np.zeros((2, self.count))
        coefficients[0, :2] = self.length / 2
        return coefficients

    def strain_forces(self, coefficients: Array) -> tuple[Array, float, float]:
        """Return the derivative of the strain energy by the coefficients, membrane and bending energy (J)."""
        weight, first, second = self._gauss
        stretching = self.young * self.thickness * self.width
        bending = stretching * self.thickness**2 / 12 * self.bending_factor
        p, q = coefficients @ first.T, coefficients @ second.T
        square = p[0] ** 2 + p[1] ** 2
        r = np.sqrt(square)
        strain, b = (square - 1) / 2, (p[0] * q[1] - p[1] * q[0]) / r
        pull, moment = weight * stretching * strain, weight * bending * b
        by_p = pull * p + moment * (np.stack([q[1], -q[0]]) / r - b * p / square)
        by_q = moment * np.stack([-p[1], p[0]]) / r
        force = by_p @ first + by_q @ second
        return force, float(pull @ strain) / 2, float(moment @ b) / 2

    def acceleration(self, coefficients: Array) -> tuple[Array, Array]:
        """Second time derivative of the coefficients, and the force of the hinge."""
        force = -self.strain_forces(coefficients)[0]
        force[1, 0] -= self.density * self.width * self.length * self.gravity
        hinge = self._ends[0]
        free = force / self._mass
        reaction = -(free @ hinge) / (hinge**2 / self._mass).sum()
        return free + reaction[:, None] * hinge / self._mass, reaction

    def _swing(self, time: float, coefficients: Array, velocity: Array) -> Swing:
        _, membrane, bending = self.strain_forces(coefficients)
        kinetic = float((velocity**2 @ self._mass).sum()) / 2
        centre = coefficients[:, 0]
        potential = self.density * self.width * self.length * self.gravity * float(centre[1])
        tip = coefficients @ self._ends[1]
        return Swing(time, tip, centre, kinetic, membrane, bending, potential, self.acceleration(coefficients)[1])

    def motion(self, times: Sequence[float], tolerance: float) -> Iterator[Swing]:
        """Yield the strip at rising times, from rest in the horizontal at time 0.

        Raises
        ------
        RuntimeError
            If the step of time underflows.
        """
        size = 2 * self.count

        def rate(_: float, state: Array) -> Array:
            return np.concatenate([state[size:], self.acceleration(state[:size].reshape(2, -1))[0].ravel()])

        now, state = 0.0, np.concatenate([self.start.ravel(), np.zeros(size)])
        for time in times:
            solver = DOP853(rate, now, state, time, rtol=tolerance, atol=tolerance / 10)
            with np.errstate(over="ignore", invalid="ignore"):  # of trial steps that turn out too long
                while solver.status == "running":
                    solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"the step of time underflows at {solver.t:.4g} s")
            now, state = float(time), solver.y
            yield self._swing(now, state[:size].reshape(2, -1), state[size:].reshape(2, -1))


def swinging_values(count: int, tolerance: float = TOLERANCE) -> dict[str, float]:
    """Values of the strip by `count` polynomials a component."""
    values: dict[str, float] = {}
    for swing in SwingingStrip(count).motion(TIMES, tolerance):
        energies = {"kinetic": swing.kinetic, "membrane": swing.membrane, "bending": swing.bending}
        values |= at_time(swing.time, {"tip": swing.tip, "centre": swing.centre, "hinge": swing.hinge}, energies, "xz")
    return values


def spline_strip(spans: int, degree: int) -> Cloth:
    """Return the strip as a cloth in space, by quadratics across, its edge xi1 = 0 held."""
    splines = Splines(np.linspace(0.0, 1.0, spans + 1), degree), Splines(np.array([0.0, 0.1]), 2)
    held = tuple((0, j) for j in range(splines[1].count))
    return Cloth(splines, 5000.0, 0.0, 0.0012, 0.144, (0.0, 0.0, -9.8), 1e4, held=held)


def spline_values(spans: int, degree: int, tolerance: float = TOLERANCE) -> dict[str, float]:
    """Values of the strip as a cloth; what differs across it, and moves across its plane, is left out."""
    plane = [0, 2]
    values: dict[str, float] = {}
    for moment in motion(spline_strip(spans, degree), TIMES, tolerance):
        cloth, coefficients = moment.cloth, moment.coefficients
        found = cloth.energies(coefficients, moment.velocity)
        energies = {"kinetic": found.kinetic, "membrane": found.membrane, "bending": found.bending}
        vectors = {
            "tip": cloth.position(coefficients, 1.0, 0.05)[plane],
            "centre": cloth.centre(coefficients)[plane],
            "hinge": moment.reaction.sum(axis=1)[plane],
        }
        values |= at_time(moment.time, vectors, energies, "xz")
    return values


def pendulum_strip() -> dict[str, Estimate]:
    """Known values of the swinging strip, as a cloth of splines."""
    return between(spline_values(64, 3), spline_values(32, 4), ROUNDING)


def pendulum_polynomials() -> dict[str, Estimate]:
    """Values of the swinging strip by polynomials of its positions: the second form."""
    return between(swinging_values(32), swinging_values(24), ROUNDING)
