r"""Modes of a strip between guides that are turned against each other: cases/bent_strip_modes.toml.

Guides hold the displacement u along the strip and the slope of w across it. Turned by an angle, they bend the strip with
a moment m = B angle / L that is the same everywhere. Poisson's ratio is zero, and modes are the same across the width.

The bending strain is kappa = (u'' w' - w'' (1 + u')) / sqrt((1 + u')^2 + w'^2), of second order -w'' + u'' w'. So about
the bent state, whose moment is all that a linear answer hands on, the energy of small motions is

    int D u'^2 / 2 + B w''^2 / 2 + m u'' w' ds,    with the mass of both.

Closed form: u = U sin(k s), w = W cos(k s), k = n pi / L, meet the guides and the equations of motion, and

    (D k^2 - rho omega^2) (B k^4 - rho omega^2) = m^2 k^6.

Second form: Ritz's method with polynomials, and the second derivatives of kappa by differences of the strain itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh

from .estimate import Estimate

Array = np.ndarray
Values = dict[str, Estimate]

LENGTH, YOUNG, THICKNESS, DENSITY = 1.0, 2e11, 0.05, 400.0  # m, Pa, m, kg a square metre
ANGLE = np.pi / 2  # between the guides
STRETCHING, BENDING = YOUNG * THICKNESS, YOUNG * THICKNESS**3 / 12
MOMENT = BENDING * ANGLE / LENGTH
COUNT = 2
STEP = 1e-2  # of differences of the strain
ROUNDING = 1e-9
"""Relative, of frequencies by polynomials and differences."""


def by_waves() -> Array:
    """Return the first frequencies, Hz."""
    k = np.arange(1, 5 * COUNT) * np.pi / LENGTH
    stretched, bent, coupled = STRETCHING * k**2, BENDING * k**4, MOMENT * k**3
    upper = (stretched + bent) / 2 + np.sqrt(((stretched - bent) / 2) ** 2 + coupled**2)
    lower = (stretched * bent - coupled**2) / upper
    return np.sort(np.sqrt(np.concatenate([lower, upper]) / DENSITY) / (2 * np.pi))[:COUNT]


def strain(slopes: Array) -> float:
    """Return the bending strain of u', u'', w', w''."""
    u1, u2, w1, w2 = slopes
    return float((u2 * w1 - w2 * (1 + u1)) / np.hypot(1 + u1, w1))


def curvature_of_strain(step: float) -> Array:
    """Return the second derivatives (4, 4) of the bending strain at rest by central differences."""
    found, unit = np.empty((4, 4)), step * np.eye(4)
    for i, a in enumerate(unit):
        for j, b in enumerate(unit):
            found[i, j] = (strain(a + b) - strain(a - b) - strain(b - a) + strain(-a - b)) / (4 * step**2)
    return found


def by_polynomials(functions: int) -> Array:
    """Return the first frequencies, Hz, with so many polynomials for u and as many for w."""
    # 1. u has zeros at both ends, w' has them: w is the integral of such a one, or a constant, which is no vibration.
    # 2. Second derivatives of the strain: central differences, and Richardson's step from h to h / 2.
    x, weights = legendre.leggauss(functions + 6)
    half = LENGTH / 2
    bubble = np.array([2 / 3, 0.0, -2 / 3])  # 1 - x^2
    held = [legendre.legmul(bubble, one) for one in np.eye(functions)]
    zero = np.zeros((len(x), functions + 1))
    u = [
        np.column_stack([zero[:, :1], *(legendre.legval(x, legendre.legder(c, k)) / half**k for c in held)])
        for k in range(3)
    ]
    first = [legendre.legint(c) for c in held]
    w = (
        [legendre.legval(x, c) * half for c in first],
        *([legendre.legval(x, legendre.legder(c, k)) / half**k for c in held] for k in range(2)),
    )
    w = [np.column_stack([zero[:, 0] + (k == 0), *rows]) for k, rows in enumerate(w)]
    rows = [np.hstack([u[1], zero]), np.hstack([u[2], zero]), np.hstack([zero, w[1]]), np.hstack([zero, w[2]])]
    second = (4 * curvature_of_strain(STEP / 2) - curvature_of_strain(STEP)) / 3
    forms = MOMENT * second + np.diag([STRETCHING, 0.0, 0.0, BENDING])
    over = half * weights
    stiffness = sum(forms[i, j] * rows[i].T @ (over[:, None] * rows[j]) for i in range(4) for j in range(4))
    across = [np.hstack([u[0], zero]), np.hstack([zero, w[0]])]
    mass = DENSITY * sum(row.T @ (over[:, None] * row) for row in across)
    own = np.arange(2 * functions + 2) != 0  # the column of u beside the constant w is empty
    values = eigh(stiffness[np.ix_(own, own)], mass[np.ix_(own, own)], eigvals_only=True)
    return np.sqrt(values[1 : COUNT + 1]) / (2 * np.pi)


def _numbered(fine: Array, coarse: Array, rounding: float) -> Values:
    both = zip(fine, coarse, strict=True)
    return {
        f"frequency_{n}": Estimate.between(value, other, "Hz", rounding * value)
        for n, (value, other) in enumerate(both, start=1)
    }


JUDGES: dict[str, Callable[[], Values]] = {"bent_strip_modes": lambda: _numbered(by_waves(), by_waves(), 1e-14)}
SECOND_FORMS: dict[str, Callable[[], Values]] = {
    "bent_strip_modes": lambda: _numbered(by_polynomials(14), by_polynomials(11), ROUNDING)
}
