r"""A plank on an uneven bed, pressed from rest: cases/sprung_motion.toml, in mm, t and s.

Nothing varies across the plank: w(x, t) obeys rho w'' + B w,xxxx + k(x) w = p(x), with w and w,xx zero at both ends, a steady
load p, a bed k that jumps at one place and has a kink at another, and B = E h^3 / 12 (Poisson's ratio is zero). Of its modes, with K a = f at
rest, each swings as a (1 - cos omega t), and kinetic energy, those of bending and of springs, and the work of the load sum to zero.

The judge expands in sines, with the bed's integrals in closed form. The second form takes splines of degree 5 that may jump in
their fourth derivative where the bed does, and integrates by Gauss's rule.

The case asks for large displacements. One end slides, so that the plank stretches by none of first order; slopes are 1e-5, and
what is not linear is of the order of their squares: `STIFFENING`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import legendre
from scipy.interpolate import BSpline
from scipy.linalg import eigh

from .estimate import Estimate

L, WIDTH = 9000.0, 1500.0  # mm
YOUNG, THICKNESS, DENSITY = 1e4, 800.0, 5e-7  # MPa, mm, t/mm^2
BED, JUMP, STEP, KINK = 1.6e-2, 5580.0, 0.6, 4500.0  # N/mm^3, mm, 1, mm
PRESSURES = {1: -2.4e-5, 2: -1e-5}  # of the sines, along z, N/mm^2
TIMES = (0.01,)
POINTS = 2790.0, 6310.0, 7600.0
STIFFNESS = YOUNG * THICKNESS**3 / 12
STIFFENING = 1e-8
"""Relative uncertainty of what is linear."""
TERMS = 60, 120
SPANS = 6, 10  # of each of three parts
DEGREE = 5

Array = np.ndarray


def bed(x: Array) -> Array:
    """k, N/mm^3."""
    return np.asarray(BED * (1 + np.where(x < JUMP, 0.0, STEP) + np.abs(x - KINK) / L))


def _of_cosine(wave: int) -> float:
    """The integral of k cos(n pi x / L) along the plank, N/mm^2."""
    q = wave * np.pi / L
    if wave == 0:
        return BED * (L + STEP * (L - JUMP) + (KINK**2 + (L - KINK) ** 2) / (2 * L))
    ends = (np.sin(q * L) * (L - KINK) / q + np.cos(q * L) / q**2 + 1 / q**2 - 2 * np.cos(q * KINK) / q**2) / L
    return float(BED * (-STEP * np.sin(q * JUMP) / q + ends))


def _swung(
    stiffness: tuple[Array, Array], mass: Array, force: Array, at: Callable[[Array], Array]
) -> dict[str, tuple[float, str]]:
    """Values from matrices of bending and bed and of mass, a steady force, and a table of the functions at places."""
    bending, springs = stiffness
    squares, modes = eigh(bending + springs, mass)
    share = modes.T @ force / squares
    rate = np.sqrt(squares)
    tables, values = at(np.array(POINTS)), {}
    for time in TIMES:
        q = modes @ (share * (1 - np.cos(rate * time)))
        speed = modes @ (share * rate * np.sin(rate * time))
        label, w = f"{1000 * time:.0f}ms", tables @ q
        values[f"deflection_{label}"] = -float(w[0]), "mm"
        values[f"kinetic_energy_{label}"] = WIDTH * float(speed @ mass @ speed) / 2, "N mm"
        values[f"bending_energy_{label}"] = WIDTH * float(q @ bending @ q) / 2, "N mm"
        values[f"total_energy_{label}"] = (
            WIDTH * float((speed @ mass @ speed + q @ (bending + springs) @ q) / 2 - force @ q),
            "N mm",
        )
    values[f"mean_oblique_{label}"] = -2 / 3 * float(w.mean()), "mm"
    return values


def _by_sines(count: int) -> dict[str, tuple[float, str]]:
    n = np.arange(1, count + 1)
    cosines = np.array([_of_cosine(int(k)) for k in range(2 * count + 1)])
    springs = (cosines[np.abs(n[:, None] - n)] - cosines[n[:, None] + n]) / 2
    bending = np.diag(STIFFNESS * (n * np.pi / L) ** 4 * L / 2)
    force = np.array([PRESSURES.get(int(k), 0.0) * L / 2 for k in n])
    return _swung(
        (bending, springs), np.eye(count) * DENSITY * L / 2, force, lambda x: np.sin(x[:, None] * n * np.pi / L)
    )


def _estimates(fine: dict[str, tuple[float, str]], coarse: dict[str, tuple[float, str]]) -> dict[str, Estimate]:
    kinetic = fine[f"kinetic_energy_{1000 * TIMES[0]:.0f}ms"][0]
    return {
        name: Estimate.between(value, coarse[name][0], unit, STIFFENING * (kinetic if "total" in name else abs(value)))
        for name, (value, unit) in fine.items()
    }


def sprung_motion() -> dict[str, Estimate]:
    """Known values by sines; uncertain by what fewer change, and by what is not linear."""
    coarse, fine = (_by_sines(count) for count in TERMS)
    return _estimates(fine, coarse)


def _by_splines(spans: int) -> dict[str, tuple[float, str]]:
    parts = [np.linspace(a, b, spans + 1) for a, b in ((0.0, KINK), (KINK, JUMP), (JUMP, L))]
    ends = np.unique(np.concatenate(parts))
    knots = np.sort(np.concatenate([[0.0] * DEGREE, ends, [JUMP], [L] * DEGREE]))
    count = len(knots) - DEGREE - 1
    splines = BSpline(knots, np.eye(count), DEGREE)
    nodes, weights = legendre.leggauss(2 * DEGREE)
    x = (ends[:-1, None] + np.diff(ends)[:, None] * (nodes + 1) / 2).ravel()
    dx = (np.diff(ends)[:, None] * weights / 2).ravel()
    w, bent = splines(x)[:, 1:-1], splines.derivative(2)(x)[:, 1:-1]
    pressure = sum(p * np.sin(m * np.pi * x / L) for m, p in PRESSURES.items())
    bending, springs = ((f * (dx * k)[:, None]).T @ f for f, k in ((bent, STIFFNESS), (w, bed(x))))
    mass = (w * (dx * DENSITY)[:, None]).T @ w
    return _swung((bending, springs), mass, (dx * pressure) @ w, lambda at: splines(at)[:, 1:-1])


def sprung_motion_by_splines() -> dict[str, Estimate]:
    """Known values by splines; uncertain by what fewer change, and by what is not linear."""
    coarse, fine = (_by_splines(spans) for spans in SPANS)
    return _estimates(fine, coarse)
