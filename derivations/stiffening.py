r"""Swatches of woven cloth whose membrane stiffens: their stress is the same everywhere, and its energy is differentiated by hand.

The energy an area at the strains E of the cloth's directions (Clyde, Teran & Tamstorf 2017; eta_2 of their four curves
is x in all fabrics here) is

    W = a11/2 eta_1(E11^2) + a12 E11 E22 + a22/2 eta_3(E22^2) + G12 eta_4(E12^2),  eta(x) = sum mu/alpha ((1 + x)^alpha - 1).

With phi = eta(E^2)/2, phi' = E eta'(E^2), phi'' = eta' + 2 E^2 eta'': beyond the range, and below 0 along warp and weft, phi is
its Taylor series of second degree at the end of the range. A swatch of side b, stretched by l = sqrt(1 + 2 E), bears b l S.

**Silk along the warp**, sides free: E22 < 0 is in the continuation, so S22 = a12 E11 + a22 E22 = 0.
**Cotton along the weft**, sides held: E11 = 0, and the sides bear b a12 E22.
**Canvas along the bias**, between four bars with l^2 = 1 + 2 e along x and 1 - 2 e along y: E11 = E22 = 0, E12 = -e, and the forces
are b G12 e eta'(e^2) times the stretch of the side on which they act.

The second forms are in `stiffening_by_contours`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from .estimate import Estimate

SIDE = 0.1
ROUNDING = 1e-12
"""Relative: factors of thousands cancel."""


class Curve(NamedTuple):
    """Terms of eta, and the strain at which its range ends."""

    mu: tuple[float, ...]
    alpha: tuple[float, ...]
    until: float


class Fabric(NamedTuple):
    """Stiffnesses in N/m as printed for the released NeuralClothSim; real cloth is about a thousand times stiffer."""

    thickness: float
    stiffnesses: tuple[float, float, float, float]
    warp: Curve
    weft: Curve
    shear: Curve


FABRICS = {
    "silk": Fabric(
        0.000239,
        (4.3, 4.971, 9.942, 0.57),
        Curve((61.769, -60.769), (-2.23, -115.578), 0.41),
        Curve((13.46, -12.46), (-2.612, -195.533), 0.34),
        Curve((3213.226, -3503.817, 291.591), (-2.926, -3.205, -6.401), 0.11),
    ),
    "cotton": Fabric(
        0.000253,
        (15.557, 7.779, 25.004, 1.076),
        Curve((-352.871, 4.952, 348.919), (-63.206, -550.784, -54.525), 0.14),
        Curve((-2587.08, -285.733, 2873.813), (109.194, 102.720, 108.583), 0.14),
        Curve((8.362, -7.362), (5.973, 3.496), 0.063),
    ),
    "canvas": Fabric(
        0.00037,
        (5.366, 2.683, 19.804, 2.009),
        Curve((1881.386, -1880.386), (22.619, 22.082), 0.11),
        Curve((-27.627, 70.532, -41.905), (212.682, 149.080, 69.532), 0.067),
        Curve((19.484, -1.805, -16.679), (2.1, 0.869, 1.132), 0.059),
    ),
}
STRETCHES = {"within": 1.2, "beyond": 1.4}
"""Of silk."""
WEFT_STRETCHES = {"within": 1.1, "beyond": 1.2}
SHEARS = {"within": 0.05, "beyond": 0.1}


def curve(own: Curve, strain: float) -> tuple[float, float]:
    """Return phi and phi' at a strain that is not negative."""
    kept = min(strain, own.until)
    beyond, x = strain - kept, kept**2
    terms = list(zip(own.mu, own.alpha, strict=True))
    value = sum(m / a * np.expm1(a * np.log1p(x)) for m, a in terms) / 2
    rate = sum(m * (1 + x) ** (a - 1) for m, a in terms)
    second = rate + 2 * x * sum(m * (a - 1) * (1 + x) ** (a - 2) for m, a in terms)
    return value + kept * rate * beyond + second * beyond**2 / 2, kept * rate + second * beyond


def stated(values: Mapping[str, float], rounding: float = ROUNDING) -> dict[str, Estimate]:
    """Return estimates: forces in N, displacements in m, energies in J."""
    units = {"narrowing": "m", "energy": "J"}
    return {n: Estimate(float(v), rounding * abs(v), units.get(n.split("_")[0], "N")) for n, v in values.items()}


def silk_warp() -> dict[str, Estimate]:
    """Known values of cases/silk_warp.toml."""
    a11, a12, a22, _ = FABRICS["silk"].stiffnesses
    found = {}
    for name, stretch in STRETCHES.items():
        strain = (stretch**2 - 1) / 2
        value, rate = curve(FABRICS["silk"].warp, strain)
        across = -a12 / a22 * strain
        found[f"force_{name}"] = SIDE * stretch * (a11 * rate + a12 * across)
        found[f"narrowing_{name}"] = SIDE / 2 * (1 - np.sqrt(1 + 2 * across))
        found[f"energy_{name}"] = SIDE**2 * (a11 * value + a12 * strain * across / 2)
    return stated(found)


def cotton_weft() -> dict[str, Estimate]:
    """Known values of cases/cotton_weft.toml."""
    _, a12, a22, _ = FABRICS["cotton"].stiffnesses
    found = {}
    for name, stretch in WEFT_STRETCHES.items():
        strain = (stretch**2 - 1) / 2
        value, rate = curve(FABRICS["cotton"].weft, strain)
        found[f"force_{name}"] = SIDE * stretch * a22 * rate
        found[f"side_force_{name}"] = SIDE * a12 * strain
        found[f"energy_{name}"] = SIDE**2 * a22 * value
    return stated(found)


def canvas_bias() -> dict[str, Estimate]:
    """Known values of cases/canvas_bias.toml."""
    shear = FABRICS["canvas"].stiffnesses[3]
    found = {}
    for name, strain in SHEARS.items():
        value, rate = curve(FABRICS["canvas"].shear, strain)
        found[f"pull_{name}"] = SIDE * np.sqrt(1 + 2 * strain) * shear * rate
        found[f"push_{name}"] = SIDE * np.sqrt(1 - 2 * strain) * shear * rate
        found[f"energy_{name}"] = SIDE**2 * 2 * shear * value
    return stated(found)


JUDGES: dict[str, Callable[[], dict[str, Estimate]]] = {
    "silk_warp": silk_warp,
    "cotton_weft": cotton_weft,
    "canvas_bias": canvas_bias,
}
