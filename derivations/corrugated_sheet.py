r"""Half a period of a trapezoidal corrugated sheet between planes of symmetry: stretched across, and bent along.

Its section runs along y from the middle of a valley to the middle of a crest: a flat of the width FLAT, a slope of the width RISE at
the angle SLOPE, a flat of the width FLAT, with rigid folds between. The edges in the planes y = 0 and y = c move neither out of
their plane nor turn. With z from half of the height f, the developed width l and the projected one c:

- `corrugation_across`: x = 0 and x = LENGTH are planes of symmetry too, the valley is held, and a force H per length along y pulls
  at the crest, which moves freely along z. The section is a frame with the moment H z and the force H t_y in a bar along t:

      displacement = H (f^2 (FLAT / 2 + RISE / 12) / B + (2 FLAT + RISE cos^2 SLOPE) / D),

  and D_across = H c / displacement replaces D of a flat sheet.
- `corrugation_along`: x = 0 is a plane of symmetry, and the end x = LENGTH carries the axial forces and moments of the curvature K,

      u = K x z,  eps_x = K z,  kap_x = K n_z,  u_z = -K x^2 / 2 + f(s),  N_s = N_xs = M_xs = 0,
      N_x = E h K z,  M_s = nu B K c / l,  M_x = (1 - nu^2) B K n_z + nu M_s,

  so that the valley and the crest do not turn, for the integral of kap_s = M_s / B - nu K n_z vanishes. Their sum is a moment per
  width c, K B_along, with

      c B_along = E h (integral of z^2) + (1 - nu^2) B (integral of n_z^2) + nu^2 B c^2 / l.

Both are exact in the theory of Kirchhoff and Love with rigid folds; formulas for homogenised corrugated plates, which leave
out parts of them, are in Xia, Friswell & Saavedra Flores (2012). The second forms minimise the potential energy by `folded_ritz`.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .angle_frame import plane_strain
from .estimate import Estimate
from .folded_ritz import Lengthwise, Prism, Section, flat_walls
from .surface_strains import Array

FLAT, RISE, SLOPE = 0.02, 0.05, np.deg2rad(50.0)
LENGTH, THICKNESS, YOUNG, POISSON = 0.2, 0.002, 7e10, 0.33
PULL, CURVATURE = 400.0, 1e-3  # N/m, 1/m
STRETCHING = YOUNG * THICKNESS / (1 - POISSON**2)
BENDING = STRETCHING * THICKNESS**2 / 12
HEIGHT = RISE * np.sin(SLOPE)
PROJECTED, DEVELOPED = 2 * FLAT + RISE * np.cos(SLOPE), 2 * FLAT + RISE
NODES = (
    (0.0, -HEIGHT / 2),
    (FLAT, -HEIGHT / 2),
    (FLAT + RISE * np.cos(SLOPE), HEIGHT / 2),
    (PROJECTED, HEIGHT / 2),
)
DEGREE = 6
"""Of the second forms in s: the exact solution is of degree 3."""
ROUNDING_OF_SHEET = 1e-9


def unit(name: str) -> str:
    """Unit of a quantity: forces, moments and stiffnesses are per length."""
    units = {"energy": "J", "turn": "rad", "moment": "N", "force": "N/m", "stretching": "N/m", "bending_s": "N m"}
    return next((u for key, u in units.items() if key in name), "m")


def _exact(values: dict[str, float]) -> dict[str, Estimate]:
    return {name: Estimate.exact(float(value), unit(name)) for name, value in values.items()}


def corrugation_across() -> dict[str, Estimate]:
    """Known values of the sheet that is pulled across its folds; moments stretch the upper side."""
    f, c = HEIGHT, np.cos(SLOPE)
    bent = f**2 * (FLAT / 2 + RISE / 12) / BENDING
    stretched = (2 * FLAT + RISE * c**2) / STRETCHING
    moved = PULL * (bent + stretched)
    moment = PULL * f / 2  # at the lower fold
    return _exact(
        {
            "crest_displacement": moved,
            "crest_rise": _rise(),
            "fold_turn": -moment * FLAT / BENDING,
            "fold_moment": moment,
            "stretching_stiffness": PULL * PROJECTED / moved,
            "membrane_energy": LENGTH * PULL**2 * stretched / 2,
            "bending_energy": LENGTH * PULL**2 * bent / 2,
            "strain_energy": LENGTH * PULL * moved / 2,
        }
    )


def _rise() -> float:
    """Displacement of the crest along z relative to the valley: the integral of the turn over y, and the slope's stretch."""
    # The turn falls by H f / (2 B) per length on a flat; on the slope it goes on by the integral of H z / B.
    c, s = np.cos(SLOPE), np.sin(SLOPE)
    turn = -PULL * HEIGHT * FLAT / (2 * BENDING)
    on_slope = turn * RISE - PULL * s * RISE**3 / (12 * BENDING)
    return turn * FLAT + c * on_slope + PULL * c * s * RISE / STRETCHING


def corrugation_along() -> dict[str, Estimate]:
    """Known values of the sheet that is bent along its folds; moments stretch the upper side."""
    f, c = HEIGHT, np.cos(SLOPE)
    spread = 2 * FLAT * f**2 / 4 + RISE * f**2 / 12
    across = POISSON * BENDING * CURVATURE * PROJECTED / DEVELOPED
    membrane = YOUNG * THICKNESS * spread
    flatness = (1 - POISSON**2) * (2 * FLAT + RISE * c**2) + POISSON**2 * PROJECTED**2 / DEVELOPED
    moment = CURVATURE * (membrane + BENDING * flatness)
    return _exact(
        {
            "end_deflection": CURVATURE * LENGTH**2 / 2,
            "end_displacement": CURVATURE * LENGTH * f / 2,
            "fold_axial_force": YOUNG * THICKNESS * CURVATURE * f / 2,
            "fold_moment": across,
            "fold_axial_moment_flat": _axial(1.0),
            "fold_axial_moment_slope": _axial(c),
            "bending_stiffness": moment / (CURVATURE * PROJECTED),
            "membrane_energy": LENGTH * CURVATURE**2 * membrane / 2,
            "bending_energy": LENGTH * CURVATURE**2 * BENDING * flatness / 2,
            "strain_energy": LENGTH * CURVATURE * moment / 2,
        }
    )


def _axial(level: float) -> float:
    """M_x of a plate whose normal has the component `level` along z."""
    share = PROJECTED / DEVELOPED
    return BENDING * CURVATURE * ((1 - POISSON**2) * level + POISSON**2 * share)


# --- the second forms --------------------------------------------------------------------------------


def _inexact(exact: dict[str, Estimate], values: dict[str, float]) -> dict[str, Estimate]:
    """Values of the exact ones' names, uncertain by rounding."""
    return {
        name: Estimate(
            float(values[name]),
            float(ROUNDING_OF_SHEET * abs(values["strain_energy" if "energy" in name else name])),
            unit(name),
        )
        for name in exact
    }


def _section(held: dict[int, str]) -> Section:
    return Section(tuple(flat_walls(NODES, ((0, 1), (1, 2), (2, 3)))), DEGREE, held)


def corrugation_across_by_ritz() -> dict[str, Estimate]:
    """Values of the pulled sheet by polynomials."""
    prism = plane_strain(_section({0: "yzr", 3: "r"}), LENGTH, THICKNESS, YOUNG, POISSON)
    found, membrane, bending = prism.solve(prism.side_load(2, 1, PULL, FLAT))
    x = LENGTH / 3
    moved = prism.place(2, 1, FLAT, x) @ found
    values = {
        "crest_displacement": moved,
        "crest_rise": prism.place(2, 2, FLAT, x) @ found,
        "fold_turn": prism.place(0, 2, FLAT, x, 1) @ found,
        "fold_moment": prism.resultant("m_s", 0, FLAT, x) @ found,
        "stretching_stiffness": PULL * PROJECTED / moved,
        "membrane_energy": membrane,
        "bending_energy": bending,
        "strain_energy": membrane + bending,
    }
    return _inexact(corrugation_across(), values)


def corrugation_along_by_ritz() -> dict[str, Estimate]:
    """Values of the bent sheet by polynomials, under the declared forces and moments at its end."""
    # 1. Symmetry at x = 0; the valley is held along z at one point.
    even = Lengthwise((0.0, LENGTH), 4, "even")
    section = _section({0: "yr", 3: "yr"})
    prism = Prism(section, {"u": Lengthwise((0.0, LENGTH), 4, "zero"), "v": even, "w": even}, THICKNESS, YOUNG, POISSON)
    # 2. The loads of the end.
    load = np.zeros(prism.size)
    for wall, (low, high) in enumerate(pairwise(NODES)):
        width, t = section.walls[wall].width, section.walls[wall].frame(0.0)[0]

        def pull(s: Array, low: float = low[1], rise: float = (high[1] - low[1]) / width) -> Array:
            return YOUNG * THICKNESS * CURVATURE * (low + rise * s)

        load += prism.edge_load(wall, 0, pull, LENGTH)
        load += prism.edge_load(wall, 2, -_axial(float(t[0])), LENGTH, 1)
    given = np.full(prism.size, np.nan)
    height = prism.place(0, 2, 0.0, 0.0)
    given[int(np.argmax(np.abs(height)))] = 0.0
    found, membrane, bending = prism.solve(load, given)
    # 3. Values at the end and halfway.
    x = LENGTH / 2
    dropped = [float(prism.place(0, 2, 0.0, at) @ found) for at in (0.0, LENGTH)]
    values = {
        "end_deflection": dropped[0] - dropped[1],
        "end_displacement": prism.place(2, 0, 0.0, LENGTH) @ found,
        "fold_axial_force": prism.resultant("n_x", 2, 0.0, x) @ found,
        "fold_moment": prism.resultant("m_s", 2, 0.0, x) @ found,
        "fold_axial_moment_flat": prism.resultant("m_x", 2, 0.0, x) @ found,
        "fold_axial_moment_slope": prism.resultant("m_x", 1, RISE, x) @ found,
        "bending_stiffness": 2 * (membrane + bending) / (LENGTH * CURVATURE**2 * PROJECTED),
        "membrane_energy": membrane,
        "bending_energy": bending,
        "strain_energy": membrane + bending,
    }
    return _inexact(corrugation_along(), values)
