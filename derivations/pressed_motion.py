r"""A held plate, pressed from rest by two of its own waves in time with sin(w t): modal closed form, and splines in motion.

For w = sum_m c_m(t) sin(m pi x / a) sin(pi y / b) the linear theory gives oscillators of their own,

    rho c'' + rho omega_m^2 c = p_m sin(w t),   omega_m = pi^2 (m^2/a^2 + 1/b^2) sqrt(B / rho),
    c = p_m / (rho (omega_m^2 - w^2)) (sin(w t) - (w / omega_m) sin(omega_m t)).

Energies: rho a b / 8 sum c'^2 kinetic, and rho a b / 8 sum omega_m^2 c^2 of bending. The rim bears what the load is more than
the plate's acceleration takes, by Newton's law of the whole: the integral of p_m sin(w t) - rho c'' over a wave.

The case asks for large displacements. With its edges held the plate stretches as it deflects, which stiffens it by a
fraction of order (w / h)^2, here 1e-7: `STIFFENING`, the uncertainty of what is linear. The second form keeps it: the
equations of large displacements on splines (`spline_motion`), integrated in time.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .estimate import Estimate
from .explicit_motion import motion
from .plate import OBLIQUE
from .spline_motion import Cloth
from .spline_shell import Splines
from .surface_strains import Array

A, B = 1.0, 0.7  # sides, m
YOUNG, POISSON, THICKNESS, DENSITY = 1e7, 0.3, 0.01, 1.0
PRESSURES = {1: 0.002, 2: 0.001}  # of the waves m, N/m^2
RATE = 20.0  # w, rad/s
TIMES = (0.06, 0.1)
POINTS = ((0.3, 0.2), (0.8, 0.45), (0.55, 0.1))
STIFFENING = 2e-7
"""Relative uncertainty: (w / h)^2 is at most 6e-8."""


def bending_stiffness() -> float:
    """B = E h^3 / (12 (1 - nu^2)), N m."""
    return YOUNG * THICKNESS**3 / (12 * (1 - POISSON**2))


def frequency(m: int) -> float:
    """Angular frequency of a wave, rad/s."""
    return float(np.pi**2 * (m**2 / A**2 + 1 / B**2) * np.sqrt(bending_stiffness() / DENSITY))


def amplitude(m: int, time: float) -> tuple[float, float]:
    """Amplitude of a wave, m, and its velocity, m/s."""
    omega = frequency(m)
    size = PRESSURES[m] / (DENSITY * (omega**2 - RATE**2))
    moved = np.sin(RATE * time) - RATE / omega * np.sin(omega * time)
    return float(size * moved), float(size * RATE * (np.cos(RATE * time) - np.cos(omega * time)))


def acceleration(m: int, time: float) -> float:
    """Second derivative of the amplitude of a wave, m/s^2."""
    omega = frequency(m)
    size = PRESSURES[m] / (DENSITY * (omega**2 - RATE**2))
    return float(size * RATE * (omega * np.sin(omega * time) - RATE * np.sin(RATE * time)))


def wave_area(m: int) -> float:
    """Integral of a wave over the plate, m^2."""
    return float(A * (1 - np.cos(m * np.pi)) / (m * np.pi) * 2 * B / np.pi)


def shape(m: int, x: Array, y: Array) -> Array:
    """A wave at points."""
    return np.asarray(np.sin(m * np.pi * x / A) * np.sin(np.pi * y / B))


def _named(time: float, deflections: Array, kinetic: float, bending: float) -> dict[str, tuple[float, str]]:
    label = f"{1000 * time:.0f}ms"
    return {
        f"deflection_{label}": (float(deflections[0]), "m"),
        f"mean_oblique_{label}": (OBLIQUE * float(deflections.mean()), "m"),
        f"kinetic_energy_{label}": (kinetic, "J"),
        f"bending_energy_{label}": (bending, "J"),
    }


def pressed_motion() -> dict[str, Estimate]:
    """Known values by the modal closed form."""
    x, y = np.array(POINTS).T
    values = {}
    for time in TIMES:
        modes = {m: amplitude(m, time) for m in PRESSURES}
        deflections = sum(c * shape(m, x, y) for m, (c, _) in modes.items())
        share = DENSITY * A * B / 8
        kinetic = share * sum(v**2 for _, v in modes.values())
        bending = share * sum((frequency(m) * c) ** 2 for m, (c, _) in modes.items())
        for name, (value, unit) in _named(time, deflections, kinetic, bending).items():
            values[name] = Estimate(value, 2 * STIFFENING * abs(value), unit)
    early = TIMES[0]
    parts = [
        (wave_area(m) * p * np.sin(RATE * early), wave_area(m) * DENSITY * acceleration(m, early))
        for m, p in PRESSURES.items()
    ]
    force = float(sum(load - inertia for load, inertia in parts))
    error = 2 * STIFFENING * float(sum(abs(load) + abs(inertia) for load, inertia in parts))
    values["rim_force_60ms"] = Estimate(force, error, "N")
    return values


@dataclass(frozen=True)
class PressedPlate(Cloth):
    """A cloth under the pressing waves; both are integrated by the splines' own Gauss points."""

    waves: Array = field(default_factory=lambda: np.zeros(0), compare=False)

    def rim_force(self, time: float, coefficients: Array) -> float:
        """Upward force of the rim, N: the load less what accelerates the plate, which splines add up to one everywhere."""
        lifted, _ = self.acceleration(time, coefficients)
        one, two = (s.matrix(s.gauss[0].ravel(), 0).T @ s.gauss[1].ravel() for s in self.splines)
        return float(np.sin(RATE * time) * self.waves.sum() + self.density * (one @ lifted[2] @ two))

    def acceleration(self, time: float, coefficients: Array) -> tuple[Array, Array]:
        """Second time derivative of the coefficients, and the reactions of the held ones."""
        one, two = self._inverses
        force = self.forces(coefficients)
        force[2] -= np.sin(RATE * time) * self.waves
        free = one @ force @ two / self.density
        (rows, columns), columns_of_inverse, small = self._holding
        reaction = -free[:, rows, columns] @ small
        return free + np.einsum("ijk,ck->cij", columns_of_inverse, reaction), reaction


def plate_of_splines(spans: int, degree: int) -> PressedPlate:
    """The plate with so many spans a side."""
    lines = tuple(Splines(np.linspace(0.0, side, spans + 1), degree) for side in (A, B))
    x, y = (s.gauss[0].ravel() for s in lines)
    load = sum(p * shape(m, x[:, None], y) for m, p in PRESSURES.items())
    one, two = (s.matrix(points, 0) * s.gauss[1].ravel()[:, None] for s, points in zip(lines, (x, y), strict=True))
    last = lines[0].count - 1
    rim = tuple((i, j) for i in range(last + 1) for j in range(last + 1) if i in (0, last) or j in (0, last))
    still = (0.0, 0.0, 0.0)
    return PressedPlate(lines, YOUNG, POISSON, THICKNESS, DENSITY, still, held=rim, waves=one.T @ load @ two)


FINE, COARSE = (4, 1e-8), (3, 1e-7)
"""Spans a side, and tolerance of the steps."""
DEGREE = 8


def pressed_motion_of_splines() -> dict[str, Estimate]:
    """Values by splines in motion; the uncertainty is the change from fewer spans and a tenfold tolerance."""
    levels = []
    for spans, tolerance in (FINE, COARSE):
        plate = plate_of_splines(spans, DEGREE)
        found: dict[str, tuple[float, str]] = {}
        for moment in motion(plate, TIMES, tolerance):
            energies = plate.energies(moment.coefficients, moment.velocity)
            down = -np.array([plate.position(moment.coefficients, *point)[2] for point in POINTS])
            found |= _named(moment.time, down, energies.kinetic, energies.bending)
            if moment.time == TIMES[0]:
                found["rim_force_60ms"] = (plate.rim_force(moment.time, moment.coefficients), "N")
        levels.append(found)
    fine, coarse = levels
    return {
        name: Estimate.between(value, coarse[name][0], unit, 1e-7 * abs(value)) for name, (value, unit) in fine.items()
    }
