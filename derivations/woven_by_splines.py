r"""Orthotropic shells once more, by least energy: B-splines for plates and strips, constant strains, polynomials in a plane.

The energy is taken along the axes of the material, d1 = (cos t, sin t) and d2 = (-sin t, cos t): of plates by the second
derivatives d_i . grad grad w . d_j, of the swatch by d_i . E d_j for a strain E that is sought. Nothing is turned but
directions. The tube's energy is that of positions on a circle that grows and slides: strains by differences of squared
lengths, curvatures by bbar - b, both of first order.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.linalg import eigh

from .cusick_by_splines import cusick_drape_by_splines
from .estimate import Estimate
from .plane_strip import SPREAD, PlaneStrip
from .spline_shell import Splines
from .stiffening_by_contours import SECOND_FORMS as STIFFENING
from .woven import (
    ANGLE,
    BIAS,
    CLOTH,
    DENSITY,
    FORCES,
    LOAD,
    PLIES,
    POINTS,
    PRESSED,
    SIDES,
    STRIP,
    STRIP_LOAD,
    STRIP_POINTS,
    TUBE,
    WOOD,
    Array,
    Four,
    of_bias_strip,
    of_plate,
    of_swatch,
    of_tube,
)

DEGREE = 7
SPANS, STRIP_SPANS = ((12, 12), (16, 16)), ((12, 8), (18, 12))
POLYNOMIALS, STEPS = 40, 12
STEP = 1e-30
"""Of complex derivatives."""


def wood() -> Array:
    """Return Q (3, 3) of one layer, Pa: the inverse of its compliances."""
    young, other, poisson, shear, _ = WOOD
    return np.linalg.inv([[1 / young, -poisson / young, 0], [-poisson / young, 1 / other, 0], [0, 0, 1 / shear]])


def _matrix(four: Four) -> Array:
    first, coupled, second, shear = four
    return np.array([[first, coupled, 0], [coupled, second, 0], [0, 0, shear]])


class Plate:
    """A rectangle in splines, w and its derivatives on Gauss's points of all spans.

    Its stiffness is that of D (3, 3) along axes that are turned from x by an angle.
    """

    def __init__(self, breaks: tuple[Array, Array], ends: tuple[tuple[str, str], tuple[str, str]]) -> None:
        self.lines = [Splines(b, DEGREE) for b in breaks]
        self.kept = [line.reduction(end).toarray() for line, end in zip(self.lines, ends, strict=True)]  # type: ignore[arg-type]
        self.weights = [line.gauss[1].ravel() for line in self.lines]

    def product(self, one: tuple[int, int], other: tuple[int, int]) -> Array:
        """Return the integral of the products of two derivatives."""
        sides = []
        for axis, line in enumerate(self.lines):
            at = line.gauss[0].ravel()
            first, second = (line.matrix(at, order[axis]) @ self.kept[axis] for order in (one, other))
            sides.append((first.T * self.weights[axis]) @ second)
        return np.kron(*sides)

    def values(self, points: list[tuple[float, float]]) -> Array:
        """Return w of every function at points, (points, functions)."""
        return np.array(
            [
                np.kron(
                    *(line.matrix(np.array([x]), 0)[0] @ k for line, k, x in zip(self.lines, self.kept, p, strict=True))
                )
                for p in points
            ]
        )

    def load(self) -> Array:
        """Return the integrals of the functions."""
        return np.kron(
            *(
                w @ line.matrix(line.gauss[0].ravel(), 0) @ k
                for line, k, w in zip(self.lines, self.kept, self.weights, strict=True)
            )
        )

    def stiffness(self, bending: Array, angle: float) -> Array:
        """Return the second derivative of the energy by the coefficients."""
        d1, d2 = (np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))
        total = np.zeros((1, 1))
        orders = {(0, 0): (2, 0), (1, 1): (0, 2), (0, 1): (1, 1), (1, 0): (1, 1)}
        curvatures = [
            {ab: factor * d[ab[0]] * e[ab[1]] for ab in orders}
            for d, e, factor in ((d1, d1, 1), (d2, d2, 1), (d1, d2, 2))
        ]
        for (ab, one), (cd, other) in ((x, y) for x in orders.items() for y in orders.items()):
            factor = sum(bending[i, j] * curvatures[i][ab] * curvatures[j][cd] for i in range(3) for j in range(3))
            total = total + factor * self.product(one, other)
        return np.asarray(total + total.T) / 2


HELD = ("held", "held"), ("held", "held")


def supported(spans: tuple[int, int]) -> Plate:
    """Return a supported plate of the sides in common."""
    first, second = (np.linspace(0, side, n + 1) for side, n in zip(SIDES, spans, strict=True))
    return Plate((first, second), HELD)


def solved(stiffness: Array, load: Array) -> Array:
    """Return the coefficients that balance a load; the stiffness is scaled, so that few digits are lost."""
    scale = 1 / np.sqrt(np.diag(stiffness))
    return np.asarray(scale * np.linalg.solve(scale[:, None] * stiffness * scale, scale * load))


def woven_plate() -> dict[str, Estimate]:
    """Known values of cases/woven_plate.toml."""
    levels = []
    for spans in SPANS:
        plate = supported(spans)
        load = LOAD * plate.load()
        found = solved(plate.stiffness(wood() * WOOD[4] ** 3 / 12, np.pi / 2), load)
        levels.append(np.array([*(plate.values(list(POINTS)) @ found), load @ found / 2]))
    return of_plate(levels[1], levels[0], 1e-9)


def _numbered(name: str, unit: str, levels: list[Array]) -> dict[str, Estimate]:
    return {
        f"{name}_{k}": Estimate.between(fine, coarse, unit, 1e-9 * fine)
        for k, (coarse, fine) in enumerate(zip(*levels, strict=True), 1)
    }


def woven_plate_modes() -> dict[str, Estimate]:
    """Known values of cases/woven_plate_modes.toml."""
    levels = []
    for spans in SPANS:
        plate = supported(spans)
        mass = DENSITY * plate.product((0, 0), (0, 0))
        squares = eigh(plate.stiffness(_matrix(PLIES), 0.0), mass, eigvals_only=True, subset_by_index=(0, 5))
        levels.append(np.sqrt(squares) / (2 * np.pi))
    return _numbered("frequency", "Hz", levels)


def woven_plate_buckling() -> dict[str, Estimate]:
    """Known values of cases/woven_plate_buckling.toml."""
    levels = []
    for spans in SPANS:
        plate = supported(spans)
        pressed, stiffness = plate.product((1, 0), (1, 0)), plate.stiffness(wood() * WOOD[4] ** 3 / 12, np.pi / 2)
        size = len(stiffness)
        largest = eigh(pressed, stiffness, eigvals_only=True, subset_by_index=(size - 3, size - 1))
        levels.append(1 / largest[::-1] / PRESSED)
    return _numbered("load_factor", "", levels)


def woven_swatch() -> dict[str, Estimate]:
    """Known values of cases/woven_swatch.toml: the strain of least energy."""
    d1, d2 = np.array([np.cos(ANGLE), np.sin(ANGLE)]), np.array([-np.sin(ANGLE), np.cos(ANGLE)])
    units = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 0.5], [0.5, 0]]])  # of e11, e22 and twice e12
    own = np.stack([[d1 @ e @ d1, d2 @ e @ d2, 2 * d1 @ e @ d2] for e in units], axis=1)
    stiffness = WOOD[4] * wood()
    strain = np.linalg.solve(own.T @ stiffness @ own, FORCES)
    return of_swatch(strain, stiffness @ own @ strain)


def woven_tube() -> dict[str, Estimate]:
    """Known values of cases/woven_tube.toml: the least energy over growth and axial strain."""
    radius, membrane, bending = TUBE["radius"], _matrix(TUBE["membrane"]), _matrix(TUBE["bending"])

    def strains(growth: complex, longer: complex) -> tuple[list[complex], list[complex]]:
        # the metric and -b of a circle by its arc before
        around = (radius + growth) / radius
        return [(around**2 - 1) / 2, ((1 + longer) ** 2 - 1) / 2, 0], [around / radius - 1 / radius, 0, 0]

    def first_order(*unit: complex) -> tuple[Array, Array]:
        one, two = strains(*(STEP * 1j * u for u in unit))
        return np.imag(one) / STEP, np.imag(two) / STEP

    modes = [first_order(1, 0), first_order(0, 1)]
    energy = np.array([[e @ membrane @ f + k @ bending @ m for f, m in modes] for e, k in modes])
    growth, longer = np.linalg.solve(energy, [TUBE["pressure"], 0])
    return of_tube(growth, longer, 1e-13)


def woven_cantilever(way: str) -> dict[str, Estimate]:
    """Known values of cases/woven_cantilever_*.toml: virtual work in polynomials of the position."""
    stretching, stiffness, gammas = CLOTH[way]
    thickness = (12 * stiffness / stretching) ** 0.5
    plane = PlaneStrip(1.0, thickness, stretching / thickness, POLYNOMIALS)
    marks = np.unique(np.append((np.arange(1, STEPS + 1) / STEPS) ** 3, np.array(gammas) / gammas[-1]))
    found = {bent.factor: bent for bent in plane.path(marks, weight=gammas[-1] * stiffness)}
    values = {}
    for gamma in gammas:
        bent = found[gamma / gammas[-1]]
        values[f"drop_{gamma}"] = Estimate(-bent.deflection, 10 * SPREAD, "m")
        values[f"shortening_{gamma}"] = Estimate(bent.shortening, 10 * SPREAD, "m")
    return values


def toward_both_ends(spans: int) -> Array:
    """Return ends of spans of [0, 1] that grow as squares from both ends."""
    s = np.linspace(0.0, 1.0, spans + 1)
    return np.where(s < 0.5, 2 * s**2, 1 - 2 * (1 - s) ** 2)


def woven_bias_strip() -> dict[str, Estimate]:
    """Known values of cases/woven_bias_strip.toml."""
    levels = []
    for along, aside in STRIP_SPANS:
        breaks = STRIP[0] * np.linspace(0.0, 1.0, along + 1) ** 2, STRIP[1] * toward_both_ends(aside)
        plate = Plate(breaks, (("clamped", "free"), ("free", "free")))
        load, stiffness = STRIP_LOAD * plate.load(), plate.stiffness(_matrix(BIAS), ANGLE)
        found = solved(stiffness, load)
        levels.append(np.array([*(plate.values(list(STRIP_POINTS.values())) @ found), load @ found / 2]))
    return of_bias_strip(levels[1], levels[0], 1e-8)


SECOND_FORMS: dict[str, Callable[[], dict[str, Estimate]]] = {
    "woven_plate": woven_plate,
    "woven_plate_modes": woven_plate_modes,
    "woven_plate_buckling": woven_plate_buckling,
    "woven_swatch": woven_swatch,
    "woven_tube": woven_tube,
    "woven_cantilever_warp": partial(woven_cantilever, "warp"),
    "woven_cantilever_weft": partial(woven_cantilever, "weft"),
    "woven_bias_strip": woven_bias_strip,
    **STIFFENING,
    "cusick_drape": cusick_drape_by_splines,
}
