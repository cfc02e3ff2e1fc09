r"""Hyperboloid of revolution under a pressure p cos 2 theta: one harmonic of a shell of revolution.

x^2 + y^2 = 1 + z^2, abs(z) <= 1, Young's modulus 2e11, Poisson's ratio 1/3 (Hiller & Bathe 2003). The
pressure pushes outward. With clamped rims the shell stretches, and p is proportional to h; with free rims it bends
without stretching, and p is proportional to h^3. The pressure is even in z: half of the meridian is solved for, with
u = 0 and w' = 0 at z = 0.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from .estimate import Estimate
from .revolution import Array, Revolution
from .revolution_splines import SplineRevolution, minimiser
from .spline_shell import Splines

YOUNG, POISSON = 2e11, 1 / 3
HARMONIC = 2
WAIST = ("U(left)", "W'(left)")
CLAMPED = ("U(right)", "V(right)", "W(right)", "W'(right)")
OBLIQUE = np.deg2rad(20.0), 0.6, np.array([2.0, -1.0, 2.0]) / 3
"""theta, z and the direction of the second displacement."""
STRETCHED = 1e-11
"""Relative rounding error where the shell stretches: stiffnesses don't cancel."""


def pressure(thickness: float, clamped: bool) -> float:
    """Amplitude of the pressure, Pa."""
    return 1e6 * (thickness if clamped else thickness**3)


def curve(t: Array) -> tuple[Array, Array]:
    """Meridian r = sqrt(1 + z^2), t = z, with three derivatives."""
    r = np.sqrt(1 + t**2)
    one, zero = np.ones_like(t), np.zeros_like(t)
    return np.stack([r, t / r, r**-3, -3 * t * r**-5]), np.stack([t, one, zero, zero])


def solved(thickness: float, clamped: bool, degree: int) -> dict[str, float]:
    """Values of the hyperboloid at a degree."""
    shell = Revolution(curve, 0.0, 1.0, YOUNG, POISSON, thickness, degree)
    membrane, bending = shell.stiffnesses(HARMONIC)
    load = shell.outward_load(pressure(thickness, clamped))
    q = shell.strip.minimise(membrane + bending, load, (*WAIST, *(CLAMPED if clamped else ())))
    return _values(shell, q, membrane, bending, load)


def _values(
    shell: Revolution | SplineRevolution, q: Array, membrane: Array, bending: Array, load: Array
) -> dict[str, float]:
    """Values from the coefficients on half of the meridian; twice half of each product is the energy of the whole."""
    theta, z, direction = OBLIQUE
    return {
        "waist_displacement": float(shell.displacement(HARMONIC, q, 0.0, 0.0)[0]),
        "oblique_displacement": float(direction @ shell.displacement(HARMONIC, q, theta, z)),
        "strain_energy": float(load @ q),
        "membrane_energy": float(q @ membrane @ q),
        "bending_energy": float(q @ bending @ q),
    }


def hyperboloid(thickness: float, clamped: bool, degree: int = 90) -> dict[str, Estimate]:
    """Known values; the uncertainty is the change from 2/3 of the degree, plus rounding."""
    return _estimates(*(solved(thickness, clamped, p) for p in (degree, 2 * degree // 3)), thickness, clamped)


def _estimates(
    fine: dict[str, float], coarse: dict[str, float], thickness: float, clamped: bool, lost: float = 1.0
) -> dict[str, Estimate]:
    """Return the estimates of two levels; `lost` is by how much more than `Revolution.rounding` may be lost."""
    rounding = lost * (STRETCHED if clamped else Revolution(curve, 0.0, 1.0, YOUNG, POISSON, thickness, 8).rounding)
    found = {}
    for name, value in fine.items():
        energy = name.endswith("energy")
        scale = fine["strain_energy" if energy else "waist_displacement"]
        found[name] = Estimate.between(value, coarse[name], "J" if energy else "m", rounding * scale)
    return found


HYPERBOLOIDS = {
    f"hyperboloid_{rims}_{name}": partial(hyperboloid, thickness, rims == "clamped")
    for rims in ("clamped", "free")
    for name, thickness in (("1e_2", 1e-2), ("1e_3", 1e-3), ("1e_4", 1e-4))
}
"""Functions that compute the known values, by case."""


# --- second form ---------------------------------------------------------------------------------


def hyperboloid_by_splines(thickness: float, clamped: bool) -> dict[str, Estimate]:
    """Known values by splines and products of vectors; the uncertainty is the change from fewer spans, plus rounding."""
    levels = ((48, 7), (40, 7)) if clamped else ((12, 9), (9, 9))
    return _estimates(*(solved_by_splines(thickness, clamped, *level) for level in levels), thickness, clamped, 4.0)


def solved_by_splines(thickness: float, clamped: bool, spans: int, degree: int) -> dict[str, float]:
    """Values of the hyperboloid by splines; under a clamp the knots are denser toward the rim, for its boundary layer."""
    even = np.linspace(0.0, 1.0, spans + 1)
    breaks = 1 - (1 - even) ** 2 if clamped else even
    shell = SplineRevolution(curve, Splines(breaks, degree), YOUNG, POISSON, thickness)
    membrane, bending = shell.stiffnesses(HARMONIC)
    load = shell.outward_load(pressure(thickness, clamped))
    held = [shell.row(2, 0.0), shell.row(0, 0.0, 1), shell.row(1, 0.0, 1)]
    if clamped:
        held += [shell.row(c, 1.0) for c in range(3)] + [shell.slope_row(1.0)]
    q = minimiser(membrane + bending, load, held)
    return _values(shell, q, membrane, bending, load)
