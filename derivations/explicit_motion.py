"""Motion of a spline cloth from rest by explicit steps of time, which such soft cloths allow.

- `motion`: Runge-Kutta of order 8 with control of its error (Hairer, Norsett & Wanner, "Solving ordinary differential
  equations I", DOP853). Its error is negligible; bending limits its steps.
- `leapfrog`: velocity Verlet, the step a fraction of the limit 2 / omega, with the largest angular frequency omega by power
  iteration on the way. Four times cheaper at the limit of stability, of order 2; fine meshes are so stiff that even
  its largest step is far below what the cloth does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.integrate import DOP853

from .spline_motion import Energies
from .surface_strains import Array

POWERS = 10
"""Power iterations for the largest frequency each time, from the last vector and as much of a random one.

Stretch makes other modes the stiffest, of which a converged vector holds no more than rounding: without the random part
the napkin held at a corner was followed with steps 1.3 times too long. With it the estimate was never below 0.92 of
the frequency, which rose by no more than a tenth until the next one: together above the 0.8 that the steps leave.
"""
FIRST_POWERS = 200
PERTURBATION = 1e-6
"""Largest perturbed coefficient for the differences of forces, m."""
PERIOD = 20
"""Steps between two estimates of the largest frequency."""


class Cloth(Protocol):
    """Interface of a discretised cloth, as of `spline_motion.Cloth` and `polynomial_napkin`."""

    @property
    def gravity(self) -> tuple[float, ...]:
        """Acceleration, as many components as the motion has."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the coefficients of the displacement."""

    def acceleration(self, time: float, coefficients: Array) -> tuple[Array, Array]:
        """Second time derivative of the coefficients, and the reactions of the held ones."""

    def energies(self, coefficients: Array, velocity: Array) -> Energies:
        """Energies at a state."""

    def centre(self, coefficients: Array) -> Array:
        """Centre of mass, (components,)."""

    def position(self, coefficients: Array, one: float, two: float) -> Array:
        """Position of a point, (components,)."""


@dataclass(frozen=True)
class Moment:
    """A cloth at a time: coefficients, their velocity, reactions of the held ones (N), evaluations of forces so far."""

    cloth: Cloth
    time: float
    coefficients: Array
    velocity: Array
    reaction: Array
    evaluations: int


def motion(cloth: Cloth, times: Sequence[float], tolerance: float) -> Iterator[Moment]:
    """Yield the cloth at rising times, from rest in its reference at time 0.

    `tolerance` bounds the error of a step relative to displacement and velocity, a tenth of it absolutely.

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
    now, evaluations = 0.0, 0
    for time in times:
        solver = DOP853(rate, now, state, time, rtol=tolerance, atol=tolerance / 10)
        with np.errstate(over="ignore", invalid="ignore"):  # of trial steps that turn out too long
            while solver.status == "running":
                solver.step()
        if solver.status == "failed":
            raise RuntimeError(f"the step of time underflows at {solver.t:.4g} s")
        now, state = float(time), solver.y
        evaluations += solver.nfev
        coefficients, velocity = (part.reshape(shape) for part in (state[:size], state[size:]))
        reaction = cloth.acceleration(now, coefficients)[1]
        yield Moment(cloth, now, coefficients, velocity, reaction, evaluations)


def largest_frequency(cloth: Cloth, coefficients: Array, vector: Array, powers: int) -> tuple[float, Array]:
    """Largest angular frequency (rad/s) about a state by power iteration from a vector, and the vector it ends with.

    The frequency is not a number if the state is so far off that the perturbation is lost in it.
    """
    base = cloth.acceleration(0.0, coefficients)[0]
    square = 0.0
    for _ in range(powers):
        vector = vector * (PERTURBATION / np.abs(vector).max())
        change = base - cloth.acceleration(0.0, coefficients + vector)[0]
        if not np.any(change):
            return float("nan"), vector
        square = float(np.linalg.norm(change) / np.linalg.norm(vector))
        vector = change
    return float(np.sqrt(square)), vector


def leapfrog(cloth: Cloth, times: Sequence[float], fraction: float) -> Iterator[Moment]:
    """Yield the cloth at rising times, from rest at time 0, by steps of a fraction of the limit of stability.

    Raises
    ------
    RuntimeError
        If it turns unstable.
    """
    rng = np.random.default_rng(0)
    coefficients, velocity = np.zeros(cloth.shape), np.zeros(cloth.shape)
    _, vector = largest_frequency(cloth, coefficients, rng.normal(size=cloth.shape), FIRST_POWERS)
    now, evaluations = 0.0, FIRST_POWERS
    acceleration, reaction = cloth.acceleration(now, coefficients)
    for time in times:
        while now < time:
            noise = rng.normal(size=cloth.shape)
            mixed = vector / np.linalg.norm(vector) + noise / np.linalg.norm(noise)
            frequency, vector = largest_frequency(cloth, coefficients, mixed, POWERS)
            if not np.isfinite(frequency):
                raise RuntimeError(f"the leapfrog is unstable at {now:.4g} s")
            count = int(np.ceil((time - now) * frequency / (2 * fraction)))
            step = (time - now) / count
            for _ in range(min(count, PERIOD)):
                velocity = velocity + step / 2 * acceleration
                coefficients = coefficients + step * velocity
                now += step
                acceleration, reaction = cloth.acceleration(now, coefficients)
                velocity = velocity + step / 2 * acceleration
            evaluations += POWERS + min(count, PERIOD) + 1
            if count <= PERIOD:
                now = float(time)
        yield Moment(cloth, now, coefficients, velocity, reaction, evaluations)
