r"""Patches that slide and fall on something rigid: cases/contact_patch_*.toml.

Nothing strains them, so that each is a point mass. On the incline (3 : 4), with the acceleration c t of a pull uphill,

    s'' = g (3/5) - mu g (4/5) - c t      until it stops at T = 2 (3 - 4 mu) g / 5 c,
    s'' = g (3/5) + mu g (4/5) - c t < 0  after t = (3 + 4 mu) g / 5 c,

and it sticks in between. It falls by g t^2 / 2 until it meets the floor, which is at h + a t^2 / 2 with h < 0, and
then moves with it, pressed by m (g + a).

Springs k per area of the weight's direction leave the vertical force m g - k A s sin(theta) of a patch that has slid by s down an
incline of the angle theta. Both parts of it go with it, so that

    s'' = (g - k s sin(theta) / rho) (sin(theta) - mu cos(theta)),    s = s0 (1 - cos(omega t)),

with s0 = rho g / (k sin(theta)) and omega^2 = k sin(theta) (sin(theta) - mu cos(theta)) / rho. The patch is pressed as long as
omega t < pi / 2.

The second form integrates Newton's law of a point mass (SciPy's DOP853): piece by piece, each until an event ends it, and in space on the
oblique incline. Forces of what slides or rests are statics in both forms.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from .estimate import Estimate

GRAVITY, DENSITY, AREA = 10.0, 0.2, 0.4 * 0.1  # m/s^2, kg/m^2, m^2
MASS = DENSITY * AREA
FRICTION, PULL = 0.5, 2.6 / DENSITY  # coefficient, and c, m/s^3
ALONG, ACROSS = 0.6 * GRAVITY, 0.8 * GRAVITY  # the incline
HEIGHT, RISE = 0.3, 2.0  # m, and m/s^2
SPRINGS, RUBBED = 6.0, 0.3  # N/m^3, and the coefficient of friction of the patch on springs
STEEP, LEVEL = np.sqrt(13.0) / 7, 6 / 7  # sine and cosine of its incline, normal to (2, 3, 6)
EXACT, INTEGRATED_TO, NOTHING = 1e-13, 1e-9, 1e-12

Array = NDArray[np.float64]
State = tuple[float, float, float]
"""Way, m, velocity, m/s, and force, N: of friction uphill, or of the floor, or the vertical one of the oblique incline."""


def slide(t: float) -> State:
    """Return the patch on the incline."""
    rubbed = FRICTION * ACROSS
    stop, back = 2 * (ALONG - rubbed) / PULL, (ALONG + rubbed) / PULL

    def down(t: float) -> float:
        return (ALONG - rubbed) * t**2 / 2 - PULL * t**3 / 6

    if t < stop:
        return down(t), (ALONG - rubbed) * t - PULL * t**2 / 2, MASS * rubbed
    if t < back:
        return down(stop), 0.0, MASS * (ALONG - PULL * t)
    late = t - back
    return down(stop) - PULL * late**3 / 6, -PULL * late**2 / 2, -MASS * rubbed


def fall(t: float) -> State:
    """Return the patch above the floor and on it."""
    if t < np.sqrt(2 * HEIGHT / (GRAVITY + RISE)):
        return GRAVITY * t**2 / 2, GRAVITY * t, 0.0
    return HEIGHT - RISE * t**2 / 2, -RISE * t, MASS * (GRAVITY + RISE)


def slide_integrated(t: float) -> State:
    """Return the same of Newton's law, integrated."""
    rubbed = FRICTION * ACROSS

    def slides(begin: float, sense: float, way: float) -> tuple[float, State]:
        stops = _event(lambda at, y: y[1] * sense if at > begin else 1.0)
        done = solve_ivp(
            lambda at, y: [y[1], ALONG - PULL * at - sense * rubbed], (begin, t), [way, 0.0], events=stops, **_TIGHT
        )
        return float(done.t[-1]), (float(done.y[0, -1]), float(done.y[1, -1]), MASS * sense * rubbed)

    stop, state = slides(0.0, 1.0, 0.0)
    if stop >= t:
        return state
    slips = _event(lambda at, y: rubbed - abs(ALONG - PULL * at))
    back = float(solve_ivp(lambda at, y: [0.0], (stop, t), [0.0], events=slips, **_TIGHT).t[-1])
    if back >= t:
        return state[0], 0.0, MASS * (ALONG - PULL * t)
    return slides(back, -1.0, state[0])[1]


def fall_integrated(t: float) -> State:
    """Return the same of Newton's law, integrated."""
    meets = _event(lambda t, y: HEIGHT - RISE * t**2 / 2 - y[0])
    done = solve_ivp(lambda t, y: [y[1], GRAVITY], (0, t), [0.0, 0.0], events=meets, **_TIGHT)
    if done.status == 0:
        return float(done.y[0, -1]), float(done.y[1, -1]), 0.0
    begin = float(done.t[-1])
    carried = [float(done.y[0, -1]), -RISE * begin]  # from there on with the floor's velocity
    done = solve_ivp(lambda t, y: [y[1], -RISE], (begin, t), carried, **_TIGHT)
    return float(done.y[0, -1]), float(done.y[1, -1]), MASS * (GRAVITY + RISE)


def sprung(t: float) -> State:
    """Return the patch on the oblique incline, and the vertical force that the incline carries."""
    rest = DENSITY * GRAVITY / (SPRINGS * STEEP)
    frequency = np.sqrt(SPRINGS * STEEP * (STEEP - RUBBED * LEVEL) / DENSITY)
    way = rest * (1 - np.cos(frequency * t))
    return way, rest * frequency * np.sin(frequency * t), AREA * (DENSITY * GRAVITY - SPRINGS * way * STEEP)


def sprung_integrated(t: float) -> State:
    """Return the same of Newton's law in space."""
    place, velocity, pressed = sprung_in_space(t)
    return float(np.linalg.norm(place)), float(np.linalg.norm(velocity)), pressed / LEVEL


INCLINE = np.array([2.0, 3.0, 6.0]) / 7
SIDEWAYS = np.array([3.0, -2.0, 0.0]) / np.sqrt(13)


def sprung_in_space(t: float) -> tuple[Array, Array, float]:
    """Return place and velocity of the patch by Newton's law, with the force that keeps it on the incline."""

    def forces(place: Array, velocity: Array) -> tuple[Array, float]:
        given = np.array([0.0, 0.0, -MASS * GRAVITY - AREA * SPRINGS * place[2]])
        pressed = -float(given @ INCLINE)  # the patch has no acceleration across the incline
        along = given + pressed * INCLINE
        speed = float(np.linalg.norm(velocity))
        way = velocity / speed if speed > 0 else along / np.linalg.norm(along)
        return along - RUBBED * pressed * way, pressed

    def moved(_: float, y: Array) -> Array:
        return np.concatenate([y[3:], forces(y[:3], y[3:])[0] / MASS])

    end = solve_ivp(moved, (0.0, t), np.zeros(6), **_TIGHT).y[:, -1]
    return end[:3], end[3:], forces(end[:3], end[3:])[1]


_TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}


def _event(function: Callable[..., float]) -> Callable[..., float]:
    function.terminal = True  # type: ignore[attr-defined]
    function.direction = -1  # type: ignore[attr-defined]
    return function


def _slides(at: Callable[[float], State]) -> dict[str, float]:
    return {
        "slide_200ms": at(0.2)[0],
        "friction_200ms": at(0.2)[2],
        "slide_600ms": at(0.6)[0],
        "friction_600ms": -at(0.6)[2],
        "normal_force_600ms": MASS * ACROSS,
        "slide_900ms": at(0.9)[0],
        "kinetic_energy_900ms": MASS / 2 * at(0.9)[1] ** 2,
        "penetration_900ms": 0.0,
    }


def _falls(at: Callable[[float], State]) -> dict[str, float]:
    return {
        "fall_210ms": at(0.21)[0],
        "kinetic_energy_210ms": MASS / 2 * at(0.21)[1] ** 2,
        "fall_240ms": at(0.24)[0],
        "fall_400ms": at(0.4)[0],
        "floor_force_400ms": at(0.4)[2],
        "kinetic_energy_400ms": MASS / 2 * at(0.4)[1] ** 2,
        "penetration_400ms": 0.0,
    }


def _sprung(at: Callable[[float], State]) -> dict[str, float]:
    return {
        "slide_250ms": at(0.25)[0],
        "friction_250ms": RUBBED * LEVEL * at(0.25)[2],
        "normal_force_250ms": LEVEL * at(0.25)[2],
        "slide_350ms": at(0.35)[0],
        "sideways_350ms": 0.0,
        "kinetic_energy_350ms": MASS / 2 * at(0.35)[1] ** 2,
        "penetration_350ms": 0.0,
    }


def _sprung_in_space() -> dict[str, float]:
    place = sprung_in_space(0.35)[0]
    across = {"sideways_350ms": float(place @ SIDEWAYS), "penetration_350ms": -float(place @ INCLINE)}
    return _sprung(sprung_integrated) | across


def _estimates(values: dict[str, float], error: float) -> dict[str, Estimate]:
    units = {"friction": "N", "normal": "N", "floor": "N", "kinetic": "J"}
    return {
        name: Estimate(
            float(v), error * abs(float(v)) if abs(v) > NOTHING else NOTHING, units.get(name.split("_")[0], "m")
        )
        for name, v in values.items()
    }


JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "contact_patch_slides": lambda: _estimates(_slides(slide), EXACT),
    "contact_patch_falls": lambda: _estimates(_falls(fall), EXACT),
    "contact_patch_sprung": lambda: _estimates(_sprung(sprung), EXACT),
}
INTEGRATED: dict[str, Callable[[], dict[str, Estimate]]] = {
    "contact_patch_slides": lambda: _estimates(_slides(slide_integrated), INTEGRATED_TO),
    "contact_patch_falls": lambda: _estimates(_falls(fall_integrated), INTEGRATED_TO),
    "contact_patch_sprung": lambda: _estimates(_sprung_in_space(), INTEGRATED_TO),
}
