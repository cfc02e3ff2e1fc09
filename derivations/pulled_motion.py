r"""A plate that is stretched alike everywhere, in motion: cases/pulled_motion.toml.

With e = s(t) / L along the pull and none across, the strain is E11 = e + e^2/2, the force an edge (1 + e) D E11 along it,
and the energy D E11^2 / 2 an area, D = E h, without contraction. Its divergence is zero: the load is density times acceleration.

The second form is a chain of bars between masses under the case's own load, pulled in time; no strain is taken to be even.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from shellbench.problems.shell.case import read_case

from .estimate import Estimate
from .manufactured import CASES
from .surface_strains import Array

LENGTH, WIDTH, LOWER = 1.0, 0.6, -0.4
STRETCHING, DENSITY, PULL = 5000 * 0.01, 2.5, 1.5  # D, rho, and s = PULL t^2
FRAME = np.array([[2.0, 1.0, 2.0], [-2.0, 2.0, 1.0]]) / 3
ASKEW, ACROSS, AXIS = (np.array(v) / np.linalg.norm(v) for v in ([1.0, 3.0, -1.0], [1.0, 2.0, 0.0], [2.0, -1.0, 2.0]))
CENTRE, PLACES = np.array([0.2, -0.5, 0.3]), np.array([0.7, 0.3])
TIMES = (0.01, 0.137, 0.2)
BARS, TOLERANCE, INTEGRATED = 10, 1e-12, 1e-9
"""Bars of the chain, tolerance of the Runge-Kutta method, and what it leaves, relative."""


def _force(e: Array) -> Array:
    return np.asarray(STRETCHING * WIDTH * (1 + e) * (e + e**2 / 2))


def _values(moved: Array, kinetic: Array, membrane: Array, pull: float, wall: float, lost: Array, error: float) -> dict[str, Estimate]:  # fmt: skip
    """Return the values from displacements along the pull, energies and losses, J, at the times, and the ends' forces, N."""
    arm = (LOWER + WIDTH / 2) * FRAME[1] - CENTRE
    numbers = {"pull_137ms": (pull * float(FRAME[0] @ ACROSS), "N")}
    numbers["energy_balance_10ms"], numbers["energy_balance_200ms"] = (lost[0], "J"), (lost[-1], "J")
    numbers["wall_moment_200ms"] = (wall * float(np.cross(arm, FRAME[0]) @ AXIS), "N m")
    for k, label in enumerate(("137ms", "200ms"), start=1):
        numbers[f"mean_oblique_{label}"] = (float(moved[k].mean() * (FRAME[0] @ ASKEW)), "m")
        numbers[f"kinetic_energy_{label}"] = (float(kinetic[k]), "J")
        numbers[f"membrane_energy_{label}"] = (float(membrane[k]), "J")
    scales = {f"energy_balance_{label}": float(kinetic[k] + membrane[k]) for k, label in ((0, "10ms"), (2, "200ms"))}
    return {
        name: Estimate(value, error * scales.get(name, abs(value)), unit) for name, (value, unit) in numbers.items()
    }


def pulled_motion() -> dict[str, Estimate]:
    """Known values in closed form."""
    t = np.array(TIMES)
    e, rate = PULL * t**2 / LENGTH, 2 * PULL * t / LENGTH
    membrane = STRETCHING * LENGTH * WIDTH * (e + e**2 / 2) ** 2 / 2
    kinetic = DENSITY * WIDTH * LENGTH**3 / 6 * rate**2
    force = _force(e)
    return _values(e[:, None] * PLACES, kinetic, membrane, float(force[1]), -float(force[2]), np.zeros(3), 1e-12)


def pulled_motion_of_a_chain() -> dict[str, Estimate]:
    """Known values by a chain under the load and the pull that the case declares."""
    case = read_case(CASES / "pulled_motion.toml")
    side, x = LENGTH / BARS, np.linspace(0, LENGTH, BARS + 1)
    load = case.evaluate(case.loads[0].vector, np.stack([x, np.zeros(BARS + 1)], -1))[0, 0] @ FRAME[0]
    mass = np.zeros((BARS + 1, BARS + 1))
    for k in range(BARS):
        mass[k : k + 2, k : k + 2] += DENSITY * WIDTH * side / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
    forces = mass @ load / DENSITY
    inner = slice(1, BARS)

    def driven(t: float) -> tuple[float, float, float]:
        s = [float(case.evaluate(case.supports[1].motion.vector, x[:1, None].repeat(2, 1), u)[0, 0][0] @ FRAME[0]) for u in (t, 1.0)]  # fmt: skip
        return s[0], 2 * s[1] * t, 2 * s[1]  # it grows as t^2

    def pulled(q: Array) -> Array:
        tension = _force(np.diff(q) / side)
        return np.concatenate([tension, [0.0]]) - np.concatenate([[0.0], tension])

    def rates(t: float, state: Array) -> Array:
        q, v = np.split(state[:-1], 2)
        s, speed, acceleration = driven(t)
        whole = np.array([0.0, *q, s])
        right = (forces + pulled(whole))[inner] - mass[inner, -1] * acceleration
        a = np.linalg.solve(mass[inner, inner], right)
        pull = (mass @ [0.0, *a, acceleration] - forces - pulled(whole))[-1]
        return np.concatenate([v, a, [pull * speed + forces @ [0.0, *v, speed]]])  # the last one is power

    found = solve_ivp(rates, (0, TIMES[-1]), np.zeros(2 * BARS - 1), "DOP853", TIMES, rtol=TOLERANCE, atol=TOLERANCE)
    moved, kinetic, membrane, lost, ends = [], [], [], [], []
    for t, state in zip(TIMES, found.y.T, strict=True):
        s, speed, acceleration = driven(t)
        parts, rate = np.split(state[:-1], 2)
        q, v = np.array([0.0, *parts, s]), np.array([0.0, *rate, speed])
        a = np.array([0.0, *rates(t, state)[BARS - 1 : -1], acceleration])
        strain = np.diff(q) / side
        moved.append(np.interp(PLACES, x, q))
        kinetic.append(v @ mass @ v / 2)
        membrane.append(STRETCHING * WIDTH * side * np.sum((strain + strain**2 / 2) ** 2) / 2)
        lost.append(abs(kinetic[-1] + membrane[-1] - state[-1]))
        ends.append(mass @ a - forces - pulled(q))
    return _values(np.array(moved), np.array(kinetic), np.array(membrane), float(ends[1][-1]), float(ends[2][0]), np.array(lost), INTEGRATED)  # fmt: skip
