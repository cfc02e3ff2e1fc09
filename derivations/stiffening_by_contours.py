r"""Swatches of cloth that stiffens once more: derivatives of the energy by Cauchy's formula, energies by the work of the bars.

The energy an area is one function of the strain tensor in the axes of the swatch, turned to those of the cloth. Its curves are
continued beyond their range by values, slopes and second derivatives that Cauchy's integral gives on a circle about the end of the range.
The first Piola-Kirchhoff stress is the derivative of W(F) by each component of the deformation gradient F, on a circle again. Silk's
width is found by bisection, so that its sides are free. The energies are the bars' forces, integrated over their way by Gauss's rule.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from .estimate import Estimate
from .stiffening import FABRICS, SHEARS, SIDE, STRETCHES, WEFT_STRETCHES, Curve, Fabric, stated

Array = np.ndarray
CIRCLE = np.exp(2j * np.pi * np.arange(32) / 32)
RADIUS, TINY = 0.01, 1e-3
"""Of the circles about the end of a range, and about a component of F."""
WAY = 24
"""Points of Gauss's rule on each piece of a way."""
ROUNDING = 1e-9


def eta(own: Curve, strain: Array) -> Array:
    """Return eta(E^2)/2 of complex strains."""
    return np.asarray(sum(m / a * ((1 + strain**2) ** a - 1) for m, a in zip(own.mu, own.alpha, strict=True)) / 2)


@cache
def taylor(own: Curve, at: float) -> tuple[float, float, float]:
    """Return the value, the slope and half of the second derivative at a strain."""
    values = eta(own, at + RADIUS * CIRCLE)
    zeroth, first, second = ((values * CIRCLE**-k).mean().real / RADIUS**k for k in range(3))
    return zeroth, first, second


def continued(own: Curve, strain: Array, least: float) -> Array:
    """Return phi of strains on a circle about a real one; the circle stays on one side of the ends, or meets them in C2."""
    middle = strain.mean().real
    if least <= middle <= own.until:
        return eta(own, strain)
    end = min(max(middle, least), own.until)
    zeroth, first, second = taylor(own, end)
    return np.asarray(zeroth + first * (strain - end) + second * (strain - end) ** 2)


def density(own: Fabric, gradient: Array, degrees: float) -> Array:
    """Return W (k,) of deformation gradients (k, 2, 2), the warp turned by an angle from x."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    axes = np.array([[c, s], [-s, c]])
    strain = axes @ (np.swapaxes(gradient, 1, 2) @ gradient - np.eye(2)) @ axes.T / 2
    a11, a12, a22, shear = own.stiffnesses
    e11, e22, e12 = strain[:, 0, 0], strain[:, 1, 1], strain[:, 0, 1]
    curves = a11 * continued(own.warp, e11, 0.0) + a22 * continued(own.weft, e22, 0.0)
    return np.asarray(curves + a12 * e11 * e22 + 2 * shear * continued(own.shear, e12, -own.shear.until))


def stress(own: Fabric, stretches: tuple[float, float], degrees: float, row: int) -> float:
    """Return the first Piola-Kirchhoff stress along x (row 0) or y (1), N/m, at two stretches."""
    gradient = np.tile(np.diag(stretches).astype(complex), (len(CIRCLE), 1, 1))
    gradient[:, row, row] += TINY * CIRCLE
    return float((density(own, gradient, degrees) / CIRCLE).mean().real / TINY)


def worked(force: Callable[[float], float], ends: tuple[float, ...]) -> float:
    """Return the integral of a function over a way, in pieces."""
    x, w = np.polynomial.legendre.leggauss(WAY)
    total = 0.0
    for begin, end in pairwise(ends):
        points = begin + (end - begin) * (1 + x) / 2
        total += (end - begin) / 2 * float(w @ [force(point) for point in points])
    return total


def pieces(own: Curve, stretch: float) -> tuple[float, ...]:
    """Return where a way from a stretch of one is cut: at the end of the range, and evenly."""
    end = float(np.sqrt(1 + 2 * own.until))
    return tuple(sorted({*np.linspace(1, stretch, 9), *([end] if end < stretch else [])}))


def silk_warp() -> dict[str, Estimate]:
    """Known values of cases/silk_warp.toml."""
    own, found = FABRICS["silk"], {}

    def width(stretch: float) -> float:
        return float(brentq(lambda other: stress(own, (stretch, other), 0.0, 1), 0.3, 1.001, xtol=1e-15))

    def force(stretch: float) -> float:
        return SIDE * stress(own, (stretch, width(stretch)), 0.0, 0)

    for name, stretch in STRETCHES.items():
        found[f"force_{name}"] = force(stretch)
        found[f"narrowing_{name}"] = SIDE / 2 * (1 - width(stretch))
        found[f"energy_{name}"] = SIDE * worked(force, pieces(own.warp, stretch))
    return stated(found, ROUNDING)


def cotton_weft() -> dict[str, Estimate]:
    """Known values of cases/cotton_weft.toml."""
    own, found = FABRICS["cotton"], {}

    def force(stretch: float) -> float:
        return SIDE * stress(own, (1.0, stretch), 0.0, 1)

    for name, stretch in WEFT_STRETCHES.items():
        found[f"force_{name}"] = force(stretch)
        found[f"side_force_{name}"] = SIDE * stress(own, (1.0, stretch), 0.0, 0)
        found[f"energy_{name}"] = SIDE * worked(force, pieces(own.weft, stretch))
    return stated(found, ROUNDING)


def canvas_bias() -> dict[str, Estimate]:
    """Known values of cases/canvas_bias.toml."""
    own, found = FABRICS["canvas"], {}

    def forces(strain: float) -> tuple[float, float]:
        stretches = float(np.sqrt(1 + 2 * strain)), float(np.sqrt(1 - 2 * strain))
        one, other = (SIDE * stress(own, stretches, 45.0, row) for row in (0, 1))
        return one, other

    def power(strain: float) -> float:  # by dl/de = 1/l and -1/l
        pull, push = forces(strain)
        return pull / np.sqrt(1 + 2 * strain) - push / np.sqrt(1 - 2 * strain)

    for name, strain in SHEARS.items():
        pull, push = forces(strain)
        found[f"pull_{name}"], found[f"push_{name}"] = pull, -push
        cuts = tuple(sorted({0.0, min(own.shear.until, strain), strain}))
        found[f"energy_{name}"] = SIDE * worked(power, cuts)
    return stated(found, ROUNDING)


SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {
    "silk_warp": silk_warp,
    "cotton_weft": cotton_weft,
    "canvas_bias": canvas_bias,
}
