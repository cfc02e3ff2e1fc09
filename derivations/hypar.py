r"""Hyperbolic paraboloid, clamped at one edge, under its weight: splines that are graded toward edges and corners.

z = x^2 - y^2 over the unit square, x = -1/2 clamped, Young's modulus 2e11, Poisson's ratio .3, 8000 h downward per area
(Bathe, Iosilevich & Chapelle 2000). The shell is even in y: half of it is solved for, y in [0, 1/2]. Where the clamped
edge meets the free ones stresses are singular, and along edges they vary over a root of the thickness: knot spans are
halved toward x = -1/2, x = 1/2 and y = 1/2. The frame (x,1  x,2  x,1 cross x,2) meets the clamp exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from .estimate import Estimate
from .hypar_polynomials import Polynomials
from .linear_splines import LinearShell
from .patch import breaks
from .spline_shell import Splines
from .surface_strains import Array

YOUNG, POISSON = 2e11, 0.3
LOAD = 8000.0
"""Pa per metre of thickness."""
OBLIQUE = 0.3, 0.35, np.array([1.0, 2.0, -2.0]) / 3
"""x, y and the direction of the second displacement."""
DEGREE = 6
LEVELS = {
    1e-2: ((16, 10), (12, 8), (4, 5)),
    1e-3: ((32, 18), (24, 14), (4, 5)),
    1e-4: ((64, 36), (48, 28), (3, 4)),
}
"""Spans along x and y, finer and coarser, and two numbers of halvings, by thickness.

Layers along edges are as wide as its square root, those across the shell as its cube root.
"""
ROUNDING = 1e-6
"""Relative: stiffnesses of small spans cancel."""


def surface(one: Array, two: Array, i: int, j: int) -> Array:
    """Derivative of (x, y, x^2 - y^2)."""
    zero = np.zeros_like(one)
    powers = {
        (0, 0): (one, two, one**2 - two**2),
        (1, 0): (zero + 1, zero, 2 * one),
        (0, 1): (zero, zero + 1, -2 * two),
    }
    powers |= {(2, 0): (zero, zero, zero + 2), (0, 2): (zero, zero, zero - 2)}
    return np.stack(powers.get((i, j), (zero, zero, zero)), axis=-1)


def frame(one: Array, two: Array, i: int, j: int) -> Array:
    """Derivative of x,1, x,2 and their cross product (-2 x, 2 y, 1)."""
    zero = np.zeros_like(one)
    normal = {(0, 0): (-2 * one, 2 * two, zero + 1), (1, 0): (zero - 2, zero, zero), (0, 1): (zero, zero + 2, zero)}
    cross = np.stack(normal.get((i, j), (zero, zero, zero)), axis=-1)
    return np.stack([surface(one, two, i + 1, j), surface(one, two, i, j + 1), cross], axis=1)


def hypar_shell(thickness: float, spans: tuple[int, int], degree: int, halvings: int) -> LinearShell:
    """Half of the shell; y = 0 is its plane of symmetry."""
    one = breaks(-0.5, 0.5, spans[0], (True, True), halvings)
    two = breaks(0.0, 0.5, spans[1], (False, True), halvings)
    even, odd = ("even", "free"), ("zero", "free")
    ends = [(("zero", "free"), even), (("zero", "free"), odd), (("clamped", "free"), even)]
    return LinearShell(
        surface,
        frame,
        (Splines(one, degree), Splines(two, degree)),
        ends,
        YOUNG,
        POISSON,
        thickness,
        (0, 0, -LOAD * thickness),
    )


def _solved(thickness: float, spans: tuple[int, int], halvings: int) -> dict[str, float]:
    answer = hypar_shell(thickness, spans, DEGREE, halvings).solve()
    x, y, direction = OBLIQUE
    return {
        "tip_deflection": float(-answer.displacement(0.5, 0.0)[2]),
        "oblique_displacement": float(direction @ answer.displacement(x, y)),
        "strain_energy": 2 * answer.work,
        "membrane_energy": 2 * answer.membrane,
        "bending_energy": 2 * answer.bending,
    }


def _limit(
    thickness: float, spans: tuple[int, int], halvings: tuple[int, int]
) -> tuple[dict[str, float], dict[str, float]]:
    """Values for endless halvings, and by how much they are beyond the finest ones: the corner's error halves with each."""
    coarse, fine = (_solved(thickness, spans, number) for number in halvings)
    beyond = {name: value - coarse[name] for name, value in fine.items()}
    return {name: value + beyond[name] for name, value in fine.items()}, beyond


def hypar(thickness: float) -> dict[str, Estimate]:
    """Known values; the uncertainty is all that is extrapolated, and the change from fewer spans."""
    *levels, halvings = LEVELS[thickness]
    (fine, beyond), (coarse, _) = (_limit(thickness, spans, halvings) for spans in levels)
    found = {}
    for name, value in fine.items():
        uncertainty = abs(beyond[name]) + abs(value - coarse[name]) + ROUNDING * abs(value)
        found[name] = Estimate(value, uncertainty, "J" if name.endswith("energy") else "m")
    return found


HYPARS = {f"hypar_clamped_1e_{power}": partial(hypar, 10.0**-power) for power in (2, 3, 4)}
"""Functions that compute the known values, by case."""


# --- second form ---------------------------------------------------------------------------------


def hypars_by_polynomials(
    thicknesses: Sequence[float], fine: tuple[int, int] = (56, 42), coarse: tuple[int, int] = (44, 34)
) -> list[dict[str, Estimate]]:
    """Known values by polynomials, for each thickness: the stiffnesses, which take long, serve all of them.

    The error falls like degree^-2 or faster, and all that is extrapolated is uncertain.
    """
    far, near = (_by_polynomials(thicknesses, degrees) for degrees in (coarse, fine))
    factor = 1 / ((fine[0] / coarse[0]) ** 2 - 1)
    found = []
    for rough, values in zip(far, near, strict=True):
        beyond = {name: factor * (value - rough[name]) for name, value in values.items()}
        units = {name: "J" if name.endswith("energy") else "m" for name in values}
        found.append({name: Estimate(value + beyond[name], abs(beyond[name]), units[name]) for name, value in values.items()})  # fmt: skip
    return found


def _by_polynomials(thicknesses: Sequence[float], degrees: tuple[int, int]) -> list[dict[str, float]]:
    shell, found = Polynomials(degrees, YOUNG, POISSON), []
    x, y, direction = OBLIQUE
    for thickness in thicknesses:
        q, energy, membrane, bending = shell.solve(thickness, LOAD * thickness)
        found.append(
            {
                "tip_deflection": float(-shell.displacement(q, 0.5, 0.0)[2]),
                "oblique_displacement": float(direction @ shell.displacement(q, x, y)),
                "strain_energy": energy,
                "membrane_energy": membrane,
                "bending_energy": bending,
            }
        )
    return found
