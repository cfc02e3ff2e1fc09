r"""Shells of Naghdi's theory: a thick plate in closed form, and which function judges which case.

A simply supported plate of Reissner and Mindlin whose rim also keeps normals from turning along it: with Marcus' moment
m = -B laplace w_K of Kirchhoff's deflection w_K, normals turn as Kirchhoff's do, Q = grad m, and w = w_K + m / (k G h).
m = q phi with -laplace phi = 1, a single series. So centre and energy are Kirchhoff's (Levy's single series, see
`plate_series`) and

    phi = 4 a^2 / pi^3 sum sin(m pi / 2) / m^3 (1 - 1 / cosh(m pi / 2))                  at the centre, m odd
    int phi = 8 a^4 / pi^4 sum 1 / m^4 (1 - 2 / (m pi) tanh(m pi / 2))                   over the plate
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from . import naghdi_hypar, naghdi_revolution, naghdi_slices
from .estimate import Estimate
from .naghdi_polynomials import hypar_naghdi, hypar_naghdi_by_polynomials
from .naghdi_ritz import FACTOR, plate, roof_values
from .naghdi_roof import solve_roof
from .plate_series import Rectangle, Uniform, levy

Plate = tuple[float, float, float, float, float]
"""Side and thickness in m, Young's modulus in Pa, Poisson's ratio, and pressure in Pa."""
THICK: Plate = (10.0, 1.0, 1e7, 0.3, 1.0)
SQUARE: Plate = (100.0, 1.0, 1e7, 0.0, 1.0)
ROOF = 0.25  # thickness, m
ENERGIES = "strain_energy", "membrane_energy", "bending_energy"
DIFFERENCE = 5e-7  # relative error of a membrane energy that is a difference of energies
SLICES = 3e-10  # relative rounding of slices: they are thin beside the shell
ROUNDING = 1e-11  # of ten functions whose forces and displacements differ by the factor of Young's modulus


def _estimates(fine: dict[str, float], coarse: dict[str, float], rounding: float) -> dict[str, Estimate]:
    return {
        name: Estimate.between(value, coarse[name], "J" if name in ENERGIES else "m", rounding * abs(value))
        for name, value in fine.items()
    }


def scordelis_lo_naghdi(last_harmonic: int = 399) -> dict[str, Estimate]:
    """Known values of the roof; the uncertainty is the change from half the harmonics."""
    levels = [solve_roof(ROOF, last).values(160) for last in (last_harmonic, last_harmonic // 2)]
    return _estimates(*levels, ROUNDING)


def scordelis_lo_by_polynomials() -> dict[str, Estimate]:
    """The same by the Ritz method; the uncertainty is the change from lower degrees."""
    return _estimates(roof_values(ROOF, (20, 52)), roof_values(ROOF, (14, 40)), ROUNDING)


def _plate(of: Plate, terms: int) -> dict[str, float]:
    side, thickness, young, poisson, pressure = of
    m = np.arange(1, 2 * terms, 2, dtype=float)
    alpha = m * np.pi / 2
    sech = 2 * np.exp(-alpha) / (1 + np.exp(-2 * alpha))
    sign = np.where(m % 4 == 1, 1.0, -1.0)
    centre = 4 * side**2 / np.pi**3 * np.sum(sign / m**3 * (1 - sech))
    whole = 8 * side**4 / np.pi**4 * np.sum(1 / m**4 * (1 - np.tanh(alpha) / alpha))
    shear = FACTOR * young / (2 * (1 + poisson)) * thickness
    middle = np.array([[side / 2, side / 2]])
    kirchhoff, energy = levy(Rectangle(side, side, thickness, young, poisson), Uniform(pressure), terms, middle)
    deflection = float(kirchhoff[0] + pressure * centre / shear)
    return {
        "centre_deflection": deflection,
        "largest_displacement": deflection,
        "strain_energy": float(energy + 0.5 * pressure**2 * whole / shear),
    }


def hard_plate(of: Plate) -> dict[str, Estimate]:
    """Known values of a plate on hard supports; the uncertainty is the change from half the harmonics."""
    return _estimates(_plate(of, 4000), _plate(of, 2000), 1e-14)


def plate_by_polynomials(of: Plate, soft: bool, degrees: tuple[int, int], rounding: float) -> dict[str, Estimate]:
    """The same by the Ritz method; the uncertainty is the change from lower degrees."""
    levels = []
    for degree in degrees:
        found = plate(*of, soft).solve((degree, degree))
        deflection = -float(found.displacement(np.array([of[0] / 2]), np.array([of[0] / 2]))[0, 0, 2])
        energy = 4 * found.half_work
        levels.append({"centre_deflection": deflection, "largest_displacement": deflection, "strain_energy": energy})
    return _estimates(*levels, rounding)


def plate_by_slices(of: Plate) -> dict[str, Estimate]:
    """A plate on soft supports by slices; the uncertainty is the change from fewer ones."""
    return _estimates(*(naghdi_slices.plate_values(*of, True, *level) for level in naghdi_slices.LEVELS), SLICES)


def soft_roof() -> dict[str, Estimate]:
    """Known values of the roof on soft diaphragms by slices; the membrane energy is a difference of energies."""
    levels = (naghdi_slices.roof_values(ROOF, True, *level) for level in naghdi_slices.LEVELS)
    found = _estimates(*levels, SLICES)
    found["membrane_energy"] = Estimate(
        found["membrane_energy"].value, DIFFERENCE * found["membrane_energy"].value, "J"
    )
    return _with_bending(found)


def soft_roof_by_polynomials() -> dict[str, Estimate]:
    """The same by the Ritz method; the uncertainty is the change from lower degrees."""
    levels = (roof_values(ROOF, degrees, True) for degrees in ((48, 44), (40, 36)))
    return _with_bending(_estimates(*levels, ROUNDING))


def _with_bending(found: dict[str, Estimate]) -> dict[str, Estimate]:
    whole, part = found["strain_energy"], found["membrane_energy"]
    bending = Estimate(whole.value - part.value, whole.uncertainty + part.uncertainty, "J")
    return {**found, "bending_energy": bending}


def hyperboloid(thickness: float, clamped: bool) -> dict[str, Estimate]:
    """Known values of a hyperboloid by collocation; the uncertainty is the change from fewer cells, and rounding."""
    levels = naghdi_revolution.LEVELS
    found = (naghdi_revolution.by_collocation(thickness, clamped, *level) for level in levels)
    return _estimates(*found, _rounding(thickness, clamped))


def hyperboloid_by_splines(thickness: float, clamped: bool) -> dict[str, Estimate]:
    """The same by splines."""
    levels = naghdi_revolution.SPLINES
    found = (naghdi_revolution.by_splines(thickness, clamped, *level) for level in levels)
    return _estimates(*found, _rounding(thickness, clamped))


def _rounding(thickness: float, clamped: bool) -> float:
    # A free shell bends without stretching: stiffnesses cancel as (R / h)^2.
    return ROUNDING if clamped else ROUNDING + np.finfo(float).eps / thickness**2


def hypar(name: str) -> dict[str, Estimate]:
    """Values of the hypar by Bernstein polynomials; the uncertainty is twice the change from a coarser level."""
    levels = (naghdi_hypar.solved(*naghdi_hypar.CASES[name], level) for level in naghdi_hypar.LEVELS[name])
    return {
        quantity: Estimate(one.value, 2 * one.uncertainty, one.unit)
        for quantity, one in _estimates(*levels, ROUNDING).items()
    }


Values = Callable[[], dict[str, Estimate]]
HYPERBOLOIDS = {
    f"hyperboloid_{rims}_{name}@naghdi": (thickness, rims == "clamped")
    for rims in ("clamped", "free")
    for name, thickness in (("1e_2", 1e-2), ("1e_3", 1e-3), ("1e_4", 1e-4))
}
JUDGES: dict[str, Values] = {
    "scordelis_lo_naghdi": scordelis_lo_naghdi,
    "scordelis_lo@naghdi": lambda: _with_bending(scordelis_lo_naghdi()),
    "scordelis_lo@naghdi_soft": soft_roof,
    "thick_plate_naghdi": partial(hard_plate, THICK),
    "thick_plate_naghdi@naghdi_soft": partial(plate_by_slices, THICK),
    "square_plate@naghdi": partial(hard_plate, SQUARE),
    "square_plate@naghdi_soft": partial(plate_by_slices, SQUARE),
    **{name: partial(hyperboloid, *of) for name, of in HYPERBOLOIDS.items()},
    "hypar_naghdi": hypar_naghdi,
    **{f"hypar_clamped_{name}@naghdi": partial(hypar, name) for name in naghdi_hypar.LEVELS},
}
SECOND_FORMS: dict[str, Values] = {
    "scordelis_lo_naghdi": scordelis_lo_by_polynomials,
    "scordelis_lo@naghdi": lambda: _with_bending(scordelis_lo_by_polynomials()),
    "scordelis_lo@naghdi_soft": soft_roof_by_polynomials,
    "hypar_naghdi": hypar_naghdi_by_polynomials,
    "thick_plate_naghdi": partial(plate_by_polynomials, THICK, False, (20, 14), 1e-13),
    "thick_plate_naghdi@naghdi_soft": partial(plate_by_polynomials, THICK, True, (36, 24), 1e-13),
    "square_plate@naghdi": partial(plate_by_polynomials, SQUARE, False, (28, 20), 1e-12),
    "square_plate@naghdi_soft": partial(plate_by_polynomials, SQUARE, True, (48, 40), ROUNDING),
    **{name: partial(hyperboloid_by_splines, *of) for name, of in HYPERBOLOIDS.items()},
}
