r"""Hemisphere with a hole of 18 degrees under four radial forces at its equator: Fourier series of a shell of revolution.

Radius 10, thickness .04, Young's modulus 6.825e7, Poisson's ratio .3; forces of 2 at theta = 0, 90, 180 and 270 degrees,
outward and inward in turn (MacNeal & Harder 1985). Both edges are free. The forces are the harmonics n = 2, 6, 10, ... of
a line load 4 F / (pi R) cos(n theta) at the edge t = 0, t the latitude, and each harmonic's amplitude W_n(0) is part of the
displacement under every force: that is the sum, and the strain energy is twice the force times it. No rigid motion has
such a harmonic, so that the answer is orthogonal to all of them.

Near a force on a free edge a shell bends as a plate: W_n(0) falls like n^-3, with corrections in powers of n^-2 (the edge is
a geodesic). The tail is fitted with that rate and summed.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate, algebraic_series_sum
from .linear_splines import Answer, LinearShell, cartesian
from .patch import breaks
from .revolution import Array, Revolution
from .spline_shell import Splines

RADIUS, THICKNESS, YOUNG, POISSON, FORCE = 10.0, 0.04, 6.825e7, 0.3, 2.0
TOP = np.deg2rad(72.0)
OBLIQUE = np.deg2rad(20.0), np.deg2rad(30.0), np.array([2.0, -1.0, 2.0]) / 3
"""theta, latitude and direction of the second displacement."""
TAIL_POWER = 3


def curve(t: Array) -> tuple[Array, Array]:
    """Meridian of the sphere by the latitude, with three derivatives."""
    orders = np.arange(4)[:, None] * np.pi / 2
    return RADIUS * np.cos(t + orders), RADIUS * np.sin(t + orders)


def series(last_harmonic: int, degree: int) -> tuple[Array, dict[str, Array]]:
    """Harmonics n and, for each, its parts of the values."""
    shell = Revolution(curve, 0.0, TOP, YOUNG, POISSON, THICKNESS, degree)
    theta, latitude, direction = OBLIQUE
    n = np.arange(2, last_harmonic + 1, 4)
    load = np.zeros(3 * (degree + 1))
    load[shell.strip.end_coefficient("W(left)")] = -4 * FORCE  # n points inward; the line load's cos^2 around is pi R
    rows = []
    for harmonic in n:
        membrane, bending = shell.stiffnesses(int(harmonic))
        q = shell.strip.minimise(membrane + bending, load, ())
        out = -q[shell.strip.end_coefficient("W(left)")]
        askew = direction @ shell.displacement(int(harmonic), q, theta, latitude)
        rows.append([out, askew, q @ membrane @ q / 2, q @ bending @ q / 2])
    names = "load_displacement", "oblique_displacement", "membrane_energy", "bending_energy"
    return n, dict(zip(names, np.array(rows).T, strict=True))


def _summed(last_harmonic: int, degree: int) -> dict[str, float]:
    n, terms = series(last_harmonic, degree)
    # Away from the forces the series converges by itself.
    totals = {name: float(part.sum()) if name.startswith("oblique") else algebraic_series_sum(n, part, TAIL_POWER) for name, part in terms.items()}  # fmt: skip
    return totals | {"strain_energy": 2 * FORCE * totals["load_displacement"]}


def hemisphere_hole(last_harmonic: int = 122, degree: int = 64) -> dict[str, Estimate]:
    """Known values; the uncertainty is the change from 2/3 of harmonics and degree, both summed, plus rounding."""
    return _estimates(_summed(last_harmonic, degree), _summed(2 * last_harmonic // 3, 2 * degree // 3))


def _estimates(fine: dict[str, float], coarse: dict[str, float]) -> dict[str, Estimate]:
    rounding = np.finfo(float).eps * 12 * (RADIUS / THICKNESS) ** 2
    found = {}
    for name, value in fine.items():
        energy = name.endswith("energy")
        scale = fine["strain_energy" if energy else "load_displacement"]
        found[name] = Estimate.between(value, coarse[name], "J" if energy else "m", rounding * scale)
    return found


# --- second form ---------------------------------------------------------------------------------


def sphere(one: Array, two: Array, i: int, j: int) -> Array:
    """Derivative of the sphere by theta (one) and latitude (two)."""
    a, b = one + i * np.pi / 2, two + j * np.pi / 2
    up = np.sin(b) if i == 0 else np.zeros_like(b)
    return RADIUS * np.stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), up], axis=-1)


def quarter(spans: tuple[int, int], degree: int, halvings: int) -> Answer:
    """A quarter between two planes of symmetry, by splines graded toward both forces; what lifts it is held at a corner."""
    one = breaks(0.0, np.pi / 2, spans[0], (True, True), halvings)
    two = breaks(0.0, TOP, spans[1], (True,), halvings)
    free = ("free", "free")
    ends = [(("even", "zero"), free), (("zero", "even"), free), (("even", "even"), free)]
    forces = (0.0, 0.0, (FORCE / 2, 0.0, 0.0)), (np.pi / 2, 0.0, (0.0, -FORCE / 2, 0.0))
    shell = LinearShell(
        sphere, cartesian, (Splines(one, degree), Splines(two, degree)), ends, YOUNG, POISSON, THICKNESS, None, forces
    )
    return shell.solve(held=[shell.reduction.shape[1] - 1])


def _of_quarter(spans: tuple[int, int], degree: int, halvings: int) -> dict[str, float]:
    answer = quarter(spans, degree, halvings)
    theta, latitude, direction = OBLIQUE
    # Under these loads u_z is odd about theta = 45 degrees: what it is there is the rigid lift.
    lift = np.array([0.0, 0.0, answer.displacement(np.pi / 4, latitude)[2]])
    return {
        "load_displacement": float(answer.displacement(0.0, 0.0)[0]),
        "oblique_displacement": float(direction @ (answer.displacement(theta, latitude) - lift)),
        "membrane_energy": 4 * answer.membrane,
        "bending_energy": 4 * answer.bending,
        "strain_energy": 4 * answer.work,
    }


def hemisphere_by_splines(
    fine: tuple[tuple[int, int], int, int] = ((16, 12), 7, 5),
    coarse: tuple[tuple[int, int], int, int] = ((12, 10), 6, 5),
) -> dict[str, Estimate]:
    """Known values by splines on a quarter: spans, degree and halvings of two levels; the uncertainty is their change."""
    return _estimates(_of_quarter(*fine), _of_quarter(*coarse))
