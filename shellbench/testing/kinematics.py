"""Strains of a displacement from its differences: written down anew, and not taken from any solver.

eps = (a - abar)/2 and kappa = bbar - b (Kairanda et al., eqs. (15) and (16)) of the deformed surface x + u, the
derivatives of u by central differences. In linear theory they are the part of first order in u, by the same
formulas: (eps(x + s u) - eps(x - s u)) / (2 s) with a small s.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case

Array = NDArray[np.float64]
Derivatives = dict[tuple[int, int], Array]

PAIRS = ((0, 0), (1, 1), (0, 1))  # of the components 11, 22, 12
SMALL = 1e-4  # strain of the scaled displacement, whose part of third order is then 1e-8 of it


def differences(field: Callable[[Array], Array], points: Array, steps: Array) -> Derivatives:
    """Return first and second derivatives (n, 3) of a field at points (n, 2) by central differences."""
    one, two = np.array([steps[0], 0.0]), np.array([0.0, steps[1]])
    offsets = [0 * one, one, -one, two, -two, one + two, one - two, two - one, -one - two]
    u = field(np.concatenate([points + o for o in offsets])).reshape(len(offsets), len(points), 3)
    return {
        (1, 0): (u[1] - u[2]) / (2 * steps[0]),
        (0, 1): (u[3] - u[4]) / (2 * steps[1]),
        (2, 0): (u[1] - 2 * u[0] + u[2]) / steps[0] ** 2,
        (0, 2): (u[3] - 2 * u[0] + u[4]) / steps[1] ** 2,
        (1, 1): (u[5] - u[6] - u[7] + u[8]) / (4 * steps[0] * steps[1]),
    }


def forms(x: Derivatives) -> tuple[Array, Array]:
    """Return metric and curvature tensor (n, 3) each, components 11, 22, 12, of derivatives of a surface."""
    tangents = (x[1, 0], x[0, 1])
    normal = np.cross(*tangents)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    metric = [np.sum(tangents[i] * tangents[j], axis=-1) for i, j in PAIRS]
    curvature = [np.sum(x[key] * normal, axis=-1) for key in ((2, 0), (0, 2), (1, 1))]
    return np.stack(metric, axis=-1), np.stack(curvature, axis=-1)


def strains(case: Case, points: Array, u: Derivatives) -> tuple[Array, Array]:
    """Return membrane and bending strain (n, 3) of a displacement's derivatives, covariant components 11, 22, 12."""
    x = case.surface.derivatives(points, order=2)

    def moved(factor: float) -> tuple[Array, Array]:
        return forms({key: x[key] + factor * u[key] for key in u})

    if not case.linear:
        (a, b), (abar, bbar) = moved(1.0), moved(0.0)
        return (a - abar) / 2, bbar - b
    gradient = max(np.abs(u[1, 0]).max() / np.abs(x[1, 0]).max(), np.abs(u[0, 1]).max() / np.abs(x[0, 1]).max())
    s = SMALL / gradient if gradient > 0 else 1.0
    (a, b), (less_a, less_b) = moved(s), moved(-s)
    return (a - less_a) / (4 * s), (less_b - b) / (2 * s)


def lengths(case: Case, points: Array) -> Array:
    """Return (n, 3): products of the base vectors' lengths, by which covariant components become physical ones."""
    x = case.surface.derivatives(points, order=1)
    a1, a2 = np.linalg.norm(x[1, 0], axis=-1), np.linalg.norm(x[0, 1], axis=-1)
    return np.stack([a1 * a1, a2 * a2, a1 * a2], axis=-1)


def energy_densities(case: Case, points: Array, membrane: Array, bending: Array) -> tuple[Array, Array]:
    """Return membrane and bending energy density (n,), J/m^2, of strains (n, 3) (Kairanda et al., eqs. (17)-(19))."""
    metric, _ = forms(case.surface.derivatives(points, order=2))
    full = metric[:, [[0, 2], [2, 1]]]
    upper = np.linalg.inv(full)
    nu, material = case.material.poissons_ratio, case.material

    def density(stiffness: float, strain: Array) -> Array:
        mixed = np.einsum("pab,pbc->pac", upper, strain[:, [[0, 2], [2, 1]]])
        trace = np.trace(mixed, axis1=1, axis2=2)
        squared = np.einsum("pab,pba->p", mixed, mixed)
        return np.asarray(stiffness / 2 * (nu * trace**2 + (1 - nu) * squared))

    return density(material.membrane_stiffness, membrane), density(material.bending_stiffness, bending)
