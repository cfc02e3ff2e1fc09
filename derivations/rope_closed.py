"""Ropes and loose masses whose motion has a closed form, and a second form of each.

The cases repeat those of section 3 to 6 of Jin et al., "A Neural-Network-Based Approach for Loose-Fitting Clothing":
weights, a root that falls with its chain, a circle, jerks, a mass that falls until its link is taut, a chain in the
wind; and masses that meet a ball, a plate and an incline. Data of cases are repeated here on purpose.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, nnls

from derivations.estimate import ROUNDING, Estimate

G = 9.81
EXACT = 1e-13  # relative: the tolerance of integrations, as small as DOP853 takes it
NINE = 0.1  # length of each of nine links, m
STATIC = (1.37, 0.52, 2.81, 0.24, 1.96, 0.73, 2.35, 0.41, 2.08)  # masses, kg
JERK_MASSES = (0.8, 2.1, 0.4, 1.7, 0.9)
JERK_PLACES = ((0.1, 0.0, -0.2), (0.3, 0.1, -0.3), (0.35, 0.15, -0.5), (0.2, 0.3, -0.6), (0.2, 0.4, -0.8))
JERK_VELOCITIES = ((1.0, 0.3, -1.2), (0.4, -0.8, 0.5), (2.0, 1.0, -0.7), (-0.6, 0.9, 1.1), (0.7, -1.5, -2.0))
WIND, DRAG = 4.0, 0.5
OFFSETS = {1: 0.2, 3: 0.6, 4: 0.8, 5: 0.95}  # of the masses that are asked, over the ball's radius
SLOPE, SLIDING = math.radians(30), 0.3


def zero(unit: str) -> Estimate:
    """Return a figure that is zero by symmetry or by a law of conservation."""
    return Estimate(0.0, 0.0, unit)


def length_of(vector: np.ndarray) -> float:
    """Return a length."""
    return float(np.linalg.norm(vector))


def multipliers(directions: np.ndarray, masses: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the pulls (n,) for which relative accelerations along links are -right, by the dense J M^-1 J^T."""
    n = len(masses)
    jacobian = np.zeros((n, 3 * n))
    for i in range(n):
        jacobian[i, 3 * i : 3 * i + 3] = directions[i]
        if i:
            jacobian[i, 3 * i - 3 : 3 * i] = -directions[i]
    return np.linalg.solve(jacobian @ (jacobian / np.repeat(masses, 3)).T, right)


# A chain at rest: what is below.


def rope_static() -> dict[str, Estimate]:
    """Return tensions of links 1, 5 and 9: the weight of all masses below."""
    below = np.cumsum(STATIC[::-1])[::-1] * G
    return {f"tension_{link}": Estimate.exact(float(below[link - 1]), "N") for link in (1, 5, 9)}


def rope_static_by_multipliers() -> dict[str, Estimate]:
    """Return the same by the multipliers of all constraints at once."""
    down = np.tile([0.0, 0.0, -1.0], (9, 1))
    found = multipliers(down, np.array(STATIC), np.array([G] + [0.0] * 8))
    return {f"tension_{link}": Estimate(found[link - 1], 1e-12 * found[link - 1], "N") for link in (1, 5, 9)}


# A root that falls with its chain: nothing pulls.


def rope_falling_root() -> dict[str, Estimate]:
    """Return no tensions, and a tip that falls freely for half a second."""
    tensions = {f"tension_{link}": zero("N") for link in (1, 5, 9)}
    return {**tensions, "tip_z": Estimate.exact(-9 * NINE - G * 0.5**2 / 2, "m")}


def rope_falling_root_by_multipliers() -> dict[str, Estimate]:
    """Return the same by multipliers, and the tip by Newton's law over time."""
    down, masses = np.tile([0.0, 0.0, -1.0], (9, 1)), np.array([1.0] * 8 + [5.0])
    found = multipliers(down, masses, np.zeros(9))  # relative to the root nothing accelerates
    fall = solve_ivp(lambda _, y: [y[1], -G], (0, 0.5), [-9 * NINE, 0.0], method="DOP853", rtol=EXACT, atol=EXACT)
    tensions = {f"tension_{link}": Estimate(float(found[link - 1]), 1e-14, "N") for link in (1, 5, 9)}
    return {**tensions, "tip_z": Estimate(float(fall.y[0, -1]), 1e-12, "m")}


# A mass that circles with 2 m/s on a link of 1 m without weight, from straight down toward x.


def rope_circle() -> dict[str, Estimate]:
    """Return place, speed and tension after one second."""
    return {
        "speed": Estimate.exact(2.0, "m/s"),
        "x": Estimate.exact(math.sin(2.0), "m"),
        "z": Estimate.exact(-math.cos(2.0), "m"),
        "tension": Estimate.exact(4.0, "N"),
    }


def rope_circle_by_newton() -> dict[str, Estimate]:
    """Return the same by Newton's law under the force that keeps it on the circle."""

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[2:], -y[:2] * (y[2:] @ y[2:]) / (y[:2] @ y[:2])])

    y = solve_ivp(slope, (0, 1), [0.0, -1.0, 2.0, 0.0], method="DOP853", rtol=EXACT, atol=EXACT).y[:, -1]
    sure = 1e-11
    speed = length_of(y[2:])
    figures = {"speed": (speed, "m/s"), "x": (y[0], "m"), "z": (y[1], "m"), "tension": (speed**2, "N")}
    return {name: Estimate(float(value), sure * 10, unit) for name, (value, unit) in figures.items()}


# A jerk: velocities that would stretch links, and what is left of them.


def jerk_parts() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return J (5, 15), velocities (15,) and masses (15,)."""
    places = np.vstack([np.zeros(3), JERK_PLACES])
    jacobian = np.zeros((5, 15))
    for i, link in enumerate(np.diff(places, axis=0)):
        along = link / np.linalg.norm(link)
        jacobian[i, 3 * i : 3 * i + 3] = along
        if i:
            jacobian[i, 3 * i - 3 : 3 * i] = -along
    return jacobian, np.ravel(JERK_VELOCITIES), np.repeat(JERK_MASSES, 3)


def jerk_figures(velocities: np.ndarray, uncertainty: float) -> dict[str, Estimate]:
    """Return the values from velocities after the jerk."""
    masses = np.repeat(JERK_MASSES, 3)
    figures = {
        "kinetic_energy": (0.5 * float(masses @ velocities**2), "J"),
        "tip_speed": (length_of(velocities[12:]), "m/s"),
        "momentum_x": (float(masses[::3] @ velocities[::3]), "kg m/s"),
        "momentum_z": (float(masses[::3] @ velocities[2::3]), "kg m/s"),
    }
    return {name: Estimate(value, uncertainty * abs(value), unit) for name, (value, unit) in figures.items()}


def rope_jerk() -> dict[str, Estimate]:
    """Return the velocities nearest in energy by which no link grows: by trying all sets of links that pull."""
    jacobian, velocities, masses = jerk_parts()
    found = []
    for pulls in product((False, True), repeat=5):
        rows = jacobian[np.array(pulls)]
        strengths = np.linalg.solve(rows @ (rows / masses).T, rows @ velocities) if any(pulls) else np.zeros(0)
        after = velocities - (rows.T @ strengths) / masses
        if np.all(strengths >= 0) and np.all(jacobian @ after <= 1e-13):
            found.append(after)
    (after,) = found  # one and no more
    return jerk_figures(after, 1e-13)


def rope_jerk_by_least_squares() -> dict[str, Estimate]:
    """Return the same by non-negative least squares over the strengths of pulls."""
    jacobian, velocities, masses = jerk_parts()
    scaled = jacobian.T / np.sqrt(masses)[:, None]
    strengths, _ = nnls(scaled, np.sqrt(masses) * velocities)
    return jerk_figures(velocities - (jacobian.T @ strengths) / masses, 1e-11)


# A mass dropped 0.1 m below its root, on a link of 1 m.


def rope_drop() -> dict[str, Estimate]:
    """Return its height in the fall, and where and how fast it is once the link is taut."""
    return {
        "z_300ms": Estimate.exact(-0.1 - G * 0.3**2 / 2, "m"),
        "z_1s": Estimate.exact(-1.0, "m"),
        "speed_1s": zero("m/s"),
    }


def rope_drop_by_time() -> dict[str, Estimate]:
    """Return the same by Newton's law until the link is taut, when all that is left is a rest."""

    def reached(_: float, y: np.ndarray) -> float:
        return float(y[0] + 1.0)

    reached.terminal = True  # type: ignore[attr-defined]
    fall = solve_ivp(lambda _, y: [y[1], -G], (0, 1), [-0.1, 0.0], method="DOP853", rtol=EXACT, atol=EXACT,
                     t_eval=[0.3], events=reached)  # fmt: skip
    rest = float(fall.y_events[0][0, 0])
    return {
        "z_300ms": Estimate(float(fall.y[0, 0]), 1e-12, "m"),
        "z_1s": Estimate(rest, 1e-12, "m"),
        "speed_1s": Estimate(0.0, 1e-14, "m/s"),
    }


# Nine links in the wind: a straight line along the force on each mass.


def rope_wind(links: int = 9) -> dict[str, Estimate]:
    """Return the tension at the root and the tip's place, which stay."""
    force = math.hypot(DRAG * WIND, G)
    return {
        "tension_1": Estimate.exact(links * force, "N"),
        "tip_x": Estimate.exact(links * NINE * DRAG * WIND / force, "m"),
        "tip_z": Estimate.exact(-links * NINE * G / force, "m"),
    }


def rope_wind_by_moments(links: int = 9) -> dict[str, Estimate]:
    """Return the same: the angle at which the moment of all forces about the root vanishes, and multipliers."""
    arms = NINE * np.arange(1, links + 1)
    angle = brentq(lambda a: float(np.sum(arms * (DRAG * WIND * math.cos(a) - G * math.sin(a)))), 0, 1, xtol=1e-15)
    along = np.array([math.sin(angle), 0.0, -math.cos(angle)])
    pull = np.array([along @ [DRAG * WIND, 0.0, -G]] + [0.0] * (links - 1))
    tension = float(multipliers(np.tile(along, (links, 1)), np.ones(links), pull)[0])
    tip = links * NINE * along
    return {
        "tension_1": Estimate(tension, 1e-12 * tension, "N"),
        "tip_x": Estimate(float(tip[0]), 1e-13, "m"),
        "tip_z": Estimate(float(tip[2]), 1e-13, "m"),
    }


# A ball of radius 1 m passes with 1 m/s through masses at rest, from 0.5 m before them, for 1.5 s.


def ball_figures(place: dict[int, tuple[float, float]], uncertainty: float) -> dict[str, Estimate]:
    """Return places by number of the mass as what is asked."""
    found = {"penetration": Estimate(0.0, 0.0, "m")}
    for number, (x, y) in place.items():
        found |= {f"x_{number}": Estimate(x, uncertainty, "m"), f"y_{number}": Estimate(y, uncertainty, "m")}
    return found


def rope_ball() -> dict[str, Estimate]:
    """Return where masses are that get the ball's normal velocity, and fly off along it: c = cos, s = sin at impact."""
    places = {}
    for number, s in OFFSETS.items():
        c = math.sqrt(1 - s * s)
        places[number] = (c**3, s + c * c * s)
    return ball_figures(places, ROUNDING)


def rope_ball_from_the_ball() -> dict[str, Estimate]:
    """Return the same, seen from the ball: masses come with -1 m/s, keep what is along the surface, and leave by it."""
    places = {}
    for number, offset in OFFSETS.items():
        hit = brentq(lambda t, y=offset: (1.5 - t) ** 2 + y * y - 1.0, 0.5, 1.5, xtol=1e-15)
        normal = np.array([1.5 - hit, offset])
        coming = np.array([-1.0, 0.0])
        sliding = coming - (coming @ normal) * normal
        x, y = normal + sliding * (1.5 - hit)
        places[number] = (float(x), float(y))
    return ball_figures(places, 1e-12)


# A plate of half thickness 8 mm that masses meet with 3 m/s: none gets through.


def rope_plate() -> dict[str, Estimate]:
    """Return that all masses rest on the face that they met."""
    return {"share_beyond": zero(""), "first_x": Estimate.exact(-0.008, "m")}


def rope_plate_by_time() -> dict[str, Estimate]:
    """Return the same by the time at which the first mass reaches the face."""
    arrives = (0.1 - 0.008 - 0.000005) / 3.0
    assert arrives < 0.1
    return {"share_beyond": Estimate(0.0, 1e-9, ""), "first_x": Estimate(-0.1 + 0.000005 + 3.0 * arrives, 1e-14, "m")}


# A mass on an incline of 30 degrees.


def incline_figures(path: float, uncertainty: float) -> dict[str, Estimate]:
    """Return place and depth of a mass that has gone a way down, m."""
    return {
        "x": Estimate(path * math.cos(SLOPE), uncertainty, "m"),
        "z": Estimate(-path * math.sin(SLOPE), uncertainty, "m"),
        "penetration": zero("m"),
    }


def rope_incline_slides() -> dict[str, Estimate]:
    """Return where it is after one second with a coefficient of friction of 0.3."""
    return incline_figures(G * (math.sin(SLOPE) - SLIDING * math.cos(SLOPE)) / 2, ROUNDING)


def rope_incline_slides_by_energy() -> dict[str, Estimate]:
    """Return the same: the way s after which v^2/2 = s (g sin - mu g cos), with v = 2 s / t for a steady force."""
    gained = G * math.sin(SLOPE) - SLIDING * G * math.cos(SLOPE)
    path = brentq(lambda s: (2 * s) ** 2 / 2 - s * gained, 0.1, 10.0, xtol=1e-15)
    return incline_figures(path, 1e-12)


def rope_incline_sticks() -> dict[str, Estimate]:
    """Return that it stays with a coefficient of 0.7, which is more than tan 30 degrees."""
    return {"x": zero("m"), "z": zero("m"), "speed": zero("m/s")}


def rope_incline_sticks_by_cone() -> dict[str, Estimate]:
    """Return the same: the force that holds it, -M g, lies in the cone about the normal of half angle atan mu."""
    normal = np.array([math.sin(SLOPE), math.cos(SLOPE)])
    held = np.array([0.0, G])
    assert held @ normal / length_of(held) > math.cos(math.atan(0.7))
    return {"x": Estimate(0.0, 1e-14, "m"), "z": Estimate(0.0, 1e-14, "m"), "speed": Estimate(0.0, 1e-14, "m/s")}
