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

import numpy as np

from .estimate import Estimate
from .naghdi_ritz import FACTOR, plate, roof_values
from .naghdi_roof import solve_roof
from .plate_series import Rectangle, Uniform, levy

SIDE, THICKNESS, YOUNG, POISSON, PRESSURE = 10.0, 1.0, 1e7, 0.3, 1.0
ROOF = 0.25  # thickness, m
ENERGIES = "strain_energy", "membrane_energy"
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


def _plate(terms: int) -> dict[str, float]:
    m = np.arange(1, 2 * terms, 2, dtype=float)
    alpha = m * np.pi / 2
    sech = 2 * np.exp(-alpha) / (1 + np.exp(-2 * alpha))
    sign = np.where(m % 4 == 1, 1.0, -1.0)
    centre = 4 * SIDE**2 / np.pi**3 * np.sum(sign / m**3 * (1 - sech))
    whole = 8 * SIDE**4 / np.pi**4 * np.sum(1 / m**4 * (1 - np.tanh(alpha) / alpha))
    shear = FACTOR * YOUNG / (2 * (1 + POISSON)) * THICKNESS
    middle = np.array([[SIDE / 2, SIDE / 2]])
    kirchhoff, energy = levy(Rectangle(SIDE, SIDE, THICKNESS, YOUNG, POISSON), Uniform(PRESSURE), terms, middle)
    deflection = float(kirchhoff[0] + PRESSURE * centre / shear)
    return {
        "centre_deflection": deflection,
        "largest_displacement": deflection,
        "strain_energy": float(energy + 0.5 * PRESSURE**2 * whole / shear),
    }


def thick_plate_naghdi() -> dict[str, Estimate]:
    """Known values of the plate; the uncertainty is the change from half the harmonics."""
    return _estimates(_plate(4000), _plate(2000), 1e-14)


def thick_plate_by_polynomials() -> dict[str, Estimate]:
    """The same by the Ritz method; the uncertainty is the change from lower degrees."""
    levels = []
    for degree in (20, 14):
        found = plate(SIDE, THICKNESS, YOUNG, POISSON, PRESSURE).solve((degree, degree))
        deflection = -float(found.displacement(np.array([SIDE / 2]), np.array([SIDE / 2]))[0, 0, 2])
        energy = 4 * found.half_work
        levels.append({"centre_deflection": deflection, "largest_displacement": deflection, "strain_energy": energy})
    return _estimates(*levels, 1e-13)


Values = Callable[[], dict[str, Estimate]]
JUDGES: dict[str, Values] = {"scordelis_lo_naghdi": scordelis_lo_naghdi, "thick_plate_naghdi": thick_plate_naghdi}
SECOND_FORMS: dict[str, Values] = {
    "scordelis_lo_naghdi": scordelis_lo_by_polynomials,
    "thick_plate_naghdi": thick_plate_by_polynomials,
}
