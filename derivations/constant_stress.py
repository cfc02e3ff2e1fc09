r"""Plates and a sleeve whose stress is the same everywhere, in closed form.

**Parallelogram, twisted and stretched.** With unit vectors t1, t2 along its edges, moments M = m (t1 t2 + t2 t1) leave all
four edges free of bending moments and, being constant, of Kirchhoff's shear. Forces are left at the corners,
2 m sin(alpha) at the angle alpha between the edges, of alternating sign. So w is a quadratic whose curvatures K obey
M = B ((1 - nu) K + nu tr(K) I). The edge loads N.n stretch it by E h eps = (1 + nu) N - nu tr(N) I. Its middle stays, and
it turns by omega so that the mean of x cross u vanishes.

**Swatch.** The parallelogram at a right angle, its middle and three of its corners at rest.

**Plate, bent.** Moments M1, M2 a length at its edges bend it to w,11 = (M1 - nu M2) / (B (1 - nu^2)), likewise w,22. The mean
of w is zero.

**Sleeve, sheared and blown up.** u = w e_r + (y - y0) (gamma e_t + e e_y), y0 the middle. With -w/R^2 and -gamma/R as changes of
curvature, around and of twist, the potential energy an area is

    (E h / R^2 + B / R^4) w^2 / 2 - p w + (G h + 2 (1 - nu) B / R^2) gamma^2 / 2 - tau gamma,    e = -nu w / R,

and the slopes that are held at the rims take the moment -nu B w / R^2 along the axis.

The second forms, in `constant_stress_by_ritz`, take no stress to be constant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .estimate import Estimate
from .surface_strains import Array

YOUNG, POISSON = 1e7, 0.3
OBLIQUE = np.array([1.0, 2.0, -2.0]) / 3.0
ROUNDING = 1e-12  # relative


@dataclass(frozen=True)
class Parallelogram:
    """Corner A, edges e1, e2 from it, m; thickness, m; corner force, N; edge forces N^ab, N/m; the rest of w at A."""

    corner: Array
    edges: Array
    thickness: float = 0.05
    force: float = -30.0
    stretching: tuple[tuple[float, float], tuple[float, float]] = ((2e4, -1e4), (-1e4, 1e4))
    slope: tuple[float, float] = (0.05, -0.1)
    height: float = 0.02

    @property
    def bending_stiffness(self) -> float:
        """B, N m."""
        return YOUNG * self.thickness**3 / 12 / (1 - POISSON**2)

    @property
    def area(self) -> float:
        """Area, m^2."""
        return float(abs(np.linalg.det(self.edges)))


def chart(xi: tuple[float, float]) -> Array:
    """Position (2,) of a point of cases/twisted_parallelogram.toml."""
    y = xi[1] / (2 - xi[1])
    return np.array([np.arcsin(xi[0]) + 0.5 * y, y])


def parallelogram() -> Parallelogram:
    """The plate of cases/twisted_parallelogram.toml."""
    corner, right, left = chart((-0.8, 0.5)), chart((0.9, 0.5)), chart((-0.8, 1.2))
    return Parallelogram(corner, np.stack([right - corner, left - corner]))


PARALLELOGRAM_POINTS = (0.7, 1.1), (-0.3, 0.6), (0.5, 0.8)
HINGE_AXIS, HINGE_CENTRE = np.array([0.6, 0.8, 0.0]), np.array([0.2, 0.1, 0.0])


def measured(displacement: Callable[[Array], Array], plate: Parallelogram) -> dict[str, float]:
    """Values of cases/twisted_parallelogram.toml for a displacement (3,) by positions (2,), m."""
    places = [chart(xi) for xi in PARALLELOGRAM_POINTS]
    corner = displacement(plate.corner + plate.edges.sum(axis=0))
    return {
        "corner_deflection": -float(corner[2]),
        "mean_oblique": float(np.mean([displacement(p) @ OBLIQUE for p in places])),
        "slide": float(displacement(places[0]) @ [0.5**0.5, -(0.5**0.5), 0.0]),
        "largest_displacement": float(np.linalg.norm(corner)),
    }


def twisted_parallelogram() -> dict[str, Estimate]:
    """Known values of cases/twisted_parallelogram.toml."""
    plate = parallelogram()
    one, two = (e / np.linalg.norm(e) for e in plate.edges)
    sine = one[0] * two[1] - one[1] * two[0]
    moments = plate.force / (2 * sine) * (np.outer(one, two) + np.outer(two, one))
    bent = (moments - POISSON / (1 + POISSON) * np.trace(moments) * np.eye(2)) / (1 - POISSON) / plate.bending_stiffness
    forces = np.array(plate.stretching)
    strain = ((1 + POISSON) * forces - POISSON * np.trace(forces) * np.eye(2)) / (YOUNG * plate.thickness)
    middle = plate.corner + plate.edges.sum(axis=0) / 2
    inertia = plate.edges.T @ plate.edges / 12
    turned = strain @ inertia
    omega = (turned[0, 1] - turned[1, 0]) / np.trace(inertia)
    gradient = strain + omega * np.array([[0.0, -1.0], [1.0, 0.0]])

    def displacement(p: Array) -> Array:
        arm = p - plate.corner
        return np.array([*(gradient @ (p - middle)), plate.height + arm @ plate.slope + arm @ bent @ arm / 2])

    membrane, bending = (plate.area / 2 * float(np.sum(a * b)) for a, b in ((forces, strain), (moments, bent)))
    # The edge's support pushes by the force at its lower end, and by the opposite at its upper one.
    couple = np.cross(-np.array([*plate.edges[1], 0.0]), [0.0, 0.0, plate.force])
    return {name: _rounded(value, "m") for name, value in measured(displacement, plate).items()} | {
        "strain_energy": _rounded(membrane + bending, "J"),
        "membrane_energy": _rounded(membrane, "J"),
        "bending_energy": _rounded(bending, "J"),
        "prop_force": _rounded(-plate.force, "N"),
        "hinge_moment": _rounded(float(couple @ HINGE_AXIS), "N m"),
    }


# --- the swatch --------------------------------------------------------------------------------------

SIDE, SWATCH_THICKNESS, CORNER_FORCE = 1.0, 0.01, -0.01
SWATCH_FORCES = np.array([[100.0, 50.0], [50.0, 0.0]])
"""Edge forces N^ab of cases/swatch.toml, N/m."""


def measured_swatch(displacement: Callable[[Array], Array]) -> dict[str, float]:
    """Values of cases/swatch.toml for a displacement (3,) by positions (2,), m."""
    corner, right, top = (displacement(SIDE * np.array(p)) for p in ((1.0, 1.0), (1.0, 0.5), (0.5, 1.0)))
    return {
        "twist": -float(corner[2]),
        "stretch": float(right[0]),
        "contraction": -float(top[1]),
        "shear": float(right[1]),
        "largest_displacement": float(np.linalg.norm(corner)),
    }


def swatch() -> dict[str, Estimate]:
    """Known values of cases/swatch.toml: the parallelogram's stresses at a right angle, its corners held."""
    stiffness = YOUNG * SWATCH_THICKNESS
    bending = stiffness * SWATCH_THICKNESS**2 / 12 / (1 - POISSON**2)
    strain = ((1 + POISSON) * SWATCH_FORCES - POISSON * np.trace(SWATCH_FORCES) * np.eye(2)) / stiffness
    twist = CORNER_FORCE / (2 * bending * (1 - POISSON))

    def displacement(p: Array) -> Array:
        return np.array([*(strain @ (p - SIDE / 2)), twist * p[0] * p[1]])

    membrane = SIDE**2 / 2 * float(np.sum(SWATCH_FORCES * strain))
    bent = SIDE**2 * bending * (1 - POISSON) * twist**2
    values = {name: _rounded(value, "m") for name, value in measured_swatch(displacement).items()}
    energies = ("strain_energy", membrane + bent), ("membrane_energy", membrane), ("bending_energy", bent)
    return values | {name: _rounded(value, "J") for name, value in energies}


# --- the bent plate ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class BentPlate:
    """Half of a plate, 0 <= x <= length: its sides and thickness, m, and the moments at its edges, N."""

    length: float = float(np.sinh(0.8))
    sides: tuple[float, float] = (float(np.log(0.6)), float(np.log(1.5)))
    thickness: float = 0.05
    moments: tuple[float, float] = (12.0, -5.0)

    @property
    def bending_stiffness(self) -> float:
        """B, N m."""
        return YOUNG * self.thickness**3 / 12 / (1 - POISSON**2)


def bent_chart(xi: tuple[float, float]) -> Array:
    """Position (2,) of a point of cases/bent_plate.toml."""
    return np.array([np.sinh(xi[0] - 0.5), np.log(xi[1])])


BENT_POINTS = (1.1, 1.3), (0.7, 0.8), (0.5, 1.1)


def measured_deflection(w: Callable[[Array], float], plate: BentPlate) -> dict[str, float]:
    """Values of cases/bent_plate.toml for an upward displacement by positions (2,), m."""
    places = np.array([[x, y] for x in (0.0, plate.length) for y in (*plate.sides, sum(plate.sides) / 2)])
    return {
        "corner_lift": w(np.array([plate.length, plate.sides[0]])),
        "corner_lift_50": w(np.array([plate.length, plate.sides[0]])) / 2,
        "mean_oblique": float(np.mean([w(bent_chart(xi)) for xi in BENT_POINTS])) * float(OBLIQUE[2]),
        # w = f(x) + g(y), both even about a side or the middle: there it is largest.
        "largest_displacement": max(abs(w(p)) for p in places),
    }


def bent_plate() -> dict[str, Estimate]:
    """Known values of cases/bent_plate.toml."""
    plate = BentPlate()
    (one, two), stiffness = plate.moments, plate.bending_stiffness * (1 - POISSON**2)
    bent = (one - POISSON * two) / stiffness, (two - POISSON * one) / stiffness
    width, middle = plate.sides[1] - plate.sides[0], sum(plate.sides) / 2
    mean = bent[0] * plate.length**2 / 6 + bent[1] * width**2 / 24

    def w(p: Array) -> float:
        return float(bent[0] * p[0] ** 2 / 2 + bent[1] * (p[1] - middle) ** 2 / 2 - mean)

    energy = (one * bent[0] + two * bent[1]) / 2 * plate.length * width
    return {name: _rounded(value, "m") for name, value in measured_deflection(w, plate).items()} | {
        "strain_energy": _rounded(energy, "J"),
        "bending_energy": _rounded(energy, "J"),
        "potential_energy": _rounded(-energy, "J"),  # the moments work twice as much
        "mirror_moment": _rounded(one * width, "N m"),
    }


# --- the sleeve --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sleeve:
    """Radius, ends along the axis and thickness, m; pressure, N/m^2, and shear force at the rims, N/m."""

    radius: float = 0.8
    ends: tuple[float, float] = (float(np.arcsin(-0.85)), float(np.arcsin(0.7)))
    thickness: float = 0.04
    pressure: float = 2000.0
    shear: float = 3000.0

    @property
    def membrane_stiffness(self) -> float:
        """D, N/m."""
        return YOUNG * self.thickness / (1 - POISSON**2)

    @property
    def bending_stiffness(self) -> float:
        """B, N m."""
        return self.membrane_stiffness * self.thickness**2 / 12


def sleeve_chart(xi1: float, degrees: float) -> tuple[float, float]:
    """Angle, rad, and length along the axis, m, of a point of cases/sheared_sleeve.toml."""
    angle = np.radians(degrees)
    return float(angle + 0.1 * np.sin(angle)), float(np.arcsin(xi1))


SLEEVE_POINTS = (0.6, 70.0), (-0.6, -25.0), (0.2, 200.0)
DIRECTIONS = np.array([[1.0, 2.0, -2.0], [1.8, 0.0, 2.4], [0.0, -3.0, 0.0]]) / 3.0


def measured_sleeve(parts: Callable[[float, float], Array], sleeve: Sleeve) -> dict[str, float]:
    """Values of cases/sheared_sleeve.toml for a displacement: parts along e_r, e_t, e_y by angle and length."""

    def moved(xi: tuple[float, float]) -> Array:
        angle, y = sleeve_chart(*xi)
        radial = np.array([np.cos(angle), 0.0, np.sin(angle)])
        around = np.array([-np.sin(angle), 0.0, np.cos(angle)])
        return parts(angle, y) @ np.stack([radial, around, [0.0, 1.0, 0.0]])

    return {
        "mean_oblique": float(np.mean([moved(xi) @ d for xi, d in zip(SLEEVE_POINTS, DIRECTIONS, strict=True)])),
        "rim_slide": float(moved(SLEEVE_POINTS[1]) @ OBLIQUE),
        "largest_displacement": float(np.linalg.norm(parts(0.0, sleeve.ends[1]))),
    }


def sheared_sleeve() -> dict[str, Estimate]:
    """Known values of cases/sheared_sleeve.toml."""
    sleeve = Sleeve()
    radius, bending = sleeve.radius, sleeve.bending_stiffness
    stretch = YOUNG * sleeve.thickness
    shear = stretch / (2 * (1 + POISSON))
    w = sleeve.pressure / (stretch / radius**2 + bending / radius**4)
    gamma = sleeve.shear / (shear + 2 * (1 - POISSON) * bending / radius**2)
    area = 2 * np.pi * radius * (sleeve.ends[1] - sleeve.ends[0])
    membrane = area * (stretch * (w / radius) ** 2 + shear * gamma**2) / 2
    change = area * bending * (w**2 / radius**4 / 2 + (1 - POISSON) * (gamma / radius) ** 2)
    middle = sum(sleeve.ends) / 2

    def parts(angle: float, y: float) -> Array:
        return np.array([w, gamma * (y - middle), -POISSON * w / radius * (y - middle)])

    return {name: _rounded(value, "m") for name, value in measured_sleeve(parts, sleeve).items()} | {
        "strain_energy": _rounded(membrane + change, "J"),
        "membrane_energy": _rounded(membrane, "J"),
        "bending_energy": _rounded(change, "J"),
    }


def _rounded(value: float, unit: str) -> Estimate:
    return Estimate(float(value), ROUNDING * abs(float(value)), unit)
