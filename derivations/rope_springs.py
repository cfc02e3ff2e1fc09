"""Ropes with springs between chains, and with dampers along links: closed forms and motions, each in two forms.

Two chains of one link of 1 m and 1 kg hang from (0.3, 0, 0) and (-0.3, 0, 0). A spring of 6 N/m and of 0.2 m without
force joins their masses. Each chain is the other one turned by half a circle, so that the spring is horizontal, crosses
the z axis, and is twice as long as a mass' distance rho from it:

    force on a mass  -k (2 rho - r) (x, y, 0)/rho,    potential for each mass  k (2 rho - r)^2 / 4.

A damper pulls a node by -c (v_i - v_{i-1}), and the node before by the reaction. Along a link of fixed length l the
relative velocity is l a' across the link, so that the damper is a moment -c l^2 a' on the link's angle, whatever the
other links do.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

from derivations.estimate import Estimate
from derivations.rope_closed import EXACT, G
from derivations.rope_motion import FALL, after, between, cartesian, hamilton, straight

ROOT, STIFFNESS, REST = 0.3, 6.0, 0.2  # m, N/m, m
THROWN = 1.2  # m/s across the first link, from 20 degrees
DECAY, SPEED = 0.8, 2.0  # kg/s, m/s
LENGTHS, MASSES, DAMPING = (0.3, 0.2, 0.25), (0.5, 2.0, 0.8), 0.6


# At rest: the spring's moment about the root balances the weight's.


def at_rest(sine: float, unsure: float) -> dict[str, Estimate]:
    """Return places of both masses and the tension of a link of this sine toward x."""
    cosine = math.sqrt(1 - sine**2)
    x = ROOT + sine
    found = {"x_1": (x, "m"), "z_1": (-cosine, "m"), "x_2": (-x, "m"), "tension": (G / cosine, "N")}
    return {name: Estimate(value, unsure * max(1.0, abs(value)), unit) for name, (value, unit) in found.items()}


def rest_angle() -> float:
    """Return the angle of the first link toward x, rad: below zero, as the spring draws the masses together."""
    return brentq(lambda a: G * math.tan(a) + STIFFNESS * (2 * (ROOT + math.sin(a)) - REST), -1.0, 0.0, xtol=1e-16)


def rope_lateral_rest() -> dict[str, Estimate]:
    """Return the places and the tension by the angle at which the moments balance."""
    return at_rest(math.sin(rest_angle()), 1e-14)


def rope_lateral_rest_by_a_polynomial() -> dict[str, Estimate]:
    """Return the same by the quartic of the sine s: k^2 (2 (a + s) - r)^2 (1 - s^2) = g^2 s^2."""
    pull = np.poly1d([2 * STIFFNESS, STIFFNESS * (2 * ROOT - REST)])
    quartic = pull * pull * np.poly1d([-1.0, 0.0, 1.0]) - np.poly1d([G**2, 0.0, 0.0])
    real = [float(s.real) for s in quartic.roots if abs(s.imag) < 1e-9 and -1 < s.real < 0]
    (sine,) = (s for s in real if pull(s) > 0)  # of the two that squaring admits, the spring pulls in one
    return at_rest(sine, 1e-12)


# In motion: thrown across the plane of both chains.


def figures_of(place: np.ndarray, velocity: np.ndarray) -> dict[str, tuple[float, str]]:
    """Return the asked values of the first mass' place and velocity."""
    x, y, z = map(float, place)
    return {"x_1": (x, "m"), "y_1": (y, "m"), "z_1": (z, "m"), "x_2": (-x, "m"),
            "speed_2": (float(np.linalg.norm(velocity)), "m/s")}  # fmt: skip


def rope_lateral() -> dict[str, Estimate]:
    """Return places after a second by Newton's law, with the multiplier of the link."""

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        place, velocity = np.split(state, 2)
        rho = math.hypot(place[0], place[1])
        force = np.array([0.0, 0.0, -G]) - STIFFNESS * (2 * rho - REST) / rho * place * [1.0, 1.0, 0.0]
        arm = place - [ROOT, 0.0, 0.0]
        return np.concatenate([velocity, force - (force @ arm + velocity @ velocity) / (arm @ arm) * arm])

    angle = math.radians(20)
    start = np.array([ROOT + math.sin(angle), 0.0, -math.cos(angle), 0.0, THROWN, 0.0])
    return between(lambda tolerance: figures_of(*np.split(after(slope, start, (1.0,), tolerance)[0], 2)))


def rope_lateral_by_hamilton() -> dict[str, Estimate]:
    """Return the same by Hamilton's equations of the link's angle from the vertical and its azimuth."""

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        tilt, turn, p_tilt, p_turn = state
        s, c = math.sin(tilt), math.cos(tilt)
        rho = math.sqrt(ROOT**2 + 2 * ROOT * s * math.cos(turn) + s**2)
        pull = STIFFNESS * (2 * rho - REST) / rho  # dV/drho over rho, and rho drho below
        by_tilt, by_turn = pull * c * (ROOT * math.cos(turn) + s), -pull * ROOT * s * math.sin(turn)
        return np.array([p_tilt, p_turn / s**2, p_turn**2 * c / s**3 - G * s - by_tilt, -by_turn])

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        angle = math.radians(20)
        start = np.array([angle, 0.0, 0.0, math.sin(angle) * THROWN])
        tilt, turn, p_tilt, p_turn = after(slope, start, (1.0,), tolerance)[0]
        s, c = math.sin(tilt), math.cos(tilt)
        place = np.array([ROOT + s * math.cos(turn), s * math.sin(turn), -c])
        return figures_of(place, np.array([p_tilt, p_turn / s, 0.0]))

    return between(figures)


# A damped link without weight: its speed decays by exp(-c t/m).


def rope_decay() -> dict[str, Estimate]:
    """Return speed and place after a second."""
    kept = math.exp(-DECAY)
    angle = SPEED / DECAY * (1 - kept)
    return {
        "speed": Estimate.exact(SPEED * kept, "m/s"),
        "x": Estimate.exact(math.sin(angle), "m"),
        "z": Estimate.exact(-math.cos(angle), "m"),
        "tension": Estimate.exact((SPEED * kept) ** 2, "N"),
    }


def rope_decay_by_newton() -> dict[str, Estimate]:
    """Return the same by Newton's law on the circle."""

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        place, velocity = np.split(y, 2)
        return np.concatenate([velocity, -place * (velocity @ velocity) / (place @ place) - DECAY * velocity])

    y = solve_ivp(slope, (0, 1), [0.0, -1.0, SPEED, 0.0], method="DOP853", rtol=EXACT, atol=EXACT).y[:, -1]
    speed = float(np.linalg.norm(y[2:]))
    found = {"speed": (speed, "m/s"), "x": (y[0], "m"), "z": (y[1], "m"), "tension": (speed**2, "N")}
    return {name: Estimate(float(value), 1e-10, unit) for name, (value, unit) in found.items()}


# Three damped links of unequal lengths and masses, from 40 degrees.


def asked(tip: np.ndarray, kinetic: float, tension: float) -> dict[str, tuple[float, str]]:
    """Return the asked values."""
    return {
        "tip_x": (float(tip[0]), "m"), "tip_z": (float(tip[1]), "m"),
        "kinetic_energy": (float(kinetic), "J"), "tension_1": (float(tension), "N"),
    }  # fmt: skip


def rope_damped() -> dict[str, Estimate]:
    """Return the values after a second by Newton's law with the multipliers of all links."""
    masses = np.array(MASSES)

    def accelerations(x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        dampers = DAMPING * np.diff(v, axis=0, prepend=0, append=v[-1:])
        return cartesian(x, v, masses, FALL + np.diff(dampers, axis=0) / masses[:, None])

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        x, v = state.reshape(2, 3, 2)
        return np.concatenate([v.ravel(), accelerations(x, v)[0].ravel()])

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        start = np.concatenate([straight(LENGTHS, 40).ravel(), np.zeros(6)])
        x, v = after(slope, start, (1.0,), tolerance)[0].reshape(2, 3, 2)
        return asked(x[-1], masses @ (v**2).sum(axis=1) / 2, accelerations(x, v)[1][0])

    return between(figures)


def rope_damped_by_hamilton() -> dict[str, Estimate]:
    """Return the same by angles and momenta, each with its own damper; the tension by the force on all masses."""
    lengths, masses, early = np.array(LENGTHS), np.array(MASSES), 1e-3
    conservative = hamilton(lengths, masses, lambda _: FALL)

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        found = conservative(time, state)
        found[3:] -= DAMPING * lengths**2 * found[:3]
        return found

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        start = np.concatenate([np.full(3, math.radians(40)), np.zeros(3)])
        rows = after(slope, start, tuple(1.0 + early * np.arange(-3, 4)), tolerance)
        rates = np.array([slope(0.0, row)[:3] for row in rows])
        sines, cosines = np.sin(rows[:, :3]), np.cos(rows[:, :3])
        moves = np.cumsum(lengths * rates * np.stack([cosines, sines]), axis=2)  # (2, times, nodes)
        change = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * early) @ (moves @ masses).T
        along, across = np.array([sines[3, 0], -cosines[3, 0]]), moves[:, 3, 0]
        pull = -(change - masses.sum() * FALL + DAMPING * across) @ along  # the root adds tension and damper
        tip = np.array([lengths @ sines[3], -lengths @ cosines[3]])
        return asked(tip, masses @ (moves[:, 3] ** 2).sum(axis=0) / 2, pull)

    found = between(figures)
    tension = found["tension_1"]
    found["tension_1"] = Estimate(tension.value, tension.uncertainty + 1e-7, "N")  # sixth differences, and rounding
    return found


# A row of masses on springs between two pins: the elastic catenary.

ROW = {"springs": 9, "length": 0.1, "stiffness": 2000.0, "mass": 1.0, "span": 0.6}


def hung(span: float = ROW["span"], stiffness: float = ROW["stiffness"]) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (n + 1, 2) and tensions (n,): all springs have one horizontal tension, which spans the pins.

    The vertical part falls by a weight from spring to spring. A spring of tension T is l + T/k long.
    """
    n = int(ROW["springs"])
    upward = ROW["mass"] * G * ((n - 1) / 2 - np.arange(n))

    def steps(horizontal: float) -> np.ndarray:
        tensions = np.hypot(horizontal, upward)
        return (ROW["length"] / tensions + 1 / stiffness)[:, None] * np.stack([np.full(n, horizontal), -upward], axis=1)

    horizontal = brentq(lambda h: steps(h)[:, 0].sum() - span, 1e-9, 1e6, xtol=1e-300, rtol=1e-15)
    nodes = np.vstack([np.zeros(2), np.cumsum(steps(horizontal), axis=0)])
    return nodes, np.hypot(horizontal, upward)


def of_row(nodes: np.ndarray, tensions: np.ndarray, unsure: float) -> dict[str, Estimate]:
    """Return the asked values."""
    found = {
        "sag": (nodes[4, 1], "m"), "first_node_x": (nodes[1, 0], "m"),
        "end_tension": (tensions[0], "N"), "middle_tension": (tensions[4], "N"),
    }  # fmt: skip
    return {name: Estimate(float(value), unsure * max(1.0, abs(value)), unit) for name, (value, unit) in found.items()}


def rope_of_springs() -> dict[str, Estimate]:
    """Return the values of the elastic catenary by its horizontal tension."""
    return of_row(*hung(), 1e-13)


def rope_of_springs_by_forces() -> dict[str, Estimate]:
    """Return the same by the places at which the forces on all masses vanish."""
    n, k, length = int(ROW["springs"]), ROW["stiffness"], ROW["length"]

    def whole(inner: np.ndarray) -> np.ndarray:
        return np.vstack([np.zeros(2), inner.reshape(-1, 2), [ROW["span"], 0.0]])

    def forces(inner: np.ndarray) -> np.ndarray:
        arms = np.diff(whole(inner), axis=0)
        far = np.linalg.norm(arms, axis=1)
        pulls = (k * (far - length) / far)[:, None] * arms
        return (np.diff(pulls, axis=0) - [0.0, ROW["mass"] * G]).ravel()

    part = np.linspace(0, 1, n + 1)[1:-1]
    start = np.stack([ROW["span"] * part, -1.2 * part * (1 - part)], axis=1).ravel()
    nodes = whole(root(forces, start, tol=1e-14).x)
    far = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    return of_row(nodes, k * (far - length), 1e-10)
