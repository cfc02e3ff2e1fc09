r"""The least membrane energy of the sleeve of Kairanda et al. 2023 (section E.2) twisted far, between two bounds.

The stress W'(eps) is that of Saint Venant and Kirchhoff, eps of the midsurface; bending only adds.

*From below, whatever the surface does, be it wrinkled or through itself.* For given strain e along a direction the
density is at least E h e^2 / 2, that of uniaxial stress. A straight line of the unrolled sleeve from rim to rim that
goes around by d has the length l0, l0^2 = L^2 + R^2 d^2. Rims turned against each other by t hold its ends at least

    l^2 = L^2 + 4 R^2 sin((t + d)/2)^2

apart, so that by Jensen's inequality its mean strain is at least e = (l^2/l0^2 - 1)/2, and the energy of all such lines

    W >= 2 pi R L E h max(e, 0)^2 / 2    for each d.

*From above.* Draw each line straight: a ruled hyperboloid. What is short across the lines wrinkles without energy in
the limit of a thin sheet (Pipkin 1986, The relaxed energy density for isotropic elastic membranes, IMA Journal of
Applied Mathematics 36). Both bounds have a slope in t, the torque, where d makes e the largest.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from .sleeve_layers import LENGTH, POISSON, RADIUS, THICKNESS, YOUNG
from .surface_strains import Array

AREA = 2 * np.pi * RADIUS * LENGTH
UNIAXIAL = YOUNG * THICKNESS
"""N/m, of a strip that is free to contract."""


def strain(twist: float, around: float) -> float:
    """Return the strain e of lines that go around by an angle, rad, between rims turned by a twist, rad."""
    rest = LENGTH**2 + (RADIUS * around) ** 2
    chord = LENGTH**2 + (2 * RADIUS * np.sin((twist + around) / 2)) ** 2
    return float((chord / rest - 1) / 2)


def steepest(twist: float) -> float:
    """Return the angle d, rad, at which e is the largest, for a twist up to half a turn."""

    def slope(d: float) -> float:
        return float(np.sin(twist + d) - d * (1 + 2 * strain(twist, d)))

    # At 0 it is sin(t) >= 0; where t + d is half a turn it is negative.
    return float(brentq(slope, 0.0, np.pi - twist, xtol=1e-14)) if twist < np.pi else 0.0


def lower_bound(twist: float) -> tuple[float, float]:
    """Return the bound from below, J, and its slope, the torque, N m, at a twist up to half a turn."""
    d = steepest(twist)
    e = max(strain(twist, d), 0.0)
    rest = LENGTH**2 + (RADIUS * d) ** 2
    return AREA * UNIAXIAL * e**2 / 2, AREA * UNIAXIAL * e * RADIUS**2 * float(np.sin(twist + d)) / rest


def upper_bound(twist: float, count: int = 400) -> float:
    """Return the relaxed energy, J, of the hyperboloid of these lines, by Gauss's rule with `count` points."""
    # s runs along a line, c from line to line; both surfaces are x = (1 - s) x0(c) + s x1(c).
    d = steepest(twist)
    x, w = np.polynomial.legendre.leggauss(count)
    s, w = (x + 1) / 2, w / 2
    turned = twist + d
    along = np.array([RADIUS * (np.cos(turned) - 1), RADIUS * np.sin(turned), LENGTH])
    first, last = RADIUS * np.array([0, 1, 0]), RADIUS * np.array([-np.sin(turned), np.cos(turned), 0])
    across = (1 - s)[:, None] * first + s[:, None] * last
    base = np.stack([np.broadcast_to(along, across.shape), across], axis=-1)
    inverse = np.linalg.inv(np.array([[RADIUS * d, RADIUS], [LENGTH, 0.0]]))
    metric = inverse.T @ np.swapaxes(base, 1, 2) @ base @ inverse
    return AREA * float(w @ relaxed_density((metric - np.eye(2)) / 2))


def relaxed_density(strains: Array) -> Array:
    """Return the least density (n,), J/m^2, of surfaces that wrinkle finely about strains (n, 2, 2)."""
    least, most = np.moveaxis(np.linalg.eigvalsh(strains), -1, 0)
    taut = UNIAXIAL / (1 - POISSON**2) / 2 * (least**2 + 2 * POISSON * least * most + most**2)
    return np.asarray(np.where(least >= -POISSON * most, taut, UNIAXIAL / 2 * np.maximum(most, 0.0) ** 2))
