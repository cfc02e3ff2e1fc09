r"""A bar that flies against a wall and off it: cases/contact_bar.toml.

It is pushed by 2 V / (T sqrt(pi)) exp(-(t/T)^2), which gives it the velocity V, but for 1e-16 of it before the wall, H
away, is met at t1 = H / V + T / sqrt(pi). From then on, with c^2 = E h / rho, a shock runs from the wall to the far end and back (D'Alembert). Behind it the bar stands
still, compressed by V/c, and then flies back with V. The wall presses with rho c V times the width for 2 L / c. No
energy is lost (Doyen, Ern & Piperno 2011, Time-integration schemes for the finite element dynamic Signorini problem,
SIAM Journal on Scientific Computing 33, section 5.1).

The second form integrates the wave equation with a unilateral end by central differences at Courant number one.

Both are linear. At strains of V/c the bar's waves are slower by a share of about V/c, which is argued and not
computed: ten times that is the uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from .estimate import Estimate

LENGTH, WIDTH, DENSITY, STIFFNESS = 1.0, 0.1, 0.2, 20.0  # m, m, kg/m^2, and E h, N/m
SPEED = (STIFFNESS / DENSITY) ** 0.5
VELOCITY, PUSHED, AWAY = 3e-4, 0.01, 1.631e-5  # m/s, s, m
MASS = DENSITY * WIDTH * LENGTH
CROSSING = LENGTH / SPEED
SLOWER = 10 * VELOCITY / SPEED  # relative, of what the impact changes; waves change by three halves of the strain
REST = 1e-6  # relative, of what else there is: the push that is left at the wall
FINE, COARSE = 400, 200  # differences along the bar

State = dict[str, float]


MEETS = AWAY / VELOCITY + PUSHED / math.sqrt(math.pi)


def closed(t: float) -> State:
    """Return ways toward the wall, m, of the far end and the centre of mass, energies, J, and the wall's force, N."""
    full = MASS * VELOCITY**2 / 2
    since = (t - MEETS) / CROSSING  # crossings of the shock
    if since <= 0:
        share = math.erf(t / PUSHED)
        way = VELOCITY * (t * share + PUSHED / math.sqrt(math.pi) * math.expm1(-((t / PUSHED) ** 2)))
        return _state(way, way, full * share**2, 0.0, 0.0)
    most = VELOCITY * CROSSING
    if since < 2:
        stands = 1 - abs(1 - since)  # of the bar
        far = AWAY + most * stands
        centre = AWAY + most * (since - since**2 / 2)
        return _state(far, centre, full * (1 - stands), full * stands, DENSITY * SPEED * VELOCITY * WIDTH)
    back = AWAY - most * (since - 2)
    return _state(back, back, full, 0.0, 0.0)


def integrated(t: float, cells: int) -> State:
    """Return the same by central differences."""
    dx = LENGTH / cells
    dt = dx / SPEED
    count = round(t / dt)
    weights = np.full(cells + 1, dx / LENGTH)
    weights[[0, -1]] /= 2
    before = now = after = np.zeros(cells + 1)
    force = 0.0
    for step in range(count + 1):
        push = 2 * VELOCITY / (PUSHED * math.sqrt(math.pi)) * math.exp(-((step * dt / PUSHED) ** 2))
        pushed = push * dt**2 * (0.5 if step == 0 else 1.0)
        inner = np.concatenate([now[1:2], now, now[-2:-1]])  # mirrored at free ends
        after = (inner[2:] + inner[:-2]) / (2.0 if step == 0 else 1.0) - (0.0 if step == 0 else before) + pushed
        entered = max(after[0] - AWAY, 0.0)
        after[0] -= entered
        force = entered * DENSITY * WIDTH * dx / 2 / dt**2
        if step < count:
            before, now = now, after
    velocity = (after - before) / (2 * dt)
    strain = np.diff(now) / dx
    return _state(
        float(now[-1]),
        float(weights @ now),
        MASS / 2 * float(weights @ velocity**2),
        STIFFNESS * WIDTH / 2 * float(np.sum(strain**2)) * dx,
        force,
    )


def _state(far: float, centre: float, kinetic: float, membrane: float, force: float) -> State:
    return {
        "far_end": far,
        "centre": centre,
        "kinetic_energy": kinetic,
        "membrane_energy": membrane,
        "wall_force": force,
    }


UNITS = {"far_end": "m", "centre": "m", "kinetic_energy": "J", "membrane_energy": "J", "wall_force": "N"}
ASKED = (
    ("centre", 50),
    ("kinetic_energy", 50),
    ("centre", 110),
    ("wall_force", 110),
    ("far_end", 160),
    ("membrane_energy", 160),
    ("wall_force", 210),
    ("centre", 280),
    ("kinetic_energy", 280),
)


def _all(at: Callable[[float], State], uncertainty: Callable[[str, float], float]) -> dict[str, Estimate]:
    found = {}
    for name, ms in ASKED:
        value = at(ms / 1000)[name]
        found[f"{name}_{ms}ms"] = Estimate(value, uncertainty(name, ms / 1000), UNITS[name])
    return {**found, "penetration_210ms": Estimate(0.0, 1e-12, "m")}


def judge() -> dict[str, Estimate]:
    """Return D'Alembert's solution."""
    # ways are uncertain by a share of what the bar is compressed by; before the impact the bar is rigid
    scales = {"kinetic_energy": MASS * VELOCITY**2 / 2, "wall_force": DENSITY * SPEED * VELOCITY * WIDTH}
    scales["membrane_energy"] = scales["kinetic_energy"]

    def uncertainty(name: str, t: float) -> float:
        return (SLOWER if t > MEETS else REST) * scales.get(name, VELOCITY * CROSSING)

    return _all(closed, uncertainty)


def second() -> dict[str, Estimate]:
    """Return the values of finite differences; their uncertainty is the change from coarser ones."""
    fine, coarse = (_all(partial(integrated, cells=cells), lambda *_: 0.0) for cells in (FINE, COARSE))
    return {k: Estimate.between(v.value, coarse[k].value, v.unit, 1e-9 * abs(v.value) + 1e-16) for k, v in fine.items()}


JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {"contact_bar": judge}
SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {"contact_bar": second}
