"""Ropes whose motion is integrated in time: a pendulum, nine links, and a mass that its link catches.

Judges are by Newton's law in Cartesian coordinates, with the multipliers of all links, and DOP853. Second forms are
elliptic functions and, for nine links, Hamilton's equations in angles. Two tolerances give the uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk, ellipkinc

from derivations.estimate import ROUNDING, Estimate
from derivations.rope_closed import EXACT, G

COARSE = 1e-11
LINKS, LENGTH = 9, 0.1
PERIOD = 4 * math.sqrt(1 / G) * float(ellipk(math.sin(math.radians(30)) ** 2))  # of 60 degrees on 1 m
SURE = 1e-12  # m, or relative: rounding of some thousand steps


def after(slope: Callable, state: np.ndarray, times: tuple[float, ...], tolerance: float) -> np.ndarray:
    """Return states (len(times), n) of an ordinary differential equation."""
    return solve_ivp(slope, (0, times[-1]), state, method="DOP853", t_eval=times, rtol=tolerance, atol=tolerance).y.T


def straight(lengths: tuple[float, ...], degrees: float) -> np.ndarray:
    """Return the nodes (n, 2) of a straight chain from the vertical toward x."""
    a = math.radians(degrees)
    return np.cumsum(lengths)[:, None] * np.array([math.sin(a), -math.cos(a)])


def shaken(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Return place and acceleration (2,) of the root of `rope_unequal_links`."""
    place = np.array([0.1 * math.sin(3 * t), 0.05 * math.sin(5 * t)])
    return place, -np.array([9.0, 25.0]) * place


def cartesian(
    places: np.ndarray, velocities: np.ndarray, masses: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations (n, 2) and tensions (n,) of a chain, relative to its root.

    Other forces give all nodes the acceleration `weight` (2,), or each its own (n, 2).

    Along link i the relative acceleration is -|relative velocity|^2 / length. The matrix is J M^-1 J^T, dense.
    """
    n = len(places)
    arms, apart = np.diff(places, axis=0, prepend=0), np.diff(velocities, axis=0, prepend=0)
    lengths = np.linalg.norm(arms, axis=1)
    along = arms / lengths[:, None]
    jacobian = np.zeros((n, n, 2))
    jacobian[np.arange(n), np.arange(n)] = along
    jacobian[np.arange(1, n), np.arange(n - 1)] = -along[1:]
    jacobian = jacobian.reshape(n, 2 * n)
    moved, twice = jacobian / np.repeat(masses, 2), np.broadcast_to(weight, (n, 2)).ravel()
    tensions = np.linalg.solve(jacobian @ moved.T, jacobian @ twice + np.sum(apart**2, axis=1) / lengths)
    return (twice - moved.T @ tensions).reshape(n, 2), tensions


FALL = np.array([0.0, -G])


def newton(
    places: np.ndarray,
    velocities: np.ndarray,
    times: tuple[float, ...],
    tolerance: float,
    masses: tuple[float, ...] = (),
    weight: Callable[[float], np.ndarray] = lambda _: FALL,
) -> np.ndarray:
    """Return places and velocities (len(times), 2, n, 2) relative to the root; masses are 1 kg if left out."""
    shape, kg = (2, *places.shape), np.array(masses or [1.0] * len(places))

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        x, v = state.reshape(shape)
        return np.concatenate([v.ravel(), cartesian(x, v, kg, weight(time))[0].ravel()])

    state = np.concatenate([places.ravel(), velocities.ravel()])
    return after(slope, state, times, tolerance).reshape(len(times), *shape)


def between(figures: Callable[[float], dict[str, tuple[float, str]]]) -> dict[str, Estimate]:
    """Return figures at the finer tolerance, their distance from the coarser as uncertainty."""
    fine, coarse = figures(EXACT), figures(COARSE)
    return {
        name: Estimate.between(value, coarse[name][0], unit, SURE * max(1.0, abs(value)))
        for name, (value, unit) in fine.items()
    }


def turning(place: np.ndarray, velocity: np.ndarray) -> float:
    """Return the rate of the angle about the origin, from x to z."""
    return float((place[0] * velocity[1] - place[1] * velocity[0]) / (place @ place))


# A pendulum: 1 m, 60 degrees.


def rope_pendulum() -> dict[str, Estimate]:
    """Return its place, rate and tension after one second, and its place after one period."""

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        start = straight((1.0,), 60)
        (x, v), (home, _) = newton(start, np.zeros_like(start), (1.0, PERIOD), tolerance)
        return {
            "x_1s": (float(x[0, 0]), "m"),
            "z_1s": (float(x[0, 1]), "m"),
            "rate_1s": (turning(x[0], v[0]), "rad/s"),
            "tension_1s": (float(cartesian(x, v, np.ones(len(x)), FALL)[1][0]), "N"),
            "x_period": (float(home[0, 0]), "m"),
        }

    return between(figures)


def rope_pendulum_by_elliptic_functions() -> dict[str, Estimate]:
    """Return the same by sin(a/2) = k cd(w t)."""
    k, w = math.sin(math.radians(30)), math.sqrt(G)
    sn, cn, dn, _ = map(float, ellipj(w, k * k))
    angle = 2 * math.asin(k * cn / dn)
    rate = -2 * k * w * (1 - k * k) * sn / dn**2 / math.sqrt(1 - (k * cn / dn) ** 2)
    figures = {
        "x_1s": (math.sin(angle), "m"),
        "z_1s": (-math.cos(angle), "m"),
        "rate_1s": (rate, "rad/s"),
        "tension_1s": (G * math.cos(angle) + rate**2, "N"),
        "x_period": (math.sin(math.radians(60)), "m"),
    }
    return {name: Estimate(value, 1e-11 * max(1.0, abs(value)), unit) for name, (value, unit) in figures.items()}


# Links of 0.1 m and 1 kg each, from 30 degrees.


@cache
def swung(links: int, at: float) -> dict[str, Estimate]:
    """Return the tip and the tension at the root after a time, s, and the energy."""

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        start = straight((LENGTH,) * links, 30)
        ((x, v),) = newton(start, np.zeros_like(start), (at,), tolerance)
        return {
            "tip_x": (float(x[-1, 0]), "m"),
            "tip_z": (float(x[-1, 1]), "m"),
            "tension_1": (float(cartesian(x, v, np.ones(len(x)), FALL)[1][0]), "N"),
        }

    energy = -G * LENGTH * math.cos(math.radians(30)) * links * (links + 1) / 2
    return {**between(figures), "energy": Estimate.exact(energy, "J")}


def rope_nine_links() -> dict[str, Estimate]:
    """Return the values of nine links after one second, without any stretch."""
    return {**swung(LINKS, 1.0), "stretch": Estimate(0.0, 0.0, "")}


def hamilton(
    lengths: np.ndarray, masses: np.ndarray, weight: Callable[[float], np.ndarray]
) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return the rate of angles and their momenta (2 n,): a' = A^-1 p, p' = -dH/da, in the frame of the root."""
    beyond = np.cumsum(masses[::-1])[::-1]
    number = np.arange(len(masses))
    arms = beyond[np.maximum.outer(number, number)] * np.outer(lengths, lengths)

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        angles, momenta = np.split(state, 2)
        apart, (sideways, up) = np.subtract.outer(angles, angles), weight(time)
        rates = np.linalg.solve(arms * np.cos(apart), momenta)
        turned = -rates * ((arms * np.sin(apart)) @ rates)
        return np.concatenate([rates, turned + beyond * lengths * (sideways * np.cos(angles) + up * np.sin(angles))])

    return slope


@cache
def swung_by_hamilton(links: int, at: float) -> dict[str, Estimate]:
    """Return the same by angles and momenta; the tension from the acceleration of all masses, by differences in time."""
    early = 1e-3  # s between states around the time

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        start = np.concatenate([np.full(links, math.radians(30)), np.zeros(links)])
        marks = tuple(at + early * np.arange(-3, 4))
        slope = hamilton(np.full(links, LENGTH), np.ones(links), lambda _: FALL)
        rows = after(slope, start, marks, tolerance)
        rates = np.array([slope(0.0, row)[:links] for row in rows])
        angles, shares = rows[:, :links], LENGTH * np.arange(links, 0, -1)
        momentum = np.stack(
            [(rates * np.cos(angles)) @ shares, (rates * np.sin(angles)) @ shares], axis=1
        )  # of all masses
        change = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * early) @ momentum
        pull = np.linalg.norm(change - [0.0, -G * links])  # what the root adds to the weight
        now, kinetic = angles[3], 0.5 * rows[3, links:] @ rates[3]
        depth = -G * LENGTH * np.arange(links, 0, -1) @ np.cos(now)
        return {
            "tip_x": (LENGTH * float(np.sin(now).sum()), "m"),
            "tip_z": (-LENGTH * float(np.cos(now).sum()), "m"),
            "tension_1": (float(pull), "N"),
            "energy": (float(kinetic + depth), "J"),
        }

    found = between(figures)
    tension = found["tension_1"]
    found["tension_1"] = Estimate(tension.value, tension.uncertainty + 1e-7, "N")  # sixth differences, and rounding
    energy = found["energy"]
    found["energy"] = Estimate(energy.value, energy.uncertainty + 1e-11, "J")
    return found


def rope_nine_links_by_hamilton() -> dict[str, Estimate]:
    """Return the same by angles and momenta."""
    return {**swung_by_hamilton(LINKS, 1.0), "stretch": Estimate(0.0, 1e-15, "")}


# Many of them around the vertical, their roots on a circle: each swings in the plane through the axis.

SKIRT, CROWD = (26, 0.2), 2.0  # chains and the circle's radius, m; that of crowds
ASKED = 7  # number of the skirt's chain that is asked; of crowds it is an eighth of the circle


def around(swing: dict[str, Estimate], chains: int, radius: float, part: float) -> dict[str, Estimate]:
    """Return where the tip of a chain is, a part of the circle from the first, its tension, and the energy of all."""
    out, up, energy = radius + swing["tip_x"].value, swing["tip_z"], swing["energy"]
    near = complex(math.cos(2 * math.pi * part), math.sin(2 * math.pi * part)) * out
    unsure = swing["tip_x"].uncertainty + ROUNDING * out
    return {
        "tip_x": Estimate(near.real, unsure, "m"),
        "tip_y": Estimate(near.imag, unsure, "m"),
        "tip_z": up,
        "tension": swing["tension_1"],
        "energy": Estimate(chains * energy.value, chains * energy.uncertainty, "J"),
    }


def rope_skirt() -> dict[str, Estimate]:
    """Return the values of 26 chains of nine links after one second."""
    return around(swung(LINKS, 1.0), *SKIRT, ASKED / SKIRT[0])


def rope_skirt_by_hamilton() -> dict[str, Estimate]:
    """Return the same by angles and momenta."""
    return around(swung_by_hamilton(LINKS, 1.0), *SKIRT, ASKED / SKIRT[0])


def rope_crowd(chains: int) -> dict[str, Estimate]:
    """Return the values of many chains of 13 links after a quarter of a second."""
    return around(swung(13, 0.25), chains, CROWD, 1 / 8)


def rope_crowd_by_hamilton(chains: int) -> dict[str, Estimate]:
    """Return the same by angles and momenta."""
    return around(swung_by_hamilton(13, 0.25), chains, CROWD, 1 / 8)


# Four links of unequal lengths and masses, from 20 degrees, whose root is shaken.

LENGTHS, MASSES = (0.3, 0.2, 0.25, 0.15), (0.5, 2.0, 0.8, 1.5)
KICK = np.array([0.3, 0.25])  # velocity of the root at the start, m/s


def felt(time: float) -> np.ndarray:
    """Return the acceleration (2,) that masses feel in the frame of the shaken root."""
    return FALL - shaken(time)[1]


def rope_unequal_links() -> dict[str, Estimate]:
    """Return the tip and the tensions of the first and the last link after one second."""

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        start = straight(LENGTHS, 20)
        along = start[0] / LENGTHS[0]  # all masses start with what the root has along the chain
        velocities = np.tile((KICK @ along) * along - KICK, (len(LENGTHS), 1))
        ((x, v),) = newton(start, velocities, (1.0,), tolerance, MASSES, felt)
        tensions = cartesian(x, v, np.array(MASSES), felt(1.0))[1]
        tip = x[-1] + shaken(1.0)[0]
        return {
            "tip_x": (float(tip[0]), "m"),
            "tip_z": (float(tip[1]), "m"),
            "tension_1": (float(tensions[0]), "N"),
            "tension_4": (float(tensions[3]), "N"),
        }

    return between(figures)


def rope_unequal_links_by_hamilton() -> dict[str, Estimate]:
    """Return the same by angles and momenta; tensions from the acceleration of masses, by differences in time."""
    early = 1e-3
    lengths, masses = np.array(LENGTHS), np.array(MASSES)

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        slope = hamilton(lengths, masses, felt)
        angle = math.radians(20)
        across = np.array([math.cos(angle), math.sin(angle)])
        beyond = np.cumsum(masses[::-1])[::-1]
        momenta = lengths * beyond * float(-KICK @ across)
        marks = tuple(1.0 + early * np.arange(-3, 4))
        rows = after(slope, np.concatenate([np.full(4, angle), momenta]), marks, tolerance)
        rates = np.array([slope(t, row)[:4] for t, row in zip(marks, rows, strict=True)])
        sines, cosines = np.sin(rows[:, :4]), np.cos(rows[:, :4])
        moves = np.cumsum(lengths * rates * np.stack([cosines, sines]), axis=2)  # (2, times, nodes)
        change = np.einsum("t,ctn->cn", np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * early), moves)
        pulls = np.linalg.norm(np.cumsum((masses * (change - felt(1.0)[:, None]))[:, ::-1], axis=1), axis=0)
        tip = shaken(1.0)[0] + [lengths @ sines[3], -lengths @ cosines[3]]
        return {
            "tip_x": (float(tip[0]), "m"),
            "tip_z": (float(tip[1]), "m"),
            "tension_1": (float(pulls[3]), "N"),
            "tension_4": (float(pulls[0]), "N"),
        }

    found = between(figures)
    for name in ("tension_1", "tension_4"):
        found[name] = Estimate(found[name].value, found[name].uncertainty + 1e-7, "N")
    return found


# A mass on a link of 1 m, thrown from (0.2, 0) with 2 m/s along x, until the link is taut, and on.


def caught() -> tuple[float, float, float]:
    """Return the time, s, the angle from the vertical toward x and its rate, rad/s, when the link is taut."""
    at = brentq(lambda t: (0.2 + 2 * t) ** 2 + (G * t * t / 2) ** 2 - 1, 0.0, 0.4, xtol=1e-16)
    x, z = 0.2 + 2 * at, -G * at * at / 2
    return at, math.atan2(x, -z), x * (-G * at) - z * 2.0


def rope_catch() -> dict[str, Estimate]:
    """Return place and rate one second after the throw; the rate after the jerk is what was across the link."""

    def figures(tolerance: float) -> dict[str, tuple[float, str]]:
        at, angle, rate = caught()
        place = np.array([[math.sin(angle), -math.cos(angle)]])
        velocity = rate * np.array([[math.cos(angle), math.sin(angle)]])
        ((x, v),) = newton(place, velocity, (1.0 - at,), tolerance)
        return {"x": (float(x[0, 0]), "m"), "z": (float(x[0, 1]), "m"), "rate": (turning(x[0], v[0]), "rad/s")}

    return between(figures)


def rope_catch_by_elliptic_functions() -> dict[str, Estimate]:
    """Return the same by sin(a/2) = k sn(w (t - t0)), where k^2 is the energy over 2 g."""
    at, angle, rate = caught()
    w = math.sqrt(G)
    k2 = (rate**2 / 2 + G * (1 - math.cos(angle))) / (2 * G)
    k = math.sqrt(k2)
    phase = float(ellipkinc(math.asin(math.sin(angle / 2) / k), k2))
    phase = phase if rate > 0 else 2 * float(ellipk(k2)) - phase
    sn, cn, _, _ = map(float, ellipj(phase + w * (1.0 - at), k2))
    later = 2 * math.asin(k * sn)
    figures = {"x": (math.sin(later), "m"), "z": (-math.cos(later), "m"), "rate": (2 * k * w * cn, "rad/s")}
    return {name: Estimate(value, 1e-11 * max(1.0, abs(value)), unit) for name, (value, unit) in figures.items()}
