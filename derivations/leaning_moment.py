r"""Half an arch that is rolled up by a moment whose axis leans: cases/leaning_moment.toml.

A strip is held at its end, x = L, in all components, with its slope free, and by a plane of symmetry where x = 0. A moment m acts
at the end, about an axis e that is neither along the end's edge nor across the shell's normal n. It works on the angle
theta by which the part of n across e turns. The edge is held, so that n can turn about the edge alone, say by psi, and

    d theta / d psi = (e . T) / (1 - (n . e)^2),    T along the edge:

m counts as M = m d theta / d psi. The declared m is such that M rolls the strip into the arc of `roll_up`, and the end is moved
to where this arc ends. Then nothing but the moment bends the strip, and the arc is its equilibrium. theta grows ever
faster with psi: that takes four fifths of the strip's stiffness.

The second form bends `plane_strip` by the declared moment, whose angle it takes from turned normals.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from shellbench.problems.shell.case import read_case

from .estimate import Estimate
from .manufactured import CASES
from .plane_strip import SPREAD, PlaneStrip
from .roll_up import Strip, energies, rolled_strip
from .surface_strains import Array

NAME = "leaning_moment"
ANGLE = 1.8  # by which the end turns, rad
STRIP = Strip(length=2.0, width=0.8, thickness=0.05, young=1.2e6, moment=float("nan"))
AXIS = np.array([0.7, 0.35, -0.6])
INSIDE = 1.1  # reference length of the point inside, m
OBLIQUE = np.array([1.0, 2.0, -2.0]) / 3.0
TURNED = 1e-6  # rad, of a central difference
ROUNDING = 1e-13
LEVEL = 100 * SPREAD
"""Of the second form, relative to the length: polynomials, the difference, and what a soft arch makes of both."""


def normal(psi: float) -> Array:
    """Return the normal (3,) where the strip has turned by psi about y, downward."""
    return np.array([np.sin(psi), 0.0, np.cos(psi)])


def turned(psi: float) -> float:
    """Return theta, rad, by which the normal's part across the axis turns."""
    e = AXIS / np.linalg.norm(AXIS)
    before, after = (n - (n @ e) * e for n in (normal(0.0), normal(psi)))
    return float(np.arctan2(np.cross(before, after) @ e, before @ after))


def declared() -> tuple[float, float]:
    """Return the moment m, N, and the way of the end against x, m, that make an arc of `ANGLE`."""
    rate = ANGLE / STRIP.length
    stretch = np.sqrt(1 - (STRIP.thickness * rate) ** 2 / 6)
    e, n = AXIS / np.linalg.norm(AXIS), normal(ANGLE)
    leverage = e[1] / (1 - (n @ e) ** 2)
    moment = STRIP.bending_stiffness * stretch**2 * rate / leverage
    return float(moment), float(STRIP.length - stretch * np.sin(ANGLE) / rate)


def _values(
    rise: float, inside: tuple[float, float], stored: tuple[float, float], angle: float, error: float
) -> dict[str, Estimate]:
    """Known values from the rise of the middle, the displacement inside along x and z, energies and the end's turn."""
    membrane, bending = stored
    middle = np.array([0.0, 0.0, rise])
    moved = np.array([inside[0], 0.0, inside[1]])
    work = declared()[0] * STRIP.width * turned(angle)
    lengths = {"rise": rise, "mean_oblique": float((moved + middle) @ OBLIQUE) / 2}
    parts = {"strain_energy": membrane + bending, "membrane_energy": membrane, "bending_energy": bending}
    return (
        {name: Estimate(value, error * STRIP.length, "m") for name, value in lengths.items()}
        | {name: Estimate(value, 1e2 * error * value, "J") for name, value in parts.items()}
        | {"potential_energy": Estimate(sum(stored) - work, 1e2 * error * work, "J")}
    )


def leaning_moment() -> dict[str, Estimate]:
    """Known values by the closed form."""
    rate = ANGLE / STRIP.length
    stretch = float(np.sqrt(1 - (STRIP.thickness * rate) ** 2 / 6))

    def dropped(s: float) -> float:
        return 2 * stretch * float(np.sin(rate * s / 2)) ** 2 / rate

    s, rise = INSIDE, dropped(STRIP.length)
    inside = stretch * float(np.sin(rate * s)) / rate - s, rise - dropped(s)
    arc = rolled_strip(replace(STRIP, moment=STRIP.bending_stiffness * stretch**2 * rate), 1.0)
    return _values(rise, inside, energies(STRIP, arc), ANGLE, ROUNDING)


def leaning_moment_by_polynomials() -> dict[str, Estimate]:
    """The same from virtual work of polynomials, under the moment and the motion that the case declares.

    Raises
    ------
    RuntimeError
        If the end does not come to where the case moves it, so that a force would be needed there.
    """
    case = read_case(CASES / f"{NAME}.toml")
    (load,), motion = case.loads, case.supports[1].motion
    moment = float(case.formula(load.value).derivatives(np.zeros((1, 2)), 0, 1.0)[0, 0][0])  # type: ignore[union-attr]
    way = -case.scalar(motion.vector[0], 1.0)  # type: ignore[union-attr]
    strip = PlaneStrip(STRIP.length, STRIP.thickness, STRIP.young)

    def leverage(angle: float) -> float:
        return (turned(angle + TURNED) - turned(angle - TURNED)) / (2 * TURNED)

    # The moment's part about the edge that bends the strip as far as makes it that part. PlaneStrip bends upward.
    def surplus(part: float) -> float:
        (*_, bent) = strip.path(np.arange(1, 9) / 8, moment=part)
        return part - moment * leverage(bent.angle)

    expected = STRIP.bending_stiffness * ANGLE / STRIP.length
    part = brentq(surplus, 0.98 * expected, 1.02 * expected, xtol=1e-12 * expected)
    (*_, bent) = strip.path(np.arange(1, 9) / 8, moment=part)
    if abs(bent.shortening - way) > LEVEL * STRIP.length:
        raise RuntimeError(f"the end comes {bent.shortening:.12g} m, and is moved by {way:.12g} m")
    x, z = strip.position(bent.coefficients, INSIDE)
    inside = float(x) - INSIDE, bent.deflection - float(z)
    stored = STRIP.width * bent.membrane, STRIP.width * bent.bending
    return _values(bent.deflection, inside, stored, bent.angle, LEVEL)
