r"""Frequencies and buckling loads of a cylinder on diaphragms: an eigenvalue problem of three amplitudes a double harmonic.

    u = U cos(alpha x) cos(n theta),   v = V sin(alpha x) sin(n theta),   w = W sin(alpha x) cos(n theta),   alpha = i pi / L

meets a diaphragm, v = w = 0, and is an exact solution of the linear shell with the strains of `cylinder`. In the mean
over the cylinder the energy is q . K q / 2 with K = S^T C S, the inertia m omega^2 q . q / 2, and under an axial force P
per length of the rim, in tension, the work of the stresses on the second variation of the strain is
P (u,x . u,x) / 2, that is P alpha^2 q . q / 2: u,x has the components (U', V', W') in the turning frame. Poisson's ratio
zero keeps the cylinder straight before it buckles, so that nothing else acts. Hence

    det (K - m omega^2) = 0,        det (K - lambda P alpha^2) = 0    (P pressure at load factor 1):

both are eigenvalues of K. All harmonics with n > 0 occur twice, turned by a quarter of a wave. For n = 0 and for i = 0
the harmonics that have no amplitude are left out.

The second form keeps the harmonic around the axis, and has B-splines along it (`revolution_splines`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.linalg import eigh, null_space

from .cylinder import Cylinder, strains_of_double_harmonic
from .plate_modes import Array, Values, numbered
from .revolution_splines import SplineRevolution
from .spline_shell import Splines

VIBRATING = Cylinder(1.0, 2.0, 0.01, 2e11, 0.3)
DENSITY = 80.0  # kg a square metre
PRESSED = Cylinder(1.0, 1.0, 0.03, 2e11, 0.0)
PRESSURE = 1e8  # N a metre of the rim, at load factor 1
WAVES = 40
DEGREE, SPANS = 8, (8, 12)
ROUNDING, ROUNDING_OF_SPLINES = 1e-12, 1e-8


def harmonics(shell: Cylinder, waves: int = WAVES) -> tuple[Array, Array, Array]:
    """Return half waves i (k,), waves n (k,) and the eigenvalues (k, 3) of K, N/m^3, of all double harmonics."""
    i, n = (part.ravel() for part in np.meshgrid(np.arange(1, waves + 1), np.arange(waves + 1), indexing="ij"))
    strains = strains_of_double_harmonic(shell.radius, i * np.pi / shell.length, n)
    stiffness = np.swapaxes(strains, 1, 2) @ sum(shell.elasticity()) @ strains
    values = np.linalg.eigvalsh(stiffness)
    # of n = 0 the amplitude V has no strain here: its eigenvalue, zero, is none
    values[n == 0, 0] = np.inf
    return i, n, values


def frequencies(count: int) -> Array:
    """Return the first frequencies, Hz, each as often as it occurs."""
    _, n, values = harmonics(VIBRATING)
    each = np.sqrt(values / DENSITY) / (2 * np.pi)
    return np.sort(np.repeat(each, np.where(n > 0, 2, 1), axis=0).ravel())[:count]


def load_factors(count: int) -> Array:
    """Return the first load factors, each as often as it occurs."""
    i, n, values = harmonics(PRESSED)
    each = values[:, 0] / (PRESSURE * (i * np.pi / PRESSED.length) ** 2)
    each[n == 0] = values[n == 0, 1] / (PRESSURE * (i[n == 0] * np.pi / PRESSED.length) ** 2)
    return np.sort(np.repeat(each, np.where(n > 0, 2, 1)))[:count]


def by_splines(shell: Cylinder, buckling: bool, count: int, spans: int) -> Array:
    """Return the first frequencies, Hz, or load factors, of harmonics n > 0 with splines along the axis."""
    line = Splines(np.linspace(0.0, shell.length, spans + 1), DEGREE)
    radius = shell.radius

    def curve(t: Array) -> tuple[Array, Array]:
        o, one = np.zeros_like(t), np.ones_like(t)
        return np.array([radius * one, o, o, o]), np.array([t, one, o, o])

    solid = SplineRevolution(curve, line, shell.young, shell.poisson, shell.thickness)
    points, weights = (part.ravel() for part in line.gauss)
    held = np.array([solid.row(c, end) for c in (0, 1) for end in (0.0, shell.length)])
    allowed = null_space(held)
    value = line.matrix(points, int(buckling))
    product = np.pi * radius * np.kron(np.eye(3), value.T @ (weights[:, None] * value))
    ahead = allowed.T @ ((PRESSURE if buckling else DENSITY) * product) @ allowed
    found = []
    for n in range(1, WAVES // 2):
        stiffness = allowed.T @ sum(solid.stiffnesses(n)) @ allowed
        size = len(stiffness)
        reciprocal = eigh(ahead, stiffness, eigvals_only=True, subset_by_index=(size - count, size - 1))
        found += [1 / reciprocal] * 2
    values = np.sort(np.concatenate(found))[:count]
    return values if buckling else np.sqrt(values) / (2 * np.pi)


def modes() -> Values:
    """Known values of cases/cylinder_modes.toml."""
    return numbered(frequencies(10), None, "frequency", "Hz", ROUNDING)


def compression() -> Values:
    """Known values of cases/cylinder_compression.toml."""
    return numbered(load_factors(6), None, "load_factor", "", ROUNDING)


def with_splines(shell: Cylinder, buckling: bool, count: int, name: str, unit: str) -> Values:
    """Known values by splines along the axis."""
    coarse, fine = (by_splines(shell, buckling, count, spans) for spans in SPANS)
    return numbered(fine, coarse, name, unit, ROUNDING_OF_SPLINES)


JUDGES: dict[str, Callable[[], Values]] = {"cylinder_modes": modes, "cylinder_compression": compression}
SECOND_FORMS: dict[str, Callable[[], Values]] = {
    "cylinder_modes": partial(with_splines, VIBRATING, False, 10, "frequency", "Hz"),
    "cylinder_compression": partial(with_splines, PRESSED, True, 6, "load_factor", ""),
}
