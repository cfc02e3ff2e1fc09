r"""Derivatives of known values with respect to the parameters of their cases, for the cases `gradient_*`.

Where an answer is a product of powers, its derivatives follow from the exponents:

- a supported plate's deflection w = c q L^4 / B with B = E h^3 / (12 (1 - nu^2)): p/w dw/dp is -1 for E, -3 for h, 2 nu^2
  / (1 - nu^2) times -1 for nu, 1 for q. Scaling both sides of a square multiplies w at its centre by the fourth power of
  the scale, and the energy by the sixth; by symmetry each side has half of that, 2 w / L and 3 W / L;
- a plate's frequency at fixed mass m a unit area goes as sqrt(B / m) / L^2, and its buckling load as B;
- any linear answer goes as 1 / E at fixed loads, and as the load.

The other derivatives come from series and differential equations. Each has two origins:

- differences of a series, extrapolated (Richardson), of two different series;
- for the cantilever (see `elastica`) the variational equations: with y the angle, the moment and the place of a point of
  the strip, y' = f(y, p) and y_p' = f_y y_p + f_p, integrated together with y from the tip to the wall. The angle of the
  tip, a, is an unknown of the boundary value problem, phi(wall) = 0, so that da/dp = -phi_p / phi_a there, and the tip's
  displacement changes by z_p + z_a da/dp. The second origin is differences of polynomials (`plane_strip`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from .annular_plate import Ring, rim_deflection_by_ritz
from .cylinder import Cylinder, strains_of_axial_harmonic
from .elastica import FINE, STEEPEST, Cantilever, stretch
from .estimate import ROUNDING, Estimate
from .exponential_shells import free_cylinder_sums, roof_sums
from .exponentials import edge_displacement_of_roof_harmonic
from .hinged_roof import Path, hinged_roof
from .levy_roof import HALF_ANGLE, roof, solve_roof
from .levy_roof import LOAD as ROOF_LOAD
from .navier_plate import SquarePlate, levy, navier
from .patch import Mesh
from .pinched_diaphragm import LOAD, extrapolate, flexibility_sums, pinched_cylinder
from .pinched_free import DIAPHRAGM_END, FREE_END, solve_pinched
from .plane_strip import PlaneStrip
from .plate import LoadedPlate, Rectangle, Uniform
from .plate_modes import FREE, PRESSED, SIMPLE, Plate, polynomials, sines
from .plate_modes_by_splines import splines
from .resultants import Fields, plate_by_levy, plate_by_navier
from .torsion import Sleeve, bending_energy, membrane_energy, torque_per_radian

Values = dict[str, Estimate]
STEPS = 0.02, 0.01, 0.005
"""Steps of central differences, relative to the parameter, or to 1 where it is zero; the extrapolation has order six."""


def slope(value: Callable[[float], float], at: float, unit: str, noise: float = 1e-13) -> Estimate:
    """The derivative of a function by central differences at three steps, extrapolated; `noise` is its relative rounding.

    The uncertainty is the change by the last extrapolation, and the rounding of the values over the smallest step.
    """
    size = abs(at) or 1.0
    quotients = [(value(at + s * size) - value(at - s * size)) / (2 * s * size) for s in STEPS]
    fourth = [(4 * b - a) / 3 for a, b in pairwise(quotients)]
    sixth = (16 * fourth[1] - fourth[0]) / 15
    rounding = 4 * noise * abs(value(at)) / (STEPS[-1] * size)
    return Estimate(float(sixth), float(abs(sixth - fourth[1]) + rounding), unit)


def two_levels(value: Callable[[float, int], float], at: float, unit: str, noise: float = 1e-13) -> Estimate:
    """`slope` of a method on its finer level (0); the uncertainty includes the change from the coarser one (1)."""
    fine, coarse = (slope(partial(_at_level, value, level), at, unit, noise) for level in (0, 1))
    return Estimate(fine.value, fine.uncertainty + abs(fine.value - coarse.value), unit)


def _at_level(value: Callable[[float, int], float], level: int, p: float) -> float:
    return value(p, level)


def power(value: Estimate, exponent: float, at: float, unit: str) -> Estimate:
    """The derivative of a value that goes as a power of a parameter."""
    return Estimate(exponent * value.value / at, abs(exponent / at) * value.uncertainty, unit)


# Square plate ------------------------------------------------------------------------------------------------------

PLATE = SquarePlate(poisson=0.3)
W, U, M = "centre_deflection", "strain_energy", "centre_moment"
BENT = LoadedPlate(Rectangle(PLATE.side, PLATE.side, PLATE.thickness, PLATE.young, PLATE.poisson), Uniform(), {})


def moment(fields: Callable[[LoadedPlate, int], Fields], terms: tuple[int, int]) -> Callable[..., float]:
    """The moment m_11 at the centre of a plate with other numbers and a factor of the load, on a level of a series."""

    def value(level: int, load: float = 1.0, **changed: float) -> float:
        plate = LoadedPlate(replace(BENT.plate, **changed), Uniform(load), {})
        return float(fields(plate, terms[level])(np.array([[PLATE.side / 2, PLATE.side / 2]]))[0, 3])

    return value


def centre_moment(value: Callable[..., float]) -> Values:
    """By exponents: m_11 = c (1 + nu) q L^2 at the middle of a square, whatever E and h are."""
    m = Estimate.between(value(0), value(1), "N", 1e-12 * abs(value(0)))
    return {
        M: m,
        f"{M}_by_load": power(m, 1, 1.0, "N"),
        f"{M}_by_poisson": power(m, 1, 1 + PLATE.poisson, "N"),
        f"{M}_by_modulus": Estimate.exact(0.0, ""),
        f"{M}_by_thickness": Estimate.exact(0.0, ""),
    }


def centre_moment_by_differences(value: Callable[..., float]) -> Values:
    """By differences; relative ones by E and h."""
    m, found = value(0), {M: Estimate.between(value(0), value(1), "N", 1e-12 * abs(value(0)))}
    for key, field in (("load", "load"), ("poisson", "poisson"), ("modulus", "young"), ("thickness", "thickness")):
        at = getattr(BENT.plate, field, 1.0)
        rate = two_levels(lambda p, level, field=field: value(level, **{field: p}), at, "N", 1e-12)
        share = at / m if key in ("modulus", "thickness") else 1.0
        found[f"{M}_by_{key}"] = Estimate(
            share * rate.value, abs(share) * rate.uncertainty, "" if share != 1.0 else "N"
        )
    return found


def gradient_plate() -> Values:
    """By the exponents, from Navier's series."""
    (w, energy), (coarse, less) = navier(PLATE, 500), navier(PLATE, 250)
    deflection = Estimate.between(w, coarse, "m", ROUNDING * w)
    work = Estimate.between(energy, less, "J", ROUNDING * energy)
    nu, side = PLATE.poisson, PLATE.side
    return centre_moment(moment(plate_by_levy, (60, 30))) | {
        W: deflection,
        U: work,
        f"{W}_by_modulus": power(deflection, -1, PLATE.young, "m/Pa"),
        f"{W}_by_thickness": power(deflection, -3, PLATE.thickness, "m/m"),
        f"{W}_by_poisson": power(deflection, -2 * nu**2 / (1 - nu**2), nu, "m"),
        f"{W}_by_load": power(deflection, 1, 1.0, "m"),
        f"{W}_by_side_1": power(deflection, 2, side, "m/m"),
        f"{W}_by_side_2": power(deflection, -2, side, "m/m"),
        f"{U}_by_modulus": power(work, -1, PLATE.young, "J/Pa"),
        f"{U}_by_load": power(work, 2, 1.0, "J"),
        f"{U}_by_thickness": power(work, -3, PLATE.thickness, "J/m"),
        f"{U}_by_side_1": power(work, 3, side, "J/m"),
    }


def rectangle(a: float, b: float, place: tuple[float, float], terms: int) -> tuple[float, float]:
    """Deflection at a place, and energy, of a supported rectangle by Navier's double series."""
    m = np.arange(1, 2 * terms, 2, dtype=float)
    x, y = (np.sin(m * np.pi * c / side) for c, side in zip(place, (a, b), strict=True))
    k4 = ((m[:, None] / a) ** 2 + (m / b) ** 2) ** 2 * np.outer(m, m)
    factor = 16 * PLATE.pressure / (np.pi**6 * PLATE.bending_stiffness)
    mean = 4 / np.pi**2 * np.sum(1 / (k4 * np.outer(m, m)))
    return float(factor * (x @ (1 / k4) @ y)), float(PLATE.pressure / 2 * factor * mean * a * b)


def gradient_plate_by_levy() -> Values:
    """By differences of Levy's single series; by the sides of Navier's series of a rectangle at a fixed place."""
    fields = {"modulus": ("young", "Pa"), "thickness": ("thickness", "m"), "poisson": ("poisson", "")}
    found = {}
    for name, (field, unit) in (fields | {"load": ("pressure", "")}).items():
        for number, (quantity, own) in enumerate(((W, "m"), (U, "J"))):

            def value(p: float, level: int, field: str = field, number: int = number) -> float:
                return levy(replace(PLATE, **{field: p}), (2000, 1000)[level])[number]

            units = f"{own}/{unit}" if unit else own
            found[f"{quantity}_by_{name}"] = two_levels(value, getattr(PLATE, field), units)
    middle, side = PLATE.side / 2, PLATE.side
    for number, (quantity, unit) in enumerate(((W, "m/m"), (U, "J/m"))):

        def longer(a: float, level: int, number: int = number) -> float:
            return rectangle(a, side, (middle, middle), (400, 300)[level])[number]

        found[f"{quantity}_by_side_1"] = two_levels(longer, side, unit)

    def lower(start: float, level: int) -> float:
        return rectangle(side, side - start, (middle, middle - start), (400, 300)[level])[0]

    found[f"{W}_by_side_2"] = two_levels(lower, 0.0, "m/m")
    for number, (quantity, unit) in enumerate(((W, "m"), (U, "J"))):
        fine, coarse = (levy(PLATE, terms)[number] for terms in (2000, 1000))
        found[quantity] = Estimate.between(fine, coarse, unit, ROUNDING * fine)
    return found | centre_moment_by_differences(moment(plate_by_navier, (1000, 500)))


# Cylinders ---------------------------------------------------------------------------------------------------------

BY = {"thickness": ("thickness", "m"), "poisson": ("poisson", ""), "radius": ("radius", "m"), "length": ("length", "m")}


def of_cylinder(
    shell: Cylinder, value: Callable[[Cylinder, int], dict[str, tuple[float, str]]], by: dict[str, tuple[str, ...]]
) -> Values:
    """Values of a linear cylinder, and their derivatives: those by E and the load from exponents, others by differences."""
    value = cache(value)
    fine, coarse = value(shell, 0), value(shell, 1)
    found = {}
    for name, (number, unit) in fine.items():
        noise = shell.rounding
        found[name] = Estimate.between(number, coarse[name][0], unit, noise * abs(number))
        energy = 1 + (unit == "J")
        for parameter in by[name]:
            key = f"{name}_by_{parameter}"
            if parameter == "modulus":
                found[key] = power(found[name], -1, shell.young, f"{unit}/Pa")
            elif parameter == "load":
                found[key] = power(found[name], energy, 1.0, unit)
            else:
                field, below = BY[parameter]

                def changed(p: float, level: int, name: str = name, field: str = field) -> float:
                    return value(replace(shell, **{field: p}), level)[name][0]

                found[key] = two_levels(changed, getattr(shell, field), f"{unit}/{below}" if below else unit, noise)
    return found


EDGE = "edge_deflection"
ROOF_BY = {EDGE: ("modulus", "load", "thickness", "poisson", "radius", "length"), U: ("load", "thickness", "radius")}


def roof_by_polynomials(shell: Cylinder, level: int) -> dict[str, tuple[float, str]]:
    series = solve_roof(shell, *((99, 48), (75, 40))[level])
    return {EDGE: (series.deflection(25.0, HALF_ANGLE), "m"), U: (series.load_works.sum() / 2, "J")}


def roof_by_exponentials(shell: Cylinder, level: int) -> dict[str, tuple[float, str]]:
    last = (99, 75)[level]
    harmonics = np.arange(1, last + 1, 2)
    if shell.length == 50.0:
        sums = roof_sums(shell, last)
        return {EDGE: (sums[EDGE], "m"), U: (sums[U], "J")}
    return {EDGE: (_edge_at(shell, harmonics), "m"), U: (roof_sums(shell, last)[U], "J")}


def _edge_at(shell: Cylinder, harmonics: np.ndarray) -> float:
    """Deflection of the edge at 25 m from one diaphragm."""
    alpha = harmonics * np.pi / shell.length
    edge = np.array([
        edge_displacement_of_roof_harmonic(
            strains_of_axial_harmonic(shell.radius, a), sum(shell.elasticity()), HALF_ANGLE, 4 * ROOF_LOAD / (k * np.pi)
        )
        for a, k in zip(alpha, harmonics, strict=True)
    ])  # fmt: skip
    _, v, w = np.sin(alpha * 25.0) @ edge
    return float(v * np.sin(HALF_ANGLE) - w * np.cos(HALF_ANGLE))


UNDER = "load_deflection"
PINCHED_BY = {UNDER: ("modulus", "load", "thickness", "poisson", "radius")}


def diaphragm_by_double_series(shell: Cylinder, level: int) -> dict[str, tuple[float, str]]:
    cutoffs = 800.0 * np.array([0.25, 0.35, 0.5, 0.7, 1.0])[(slice(2, 5), slice(0, 3))[level]]
    sums = np.array([flexibility_sums(shell, k)[0] for k in cutoffs])
    return {UNDER: (2.0 * LOAD / (np.pi * shell.radius * shell.length) * extrapolate(cutoffs, sums), "m")}


def pinched_by_polynomials(end: tuple[str, ...], shell: Cylinder, level: int) -> dict[str, tuple[float, str]]:
    return {UNDER: (solve_pinched(shell, end, *((200, 72), (132, 56))[level]).totals()[0], "m")}


def free_by_exponentials(shell: Cylinder, level: int) -> dict[str, tuple[float, str]]:
    return {UNDER: (free_cylinder_sums(shell, (160, 120)[level])[0], "m")}


# Modes -------------------------------------------------------------------------------------------------------------


def of_plate(plate: Plate, name: str, unit: str, value: Callable[[Plate, int], float], exact: bool) -> Values:
    """A mode's value and its derivatives by E, h, m or the load, nu and a side; with `exact` by the exponents."""
    half = 0.5 if plate.density else 1.0
    fine, coarse = value(plate, 0), value(plate, 1)
    found = {name: Estimate.between(fine, coarse, unit, 1e-11 * fine)}

    def per(below: str) -> str:
        return f"{unit or '1'}/{below}"

    laws = {"modulus": ("young", half, per("Pa")), "thickness": ("thickness", 3 * half, per("m"))}
    if plate.density:
        laws["density"] = ("density", -half, per("(kg/m^2)"))
    for key, (field, exponent, units) in laws.items():
        at = getattr(plate, field)
        found[f"{name}_by_{key}"] = (
            power(found[name], exponent, at, units)
            if exact
            else two_levels(lambda p, level, field=field: value(replace(plate, **{field: p}), level), at, units, 1e-12)
        )
    found[f"{name}_by_poisson"] = two_levels(
        lambda p, level: value(replace(plate, poisson=p), level), plate.poisson, unit, 1e-12
    )
    (a, _), other = plate.sides
    found[f"{name}_by_side"] = two_levels(
        lambda p, level: value(replace(plate, sides=((p, 0.0), other)), level), a, per("m"), 1e-12
    )
    if not plate.density:
        found[f"{name}_by_load"] = power(found[name], -1, 1.0, unit)
    return found


def _sine(plate: Plate, level: int) -> float:
    return float(sines(plate, 1)[0])


def _polynomial(plate: Plate, level: int) -> float:
    return float(polynomials(plate, 1, (18, 14)[level])[0])


def _spline(plate: Plate, level: int) -> float:
    return float(splines(plate, 1, (8, 6)[level])[0])


# Cantilever bent far -----------------------------------------------------------------------------------------------

FORCE = 4.0
TIP = {"deflection": "deflection", "shortening": "shortening"}
STRIP_BY = {"load": "m", "modulus": "m/Pa", "thickness": "m/m"}


def gradient_cantilever(tolerance: float = FINE) -> Values:
    """By the variational equations of the boundary value problem."""
    strip = Cantilever()
    force, width = FORCE / strip.width, strip.width
    a, b = strip.stretching_stiffness, strip.bending_stiffness
    # rates of the force, of A and of B by the factor of the load, by E and by h
    rates = np.array([
        [force, 0.0, 0.0],
        [0.0, a / strip.young, b / strip.young],
        [0.0, a / strip.thickness, 3 * b / strip.thickness],
    ])  # fmt: skip

    def along(_: float, state: np.ndarray) -> np.ndarray:
        """Rates of phi, m, x, z from the tip to the wall, and of their derivatives by the tip's angle and three others."""
        phi, m, _, _ = state[:4]
        varied = state[4:].reshape(4, 4)  # by unknown (slow) and by parameter: tip, load, modulus, thickness
        change = np.vstack([np.zeros(3), rates])  # of the tip: none
        long = stretch(strip, m, force * math.sin(phi))
        # F(l; m, s) = A (l^2 - 1) l / 2 + m^2 / (B l^3) - s = 0 with s = force sin phi
        by_l = a * (3 * long**2 - 1) / 2 - 3 * m**2 / (b * long**4)
        pull = force * math.cos(phi) * varied[0] + change[:, 0] * math.sin(phi)
        by_p = change[:, 1] * (long**2 - 1) * long / 2 - m**2 / (b**2 * long**3) * change[:, 2]
        stretched = -(2 * m / (b * long**3) * varied[1] + by_p - pull) / by_l
        x, z = long * math.cos(phi), long * math.sin(phi)
        x_p = stretched * math.cos(phi) - z * varied[0]
        z_p = stretched * math.sin(phi) + x * varied[0]
        turn = m / (b * long**2)
        turn_p = varied[1] / (b * long**2) - turn / b * change[:, 2] - 2 * turn / long * stretched
        moment_p = change[:, 0] * x + force * x_p
        return np.concatenate([[-turn, force * x, -x, -z], -turn_p, moment_p, -x_p, -z_p])

    def to_the_wall(tip: float) -> np.ndarray:
        start = np.zeros(20)
        start[0], start[4] = tip, 1.0
        solution = solve_ivp(along, (0.0, strip.length), start, method="DOP853", rtol=tolerance, atol=tolerance)
        return np.asarray(solution.y[:, -1])

    tip = brentq(lambda angle: to_the_wall(angle)[0], 0.1, STEEPEST, xtol=tolerance, rtol=1e-14)
    end = to_the_wall(tip)
    varied = end[4:].reshape(4, 4)
    turned = -varied[0, 1:] / varied[0, 0]  # da/dp
    change = varied[:, 1:] + varied[:, :1] * turned
    spread = 100 * tolerance
    found = {
        "shortening": Estimate(strip.length + end[2], spread * strip.length, "m"),
        "deflection": Estimate(-end[3], spread * strip.length, "m"),
    }
    for row, name, sign in ((2, "shortening", 1.0), (3, "deflection", -1.0)):
        for (key, unit), value in zip(STRIP_BY.items(), sign * change[row], strict=True):
            found[f"{name}_by_{key}"] = Estimate(float(value), 100 * spread * abs(float(value)), unit)
    assert width == 1.0  # forces and energies are per width
    return found


def gradient_cantilever_by_polynomials() -> Values:
    """By differences of the equilibrium in polynomials of the position."""
    strip = Cantilever()

    def tip(factor: float, young: float, thickness: float, level: int) -> tuple[float, float]:
        shell = PlaneStrip(strip.length, thickness, young, (20, 17)[level])
        *_, bent = shell.path(np.arange(1, 9) / 8, force=factor * FORCE / strip.width)
        return bent.deflection, bent.shortening

    known = {"load": 1.0, "modulus": strip.young, "thickness": strip.thickness}
    found = {}
    for number, name in enumerate(("deflection", "shortening")):
        fine, coarse = (tip(*known.values(), level)[number] for level in (0, 1))
        found[name] = Estimate.between(fine, coarse, "m", 1e-11 * strip.length)
        for key, unit in STRIP_BY.items():

            def value(p: float, level: int, key: str = key, number: int = number) -> float:
                return tip(*(known | {key: p}).values(), level)[number]

            found[f"{name}_by_{key}"] = two_levels(value, known[key], unit, 1e-11)
    return found


# Ring and sleeve ---------------------------------------------------------------------------------------------------

RIM, HUB = "rim_deflection", "hub_force"
RING_BY = {
    "modulus": ("young", "m/Pa"),
    "thickness": ("thickness", "m/m"),
    "poisson": ("poisson", "m"),
    "inner": ("inner", "m/m"),
    "outer": ("outer", "m/m"),
}


def gradient_ring(step: float = 1e-30) -> Values:
    """By complex steps of the closed form, at the place r = b of the ring as it is."""
    ring = Ring()
    place = np.array([ring.outer])
    rim = float(ring.deflection(place)[0])
    found = {RIM: Estimate(rim, 1e-13 * rim, "m"), HUB: Estimate(ring.force, 1e-14 * ring.force, "N")}
    for key, (field, unit) in RING_BY.items():
        rate = float(np.imag(replace(ring, **{field: getattr(ring, field) + 1j * step}).deflection(place)[0])) / step
        found[f"{RIM}_by_{key}"] = Estimate(rate, 1e-12 * abs(rate), unit)
    for key, sign in (("inner", -1), ("outer", 1)):
        rate = sign * 2 * math.pi * ring.load * getattr(ring, key)
        found[f"{HUB}_by_{key}"] = Estimate(rate, 1e-14 * abs(rate), "N/m")
    return found | {f"{HUB}_by_load": replace(found[HUB])}


def gradient_ring_by_ritz() -> Values:
    """By differences of a Ritz method; the hub carries the whole load, integrated by Gauss's rule."""
    ring, (x, weights) = Ring(), np.polynomial.legendre.leggauss(8)

    def carried(of: Ring) -> float:
        r = of.inner + (of.outer - of.inner) * (x + 1) / 2
        return float(2 * math.pi * of.load * (weights @ r) * (of.outer - of.inner) / 2)

    rim = [rim_deflection_by_ritz(degree) for degree in (14, 12)]
    found = {RIM: Estimate.between(*rim, "m", 1e-12 * rim[0]), HUB: Estimate(carried(ring), 1e-13 * carried(ring), "N")}
    for key, (field, unit) in RING_BY.items():

        def value(p: float, level: int, field: str = field) -> float:
            return rim_deflection_by_ritz((14, 12)[level], replace(ring, **{field: p}), 2.0)

        found[f"{RIM}_by_{key}"] = two_levels(value, getattr(ring, field), unit, 1e-12)
    for key, field, unit in (("inner", "inner", "N/m"), ("outer", "outer", "N/m"), ("load", "load", "N")):
        rate = slope(lambda p, field=field: carried(replace(ring, **{field: p})), getattr(ring, field), unit, 1e-14)
        scale = ring.load if key == "load" else 1.0  # of the factor of the load
        found[f"{HUB}_by_{key}"] = Estimate(rate.value * scale, rate.uncertainty * scale, unit)
    return found


TWIST = math.radians(0.2)
TORQUE, STRETCH = "torque", "strain_energy"
SLEEVE_BY = {
    "modulus": ("young", "Pa"),
    "thickness": ("thickness", "m"),
    "poisson": ("poisson", ""),
    "radius": ("radius", "m"),
    "length": ("length", "m"),
}


def gradient_sleeve() -> Values:
    """By the exponents of T = 2 pi G h (R^3 + h^2 R / 3) lambda / L, G = E / (2 (1 + nu)), and W = T lambda / 2."""
    sleeve = Sleeve()
    r, h = sleeve.radius, sleeve.thickness
    torque = torque_per_radian(sleeve) * TWIST
    share = h**2 / 3 / (r**2 + h**2 / 3)
    exponents = {
        "modulus": 1.0,
        "thickness": 1 + 2 * share,
        "poisson": -sleeve.poisson / (1 + sleeve.poisson),
        "radius": 3 - 2 * share,
        "length": -1.0,
    }
    values = {TORQUE: Estimate.exact(torque, "N m"), STRETCH: Estimate.exact(torque * TWIST / 2, "J")}
    found = dict(values)
    for quantity, value in values.items():
        for key, (field, below) in SLEEVE_BY.items():
            if quantity == STRETCH or key not in ("radius", "length"):
                unit = value.unit if not below else f"{value.unit}/{below}"
                found[f"{quantity}_by_{key}"] = power(value, exponents[key], getattr(sleeve, field), unit)
    return found


def gradient_sleeve_by_energies() -> Values:
    """By differences of the energies of shear and of twist."""
    sleeve, found = Sleeve(), {}

    def energy(of: Sleeve) -> float:
        return membrane_energy(of, TWIST) + bending_energy(of, TWIST)

    for quantity, factor, own in ((TORQUE, 2 / TWIST, "N m"), (STRETCH, 1.0, "J")):
        found[quantity] = Estimate(factor * energy(sleeve), 1e-13 * factor * energy(sleeve), own)
        for key, (field, below) in SLEEVE_BY.items():
            if quantity == STRETCH or key not in ("radius", "length"):
                rate = slope(lambda p, field=field: energy(replace(sleeve, **{field: p})), getattr(sleeve, field), own)
                unit = own if not below else f"{own}/{below}"
                found[f"{quantity}_by_{key}"] = Estimate(factor * rate.value, factor * rate.uncertainty, unit)
    return found


# Limit load ---------------------------------------------------------------------------------------------------------


LIMIT, ROOF = "limit_load", {"thickness": 12.7, "young": 3102.75, "load": 1.0}
GRADED, SPARSE = (Mesh((8, 8), 4, 5), Mesh((8, 8), 4, 3)), (Mesh((6, 6), 4, 2), Mesh((6, 6), 4, 1))
FOUND_AGAIN = 1e-10  # relative rounding of a limit load


@cache
def _snap(mesh: Mesh) -> Path:
    """States about the limit point."""
    return Path.follow(hinged_roof(ROOF["thickness"], mesh), 13.0).about(1, 1)


def by_splines(parameter: str, levels: tuple[Mesh, Mesh]) -> Estimate:
    """The relative derivative of the limit load, by differences of its logarithm for spline shells."""

    def value(p: float, level: int) -> float:
        shell = hinged_roof(mesh=levels[level], **(ROOF | {parameter: p}))
        return math.log(_snap(levels[level]).beside(shell).turning(1, 1)[1])

    at = ROOF[parameter]
    rate = two_levels(value, at, "", FOUND_AGAIN)
    return Estimate(at * rate.value, at * rate.uncertainty, "")


def gradient_limit() -> Values:
    """Relative derivatives. The load of a state is proportional to E, its factor to 1 / load; by h from splines."""
    return {
        f"{LIMIT}_by_modulus": Estimate.exact(1.0, ""),
        f"{LIMIT}_by_load": Estimate.exact(-1.0, ""),
        f"{LIMIT}_by_thickness": by_splines("thickness", GRADED),
    }


def gradient_limit_by_splines() -> Values:
    """By E and the load, from splines on any mesh; the second origin of that by h is an element of Kratos."""
    return {f"{LIMIT}_by_modulus": by_splines("young", SPARSE), f"{LIMIT}_by_load": by_splines("load", SPARSE)}


JUDGES: dict[str, Callable[[], Values]] = {
    "gradient_plate": gradient_plate,
    "gradient_roof": partial(of_cylinder, roof(), roof_by_polynomials, ROOF_BY),
    "gradient_diaphragm": partial(of_cylinder, pinched_cylinder(), diaphragm_by_double_series, PINCHED_BY),
    "gradient_pinched": partial(of_cylinder, pinched_cylinder(), partial(pinched_by_polynomials, FREE_END), PINCHED_BY),
    "gradient_plate_mode": partial(of_plate, SIMPLE, "frequency_1", "Hz", _sine, True),
    "gradient_free_mode": partial(of_plate, FREE, "frequency_1", "Hz", _polynomial, True),
    "gradient_buckling": partial(of_plate, PRESSED, "load_factor_1", "", _sine, True),
    "gradient_cantilever": gradient_cantilever,
    "gradient_ring": gradient_ring,
    "gradient_sleeve": gradient_sleeve,
    "gradient_limit": gradient_limit,
}
SECOND_FORMS: dict[str, Callable[[], Values]] = {
    "gradient_plate": gradient_plate_by_levy,
    "gradient_roof": partial(of_cylinder, roof(), roof_by_exponentials, ROOF_BY),
    "gradient_diaphragm": partial(
        of_cylinder, pinched_cylinder(), partial(pinched_by_polynomials, DIAPHRAGM_END), PINCHED_BY
    ),
    "gradient_pinched": partial(of_cylinder, pinched_cylinder(), free_by_exponentials, PINCHED_BY),
    "gradient_plate_mode": partial(of_plate, SIMPLE, "frequency_1", "Hz", _polynomial, False),
    "gradient_free_mode": partial(of_plate, FREE, "frequency_1", "Hz", _spline, False),
    "gradient_buckling": partial(of_plate, PRESSED, "load_factor_1", "", _polynomial, False),
    "gradient_cantilever": gradient_cantilever_by_polynomials,
    "gradient_ring": gradient_ring_by_ritz,
    "gradient_sleeve": gradient_sleeve_by_energies,
    "gradient_limit": gradient_limit_by_splines,
}
