r"""Patches that slide and fall on something rigid: cases/contact_patch_*.toml.

Nothing strains them, so that each is a point mass. On the incline (3 : 4), with the acceleration c t of a pull uphill,

    s'' = g (3/5) - mu g (4/5) - c t      until it stops at T = 2 (3 - 4 mu) g / 5 c,
    s'' = g (3/5) + mu g (4/5) - c t < 0  after t = (3 + 4 mu) g / 5 c,

and it sticks in between. It falls by g t^2 / 2 until it meets the floor, which is at h + a t^2 / 2 with h < 0, and
then moves with it, pressed by m (g + a).

The second form integrates Newton's law of a point mass piece by piece, each until an event ends it (SciPy's DOP853). Forces of what slides
or rests are statics in both forms.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from .estimate import Estimate

GRAVITY, DENSITY, AREA = 10.0, 0.2, 0.4 * 0.1  # m/s^2, kg/m^2, m^2
MASS = DENSITY * AREA
FRICTION, PULL = 0.5, 2.6 / DENSITY  # coefficient, and c, m/s^3
ALONG, ACROSS = 0.6 * GRAVITY, 0.8 * GRAVITY  # the incline
HEIGHT, RISE = 0.3, 2.0  # m, and m/s^2
EXACT, INTEGRATED_TO = 1e-13, 1e-9

State = tuple[float, float, float]
"""Way, m, velocity, m/s, and force of friction uphill or of the floor, N."""


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


def _estimates(values: dict[str, float], error: float) -> dict[str, Estimate]:
    units = {"friction": "N", "normal": "N", "floor": "N", "kinetic": "J"}
    return {
        name: Estimate(float(v), error * abs(float(v)) if v else 1e-12, units.get(name.split("_")[0], "m"))
        for name, v in values.items()
    }


JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "contact_patch_slides": lambda: _estimates(_slides(slide), EXACT),
    "contact_patch_falls": lambda: _estimates(_falls(fall), EXACT),
}
INTEGRATED: dict[str, Callable[[], dict[str, Estimate]]] = {
    "contact_patch_slides": lambda: _estimates(_slides(slide_integrated), INTEGRATED_TO),
    "contact_patch_falls": lambda: _estimates(_falls(fall_integrated), INTEGRATED_TO),
}
