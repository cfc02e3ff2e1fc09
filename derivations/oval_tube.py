r"""A short closed cylinder, clamped at one rim and free at the other, under a radial load q cos(n theta).

All is one angular harmonic (see `cylinder`): u = U cos(n t), v = V sin(n t), w = W cos(n t), t = theta, on x in [0, L] with
U = V = W = W' = 0 at x = 0 and natural conditions at x = L. The free rim turns oval and the clamped one stays round, so that
the tube stretches: 95 % of its energy is that of the membrane.

- Legendre polynomials: `strip`.
- Exact exponentials: `exponentials`. The load is constant along x and has the particular solution A(0)^-1 (0, 0, q), which
  misses the clamp; the eight homogeneous solutions correct it.

The energies are integrals of strains in both; W = half the work of the load is a check.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from .cylinder import Cylinder, strains_of_angular_harmonic
from .estimate import Estimate
from .exponentials import ExponentialSum, ExponentialTerms, symbol, symbol_coefficients
from .strip import Strip

WAVES = 2
LOAD = 1000.0  # q, N/m^2, outward at theta = 0
CLAMP = ("U(left)", "V(left)", "W(left)", "W'(left)")
POINTS = {  # theta, degrees, and x, m; direction
    "rim_deflection": (((0.0, 8.0),), (1.0, 0.0, 0.0)),
    "side_deflection": (((80.0, 6.0),), (0.0, 0.0, -2.0)),
    "mean_oblique": (((20.0, 8.0), (70.0, 4.0), (200.0, 6.5)), (1.0, 2.0, -2.0)),
}


def tube() -> Cylinder:
    """Midsurface and material of cases/oval_tube.toml; its axis is y, and theta is measured from x toward z."""
    return Cylinder(radius=10.0, length=8.0, thickness=0.2, young=1e9, poisson=0.3)


@dataclass(frozen=True)
class Harmonic:
    """Amplitudes (U, V, W) as a function of x, m, and the membrane and bending energy, J."""

    amplitudes: Callable[[float], np.ndarray]
    energies: tuple[float, float]

    def displacement(self, degrees: float, x: float) -> np.ndarray:
        """Cartesian displacement (3,) of a point, m."""
        t = np.radians(degrees)
        u, v, w = self.amplitudes(x) * [np.cos(WAVES * t), np.sin(WAVES * t), np.cos(WAVES * t)]
        return np.array([w * np.cos(t) - v * np.sin(t), u, w * np.sin(t) + v * np.cos(t)])

    def values(self) -> dict[str, float]:
        """All quantities."""
        found = {}
        for name, (points, direction) in POINTS.items():
            unit = np.array(direction) / np.linalg.norm(direction)
            found[name] = float(np.mean([self.displacement(*point) @ unit for point in points]))
        membrane, bending = self.energies
        return found | {
            "strain_energy": membrane + bending,
            "membrane_energy": membrane,
            "bending_energy": bending,
        }


def by_polynomials(cylinder: Cylinder, degree: int) -> Harmonic:
    """The harmonic by Legendre polynomials."""
    strip = Strip(0.0, cylinder.length, degree)
    stiffnesses = strip.stiffnesses(strains_of_angular_harmonic(cylinder.radius, WAVES), cylinder.elasticity())
    load = strip.distributed_load(lambda x: LOAD * np.stack([0 * x, 0 * x, 1 + 0 * x], axis=-1))
    q = strip.minimise(sum(stiffnesses), load, CLAMP)
    around = np.pi * cylinder.radius  # R int cos^2 dt
    energies = tuple(float(around * q @ k @ q / 2) for k in stiffnesses)
    return Harmonic(lambda x: strip.basis(np.array([x]))[0, 0] @ q, energies)


def by_exponentials(cylinder: Cylinder) -> Harmonic:
    """The harmonic by exact exponentials."""
    strains = strains_of_angular_harmonic(cylinder.radius, WAVES)
    elasticity = sum(cylinder.elasticity())
    coefficients = symbol_coefficients(strains, elasticity)
    terms = ExponentialTerms.homogeneous(coefficients, 0.0, cylinder.length)
    force = np.array([0.0, 0.0, LOAD])
    response = np.linalg.solve(symbol(coefficients, 0.0), force)
    exponents = np.append(terms.exponents, 0.0)
    every = ExponentialTerms(0.0, cylinder.length, exponents, np.column_stack([terms.vectors, response]))

    # Stationary energy over the eight coefficients, the ninth being one, where the clamp holds.
    own = every.strains(strains)
    matrix = (own.T @ elasticity @ own) * every.overlap(every)
    constant = ExponentialTerms(0.0, cylinder.length, np.zeros(1), force[:, None])
    work = ((every.vectors.T @ force[:, None]) * every.overlap(constant))[:, 0]
    clamp = np.vstack([every.evaluate(0.0), every.evaluate(0.0, 1)[2:]])
    clamp, shift = clamp[:, :-1], -clamp[:, -1]
    size = np.linalg.norm(clamp, axis=1)
    clamp, shift = clamp / size[:, None], shift / size
    start = np.linalg.lstsq(clamp, shift, rcond=None)[0]
    basis = null_space(clamp)
    stiffness, right = matrix[:-1, :-1], work[:-1] - matrix[:-1, -1]
    reduced = basis.T @ stiffness @ basis
    scale = 1.0 / np.sqrt(np.abs(np.diagonal(reduced)))
    free = np.linalg.solve(scale[:, None] * reduced * scale, scale * (basis.T @ (right - stiffness @ start)))
    solution = ExponentialSum(every, np.append(start + basis @ (scale * free), 1.0))
    energies = tuple(np.pi * cylinder.radius * e for e in solution.energies(strains, cylinder.elasticity()))
    return Harmonic(solution.at, energies)


def _estimates(fine: Harmonic, coarse: Harmonic) -> dict[str, Estimate]:
    estimates = {}
    values, rough = fine.values(), coarse.values()
    for name, value in values.items():
        energy = name.endswith("energy")
        rounding = 10 * tube().rounding * abs(values["strain_energy" if energy else "rim_deflection"])
        estimates[name] = Estimate.between(value, rough[name], "J" if energy else "m", rounding)
    return estimates


def oval_tube(degree: int = 48) -> dict[str, Estimate]:
    """Known values by Legendre polynomials; the uncertainty is the change from 2/3 of the degree."""
    return _estimates(by_polynomials(tube(), degree), by_polynomials(tube(), 2 * degree // 3))


def oval_tube_by_exponentials() -> dict[str, Estimate]:
    """Values by exponentials, uncertain by rounding."""
    exact = by_exponentials(tube())
    return _estimates(exact, exact)
