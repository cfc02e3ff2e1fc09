r"""Rayleigh's damping: a plate in its lowest mode, and a rigid pendulum.

With alpha rho v as force an area and beta times the stresses of the rates of strain, a mode of frequency w obeys

    u'' + (alpha + beta w^2) u' + w^2 u = f.

**Plate.** The load has the shape of the mode m = n = 1 of `woven`, acts from rest at once and stays. With
z = alpha / (2 w) + beta w / 2 and v = w (1 - z^2)^(1/2)

    u = f / w^2 (1 - exp(-z w t) (cos v t + z w / v sin v t)),    u' = f / v exp(-z w t) sin v t.

The case asks for large displacements, which stretch the held plate: `STIFFENING`. The second form has the modes of a plate
in splines (`woven_by_splines`), each integrated by the exponential of its equations' matrix.

**Pendulum.** A rigid turn strains nothing, so that beta takes nothing. For the angle p below the horizontal, of a strip of
length L about its end,

    p'' + alpha p' = 3 g / (2 L) cos p.

Its end carries the weight, the inertia and the damping of the centre of mass. The strip of the case is not quite rigid: its tension stretches it, and it bends as it starts: `YIELDING`. The angle is
integrated by a Runge-Kutta method, and solved for in Chebyshev polynomials on all of the time at once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, expm

from .estimate import Estimate
from .woven import SIDES, Array, Four, waves
from .woven_by_splines import _matrix, supported

BENDING: Four = (0.06, 0.004, 0.03, 0.008)
DENSITY, LOAD, BY_MASS, BY_STIFFNESS = 0.2, 2e-5, 0.5, 0.02
TIMES = (0.3, 0.6, 1.2)
ASIDE, OBLIQUE = (0.5, 0.75), -2 / 3
SPANS = (6, 6), (8, 8)
STIFFENING = 5e-6
"""Relative: immovable edges stiffen a plate by some A11 w^2 / (4 D11), here 2e-9, and it slides by w^2 / L in its plane: 4e-6."""

STRIP, MASS, GRAVITY, BRAKE = 1.0, 0.144 * 0.1, 9.8, 0.8
"""Length, m, mass, kg, gravity, m/s^2, and alpha, 1/s."""
SWING_TIMES = (0.3, 0.6)
YIELDING = 5e-7
"""m: rho (g + L p'^2) L^2 / A11 is 4e-7, and rho g L^4 / (8 D11) 2e-6 of a cantilever, a tenth of it of a hinged strip."""
DEGREES = (24, 36)


def _plate(centre: Array, aside: float, kinetic: float, strain: float, rounding: float) -> dict[str, Estimate]:
    values = {f"deflection_{1000 * t:.0f}ms": (u, "m") for t, u in zip(TIMES, centre, strict=True)}
    values |= {
        "oblique_600ms": (OBLIQUE * -aside, "m"),
        "kinetic_energy_300ms": (kinetic, "J"),
        "strain_energy_600ms": (strain, "J"),
    }
    found = {name: Estimate(float(v), float(rounding * abs(v)), unit) for name, (v, unit) in values.items()}
    return {**found, "energy_balance_1200ms": Estimate(0.0, float(rounding * strain), "J")}


def damped_plate() -> dict[str, Estimate]:
    """Known values of cases/damped_plate.toml in closed form."""
    stiffness = float(waves(BENDING, np.array(1.0), np.array(1.0)))
    w = np.sqrt(stiffness / DENSITY)
    z = BY_MASS / (2 * w) + BY_STIFFNESS * w / 2
    v, t = w * np.sqrt(1 - z**2), np.array(TIMES)
    fading = np.exp(-z * w * t)
    u = LOAD / stiffness * (1 - fading * (np.cos(v * t) + z * w / v * np.sin(v * t)))
    rate = LOAD / (DENSITY * v) * fading * np.sin(v * t)
    area = SIDES[0] * SIDES[1] / 4
    shape = np.sin(np.pi * ASIDE[0] / SIDES[0]) * np.sin(np.pi * ASIDE[1] / SIDES[1])
    energies = DENSITY * area * rate[0] ** 2 / 2, stiffness * area * u[1] ** 2 / 2
    return _plate(u, shape * u[1], *energies, STIFFENING)


def damped_plate_by_splines() -> dict[str, Estimate]:
    """Known values of cases/damped_plate.toml by modes of splines."""
    coarse, fine = (_by_splines(spans) for spans in SPANS)
    apart = max(
        abs(fine[name].value - coarse[name].value) / abs(fine[name].value) for name in fine if "balance" not in name
    )
    return {n: Estimate(e.value, (1 + apart / STIFFENING) * e.uncertainty, e.unit) for n, e in fine.items()}


def _by_splines(spans: tuple[int, int]) -> dict[str, Estimate]:
    plate = supported(spans)
    mass = DENSITY * plate.product((0, 0), (0, 0))
    squares, shapes = eigh(plate.stiffness(_matrix(BENDING), 0.0), mass)
    sides = [
        (weight * np.sin(np.pi * line.gauss[0].ravel() / side)) @ line.matrix(line.gauss[0].ravel(), 0) @ kept
        for line, kept, weight, side in zip(plate.lines, plate.kept, plate.weights, SIDES, strict=True)
    ]
    load = LOAD * np.kron(*sides) @ shapes
    states = np.zeros((len(TIMES), 2, len(squares)))
    for k, (square, force) in enumerate(zip(squares, load, strict=True)):
        law = np.array([[0.0, 1.0, 0.0], [-square, -BY_MASS - BY_STIFFNESS * square, force], [0.0, 0.0, 0.0]])
        states[:, :, k] = [expm(t * law)[:2, 2] for t in TIMES]
    at = plate.values([(SIDES[0] / 2, SIDES[1] / 2), ASIDE]) @ shapes
    kinetic, strain = np.sum(states[0, 1] ** 2) / 2, np.sum(squares * states[1, 0] ** 2) / 2
    return _plate(states[:, 0] @ at[0], states[1, 0] @ at[1], kinetic, strain, STIFFENING)


def _pendulum(angles: Array, rate: float, rounding: float) -> dict[str, Estimate]:
    x, z = STRIP * np.cos(angles), -STRIP * np.sin(angles)
    kinetic = MASS * STRIP**2 / 6 * rate**2
    c, s = np.cos(angles[1]), np.sin(angles[1])
    turning = 1.5 * GRAVITY / STRIP * c - BRAKE * rate
    lift = MASS * (GRAVITY - STRIP / 2 * (c * turning - s * rate**2 + BRAKE * c * rate))
    return {
        "tip_x_300ms": Estimate(float(x[0]), YIELDING + rounding, "m"),
        "tip_x_600ms": Estimate(float(x[1]), YIELDING + rounding, "m"),
        "tip_z_600ms": Estimate(float(z[1]), YIELDING + rounding, "m"),
        "kinetic_energy_600ms": Estimate(float(kinetic), float(4 * (YIELDING + rounding) * kinetic), "J"),
        "hinge_z_600ms": Estimate(float(lift), 1e-5 * MASS * GRAVITY, "N"),
    }


def damped_pendulum() -> dict[str, Estimate]:
    """Known values of cases/damped_pendulum.toml by a Runge-Kutta method."""

    def law(t: float, y: Array) -> list[float]:
        return [y[1], 1.5 * GRAVITY / STRIP * np.cos(y[0]) - BRAKE * y[1]]

    until = SWING_TIMES[-1]
    found = solve_ivp(law, (0, until), [0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-13, t_eval=SWING_TIMES)
    return _pendulum(found.y[0], found.y[1, -1], 1e-11)


def damped_pendulum_by_polynomials() -> dict[str, Estimate]:
    """Known values of cases/damped_pendulum.toml by polynomials in time."""
    coarse, fine = (_by_polynomials(degree) for degree in DEGREES)
    return _pendulum(*fine, float(np.abs(fine[0] - coarse[0]).max()))


def _by_polynomials(degree: int) -> tuple[Array, float]:
    """Solve for p = t^2 c(t) at as many Gauss points by Newton's method; return p at the times and p' at the end."""
    until = SWING_TIMES[-1]
    to_unit = chebyshev.Chebyshev([0.0, 1.0], domain=[0.0, until])
    basis = [chebyshev.Chebyshev.basis(k, domain=[0.0, until]) for k in range(degree)]
    factor = (to_unit + 1) ** 2
    functions = [factor * one for one in basis]
    t = until * (1 + np.cos(np.pi * (np.arange(degree) + 0.5) / degree)) / 2
    p, rate, second = (np.stack([(f.deriv(k) if k else f)(t) for f in functions], axis=1) for k in range(3))
    c = np.zeros(degree)
    for _ in range(50):
        gap = second @ c + BRAKE * (rate @ c) - 1.5 * GRAVITY / STRIP * np.cos(p @ c)
        step = np.linalg.solve(second + BRAKE * rate + 1.5 * GRAVITY / STRIP * np.sin(p @ c)[:, None] * p, -gap)
        c = c + step
        if np.abs(step).max() < 1e-13:
            break
    angles = np.array([sum(a * f(s) for a, f in zip(c, functions, strict=True)) for s in SWING_TIMES])
    return angles, float(sum(a * f.deriv()(until) for a, f in zip(c, functions, strict=True)))


JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "damped_plate": damped_plate,
    "damped_pendulum": damped_pendulum,
}
SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {
    "damped_plate": damped_plate_by_splines,
    "damped_pendulum": damped_pendulum_by_polynomials,
}
