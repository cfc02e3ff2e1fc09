r"""The roof and the free pinched cylinder by exact exponentials: the second form of their displacements and energies.

`levy_roof` and `pinched_free` expand each harmonic in Legendre polynomials; here each is a sum of exponentials whose
coefficients follow from elementary integrals (see `exponentials`). The energies are integrals of the solution's own
strains, not the work of the loads.

Axisymmetric bending of the cylinder, n = 0, has double roots and stands by itself. Without axial force U' = -nu W / R,
and what is left is a beam on an elastic foundation,

    1/2 int [E h W^2 / R^2 + B (W''^2 - 2 nu W'' W / R^2 + W^2 / R^4)] dx,

with the four exponents B z^4 - 2 nu B z^2 / R^2 + E h / R^2 + B / R^4 = 0.
"""

from __future__ import annotations

import numpy as np

from .cylinder import Cylinder, strains_of_angular_harmonic, strains_of_axial_harmonic
from .estimate import Estimate, algebraic_series_sum
from .exponentials import (
    ExponentialSum,
    ExponentialTerms,
    constrained_stationary_point,
    point_load_harmonic,
    roof_harmonic,
)
from .levy_roof import HALF_ANGLE, roof
from .levy_roof import LOAD as ROOF_LOAD
from .pinched_diaphragm import LOAD, pinched_cylinder
from .pinched_free import TAIL_POWER

LOST_DIGITS = 10.0
"""Rounding of the exponentials relative to that of the polynomials: their matrices are nearly singular."""


def roof_sums(cylinder: Cylinder, last_harmonic: int) -> dict[str, float]:
    """Edge deflection and largest displacement (m), both at mid-length of the edge, and energies (J)."""
    edge, energies = [], []
    harmonics = np.arange(1, last_harmonic + 1, 2)
    for m in harmonics:
        strains = strains_of_axial_harmonic(cylinder.radius, m * np.pi / cylinder.length)
        solution = roof_harmonic(strains, sum(cylinder.elasticity()), HALF_ANGLE, 4 * ROOF_LOAD / (m * np.pi))
        edge.append(solution.at(HALF_ANGLE))
        energies.append(solution.energies(strains, cylinder.elasticity()))
    _, v, w = np.sin(harmonics * np.pi / 2) @ np.array(edge)
    # Two halves, R dt along the arc, int sin^2 dx = L/2.
    membrane, bending = cylinder.radius * cylinder.length * np.sum(energies, axis=0)
    return {
        "edge_deflection": float(v * np.sin(HALF_ANGLE) - w * np.cos(HALF_ANGLE)),
        "largest_displacement": float(np.hypot(v, w)),
        "strain_energy": float(membrane + bending),
        "membrane_energy": float(membrane),
        "bending_energy": float(bending),
    }


def roof_by_exponentials(thickness: float = 0.25, last_harmonic: int = 199) -> dict[str, Estimate]:
    """Values of the roof; the uncertainty is the change from half as many harmonics, and rounding."""
    cylinder = roof(thickness)
    fine, coarse = (roof_sums(cylinder, last) for last in (last_harmonic, last_harmonic // 2))
    estimates = {}
    for name, value in fine.items():
        energy = name.endswith("energy")
        rounding = LOST_DIGITS * cylinder.rounding * fine["strain_energy" if energy else "largest_displacement"]
        estimates[name] = Estimate.between(value, coarse[name], "J" if energy else "m", rounding)
    return estimates


def axisymmetric_harmonic(cylinder: Cylinder, length: float, load: float) -> ExponentialSum:
    """Harmonic 0 of a free cylinder [0, length] with U(0) = W'(0) = 0, load on W at 0; U up to a shift along the axis."""
    radius, nu, b = cylinder.radius, cylinder.poisson, cylinder.bending_stiffness
    foundation = cylinder.membrane_stiffness * (1 - nu**2) / radius**2 + b / radius**4
    squares = np.roots([b, -2 * nu * b / radius**2, foundation]).astype(complex)
    roots = np.concatenate([np.sqrt(squares), -np.sqrt(squares)])
    vectors = np.array([-nu / (radius * roots), 0 * roots, 1 + 0 * roots])
    terms = ExponentialTerms(0.0, length, roots, vectors)
    own = terms.strains(strains_of_angular_harmonic(radius, 0))
    matrix = (own.T @ sum(cylinder.elasticity()) @ own) * terms.overlap(terms)
    level = terms.evaluate(0.0, 1)[2][None]
    return ExponentialSum(terms, constrained_stationary_point(matrix, load * terms.evaluate(0.0)[2], level))


def free_cylinder_sums(cylinder: Cylinder, last_harmonic: int) -> tuple[float, float, float]:
    """Inward displacement under a load (m), membrane and bending energy (J), tails included."""
    even = np.arange(0, last_harmonic + 1, 2)
    rows = []
    for n in even:
        strains = strains_of_angular_harmonic(cylinder.radius, int(n))
        # Two halves of the length and R int cos^2 dt around make the load P / factor on W(0), for both loads.
        factor = 2.0 * cylinder.radius * np.pi * (2.0 if n == 0 else 1.0)
        load = 2.0 * LOAD / factor
        if n == 0:
            solution = axisymmetric_harmonic(cylinder, cylinder.length / 2, load)
        else:
            solution = point_load_harmonic(strains, sum(cylinder.elasticity()), cylinder.length / 2, load)
        energies = solution.energies(strains, cylinder.elasticity())
        rows.append([solution.at(0.0)[2], *(factor * e for e in energies)])
    first, *_ = rows
    return tuple(
        float(start) + algebraic_series_sum(even[1:], terms[1:], TAIL_POWER)
        for start, terms in zip(first, np.array(rows).T, strict=True)
    )


def free_cylinder_by_exponentials(last_harmonic: int = 120) -> dict[str, Estimate]:
    """Values of the free pinched cylinder; the uncertainty is the change from 2/3 of the harmonics, both summed."""
    cylinder = pinched_cylinder()
    fine, coarse = (free_cylinder_sums(cylinder, last) for last in (last_harmonic, 2 * last_harmonic // 3))

    def estimate(fine_value: float, coarse_value: float, unit: str) -> Estimate:
        scale = fine[1] + fine[2] if unit == "J" else fine[0]
        return Estimate.between(fine_value, coarse_value, unit, LOST_DIGITS * cylinder.rounding * scale)

    deflection = estimate(fine[0], coarse[0], "m")
    return {
        "load_displacement": deflection,
        "largest_displacement": deflection,
        "strain_energy": estimate(fine[1] + fine[2], coarse[1] + coarse[2], "J"),
        "membrane_energy": estimate(fine[1], coarse[1], "J"),
        "bending_energy": estimate(fine[2], coarse[2], "J"),
    }
