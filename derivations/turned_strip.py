"""A strip under an end moment whose wall is turned about an axis across it: the arc of `roll_up`, turned.

The moment's axis is that of the turn, so that neither knows of the other: the strip is first bent and then turned about
y as a rigid body, and its energies are those of the arc. The second form bends it by `plane_strip`, from virtual work
in polynomials, and turns it by an exponential of a motion, as `rigid_turn` does.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from .estimate import Estimate
from .plane_strip import SPREAD, PlaneStrip
from .roll_up import Strip, energies, potential, rolled_strip
from .surface_strains import Array

STRIP = Strip(length=4.0, width=1.3, thickness=0.1, young=1.2e6, moment=40.0)
CENTRE = np.array([0.5, 0.2, -0.3])
DEGREES = -30.0  # about y at full load
MIDDLE = 1.8  # reference length of the point inside, m
OBLIQUE = np.array([1.0, 2.0, -2.0]) / 3.0
LOADS = {0.5: "50", 1.0: "100"}


def _quantities(tip: dict[float, Array], middle: Array) -> dict[str, float]:
    """Values from the displacements (3,) of the tip by load factor, and of the point inside at full load."""
    values = {f"tip_{c}_{name}": float(tip[at][k]) for at, name in LOADS.items() for c, k in (("x", 0), ("z", 2))}
    return values | {"mean_oblique_100": float((tip[1.0] + middle) @ OBLIQUE) / 2}


def turned_cantilever() -> dict[str, Estimate]:
    """Known values of cases/turned_cantilever.toml."""

    def displacement(at: float, s: float) -> Array:
        arc, angle = rolled_strip(STRIP, at), np.radians(DEGREES * at)
        along = arc.stretch * np.sin(arc.turning * s) / arc.turning
        across = 2 * arc.stretch * np.sin(arc.turning * s / 2) ** 2 / arc.turning
        x, z = along - CENTRE[0], across - CENTRE[2]
        turned = np.array([np.cos(angle) * x + np.sin(angle) * z, 0.0, np.cos(angle) * z - np.sin(angle) * x])
        return turned + np.array([CENTRE[0] - s, 0.0, CENTRE[2]])

    values = _quantities({at: displacement(at, STRIP.length) for at in LOADS}, displacement(1.0, MIDDLE))
    arc = rolled_strip(STRIP, 1.0)
    membrane, bending = energies(STRIP, arc)
    return {name: Estimate(value, 1e-14 * STRIP.length, "m") for name, value in values.items()} | {
        "strain_energy": Estimate.exact(membrane + bending, "J"),
        "membrane_energy": Estimate.exact(membrane, "J"),
        "bending_energy": Estimate.exact(bending, "J"),
        "potential_energy": Estimate.exact(potential(STRIP, arc, -np.radians(DEGREES)), "J"),
    }


def turned_cantilever_by_polynomials() -> dict[str, Estimate]:
    """The same from the other form."""
    strip = PlaneStrip(STRIP.length, STRIP.thickness, STRIP.young)
    bent = {found.factor: found for found in strip.path(np.arange(1, 9) / 8, moment=STRIP.moment)}
    turn = np.zeros((4, 4))
    turn[0, 2], turn[2, 0] = 1.0, -1.0
    turn[:3, 3] = -turn[:3, :3] @ CENTRE

    def displacement(at: float, s: float) -> Array:
        x, z = strip.position(bent[at].coefficients, s)
        moved = expm(np.radians(DEGREES * at) * turn) @ np.array([x, 0.0, z, 1.0])
        return np.asarray(moved[:3] - [s, 0.0, 0.0])

    values = _quantities({at: displacement(at, STRIP.length) for at in LOADS}, displacement(1.0, MIDDLE))
    membrane, bending = STRIP.width * bent[1.0].membrane, STRIP.width * bent[1.0].bending
    # The moment's axis is -y: a turn by -30 degrees about y goes its way.
    work = STRIP.width * STRIP.moment * (bent[1.0].angle - np.radians(DEGREES))
    return {name: Estimate(value, 10 * SPREAD * STRIP.length, "m") for name, value in values.items()} | {
        name: Estimate(value, 1e3 * SPREAD * abs(value), "J")
        for name, value in (
            ("strain_energy", membrane + bending),
            ("membrane_energy", membrane),
            ("bending_energy", bending),
            ("potential_energy", membrane + bending - work),
        )
    }  # fmt: skip
