r"""A quarter of a flat ring, pulled along the conormal of its inner edge: cases/pulled_ring.toml.

Lamé's solution of plane stress, u radial and positive outward:

    n_r = A - B / r^2,    n_t = A + B / r^2,    u = r (n_t - nu n_r) / (E h),

n_r = 0 at the outer edge and n_r = p at the inner one. The radial cut carries the pull on half of the inner circle,
so that the mean of n_t over its length is -p a / (b - a). It moves most at the inner edge: |u| falls outward.

The second form solves r^2 u'' + r u' - u = 0 by Chebyshev's collocation, and integrates n_t over the length.
"""

from __future__ import annotations

import numpy as np

from .estimate import Estimate

INNER, OUTER, YOUNG, POISSON, THICKNESS, PULL = 1.0, 2.0, 1e9, 0.3, 0.01, 1e4
NODES = 30
ROUNDING = 1e-12
"""Relative, of both forms."""


def _estimates(inward: float, across: float, around: float) -> dict[str, Estimate]:
    energy = PULL * np.pi / 2 * INNER * inward / 2
    found = {
        "inward": (inward, "m"),
        "across_inner_edge": (across, "N/m"),
        "around_on_cut": (around, "N/m"),
        "strain_energy": (energy, "J"),
        "largest_displacement": (inward, "m"),
    }
    return {name: Estimate(value, ROUNDING * abs(value), unit) for name, (value, unit) in found.items()}


def by_lame() -> dict[str, Estimate]:
    """Return the values in closed form."""
    b = PULL / (1 / OUTER**2 - 1 / INNER**2)
    a = b / OUTER**2
    around = a + b / INNER**2
    inward = -INNER * (around - POISSON * PULL) / (YOUNG * THICKNESS)
    return _estimates(inward, a - b / INNER**2, -PULL * INNER / (OUTER - INNER))


def by_collocation() -> dict[str, Estimate]:
    """Return the values by a polynomial in r through Chebyshev's nodes."""
    series = np.polynomial.Chebyshev
    nodes = np.cos(np.pi * (np.arange(1, NODES - 1) - 0.5) / (NODES - 2))
    r = (INNER + OUTER) / 2 + (OUTER - INNER) / 2 * nodes
    basis = [series.basis(k, domain=[INNER, OUTER]) for k in range(NODES)]
    stiffness = YOUNG * THICKNESS / (1 - POISSON**2)

    def radial(u: np.polynomial.Chebyshev, at: float) -> float:
        return float(stiffness * (u.deriv()(at) + POISSON * u(at) / at))

    rows = np.stack([r**2 * u.deriv(2)(r) + r * u.deriv()(r) - u(r) for u in basis], axis=1)
    ends = np.array([[radial(u, at) for u in basis] for at in (INNER, OUTER)]) / stiffness
    right = np.zeros(NODES)
    right[-2] = PULL / stiffness
    u = series(np.linalg.solve(np.concatenate([rows, ends]), right), domain=[INNER, OUTER])
    x, w = np.polynomial.legendre.leggauss(NODES)
    at = (INNER + OUTER) / 2 + (OUTER - INNER) / 2 * x
    around = stiffness * (u(at) / at + POISSON * u.deriv()(at))
    return _estimates(float(-u(INNER)), radial(u, INNER), float(w @ around) / 2)
