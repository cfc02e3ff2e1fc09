"""A cantilever strip of varying height and modulus on a bed of springs: a beam, and a bar, of its width.

Without lateral contraction the strip of cases/graded_strip.toml bends and stretches in one plane:

    (B w'')'' + k w = q,  w = w' = 0 at the wall, B w'' = (B w'')' = 0 at the end,    A u' = N,  N = p (L - x),

with A = E h and B = E h^3 / 12 of the modulus and the height at x. The judge is Ritz's method with polynomials, whose
energy holds the end's conditions by itself. The second form integrates the equations of equilibrium from the wall
(Runge-Kutta of order 8) and chooses moment and force there so that both vanish at the end.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp

from .estimate import Estimate

LENGTH, YOUNG, HEIGHT, ALONG = 2.0, 1e7, 0.05, 3000.0
END, INSIDE = 2.0, 0.9
DEGREES = 16, 24
"""Of the polynomials, coarser and finer."""
STEPS = 1e-10, 1e-13
"""Relative tolerances of the integration, coarser and finer."""
ROUNDING = 1e-12

Array = np.ndarray


def height(x: Array) -> Array:
    """Height of the strip, m."""
    return HEIGHT * (1 - x / 4)


def modulus(x: Array) -> Array:
    """Young's modulus, Pa."""
    return YOUNG * (1 + 0.2 * x**2)


def bending(x: Array) -> Array:
    """B, N m."""
    return modulus(x) * height(x) ** 3 / 12


def bed(x: Array) -> Array:
    """Stiffness of the bed, N/m^3."""
    return 500 * (1 + x)


def load(x: Array) -> Array:
    """Downward load, N/m^2."""
    return 50 * (2 - x)


def _values(
    w: tuple[float, float], u: tuple[float, float], held: float, bent: float, stretched: float
) -> dict[str, float]:
    """All quantities from deflections and displacements at the end and inside, the force of the bed and energies."""
    total = float(50 * LENGTH**2 / 2)
    return {
        "end_deflection": w[0],
        "mean_oblique": (sum(u) + 2 * sum(w)) / 6,
        "wall_force": total - held,
        "strain_energy": bent + stretched,
        "membrane_energy": stretched,
        "bending_energy": bent,
    }


def by_ritz(degree: int) -> dict[str, float]:
    """Quantities by polynomials of a degree, integrated by Gauss's rule."""
    nodes, weights = legendre.leggauss(2 * degree + 10)
    x, weights = LENGTH * (nodes + 1) / 2, LENGTH * weights / 2

    def basis(at: Array, clamp: int, order: int) -> Array:
        """Derivative of x^clamp times Legendre polynomials, (points, functions)."""
        s = 2 * np.asarray(at) / LENGTH - 1
        found = np.zeros((len(s), degree + 1))
        for n in range(degree + 1):
            # (1 + s)^clamp P_n as a series of its own; its derivatives are those by s times (2 / L)^order.
            series = legendre.legmul(
                legendre.poly2leg(np.polynomial.polynomial.polypow([1, 1], clamp)), np.eye(degree + 1)[n]
            )
            found[:, n] = legendre.legval(s, legendre.legder(series, order)) * (2 / LENGTH) ** order
        return found

    w0, w2, u1 = basis(x, 2, 0), basis(x, 2, 2), basis(x, 1, 1)
    shape = np.linalg.solve(
        w2.T @ ((weights * bending(x))[:, None] * w2) + w0.T @ ((weights * bed(x))[:, None] * w0),
        w0.T @ (weights * load(x)),
    )
    area = modulus(x) * height(x)
    pulled = np.linalg.solve(u1.T @ ((weights * area)[:, None] * u1), basis(x, 1, 0).T @ (weights * ALONG))
    places = np.array([END, INSIDE])
    w, u = basis(places, 2, 0) @ shape, basis(places, 1, 0) @ pulled
    held = float((weights * bed(x)) @ (w0 @ shape))
    bent = float((weights * bending(x)) @ (w2 @ shape) ** 2) / 2
    stretched = float((weights * area) @ (u1 @ pulled) ** 2) / 2
    return _values((w[0], w[1]), (u[0], u[1]), held, bent, stretched)


def by_equilibrium(tolerance: float) -> dict[str, float]:
    """Quantities by shooting from the wall: deflection, slope, moment m = B w'', force m', and integrals."""

    def rates(x: float, y: Array) -> Array:
        w, slope, moment, force = y[:4]
        strain = ALONG * (LENGTH - x) / (modulus(x) * height(x))
        pull = bed(x) * w
        energies = moment**2 / bending(x) / 2, strain**2 * modulus(x) * height(x) / 2
        return np.array([slope, moment / bending(x), force, load(x) - pull, strain, pull, *energies])

    def shot(moment: float, force: float) -> Array:
        start = [0.0, 0.0, moment, force, 0.0, 0.0, 0.0, 0.0]
        found = solve_ivp(
            rates,
            (0.0, END),
            start,
            method="DOP853",
            rtol=tolerance,
            atol=1e-16,
            dense_output=False,
            t_eval=[INSIDE, END],
        )
        return np.asarray(found.y)

    # Moment and force at the end are affine in those at the wall.
    free = shot(0.0, 0.0)[2:4, 1]
    columns = np.stack([shot(100.0, 0.0)[2:4, 1] - free, shot(0.0, 100.0)[2:4, 1] - free], axis=1) / 100
    inside, end = shot(*np.linalg.solve(columns, -free)).T
    return _values((end[0], inside[0]), (end[4], inside[4]), end[5], end[6], end[7])


def _estimates(fine: dict[str, float], coarse: dict[str, float]) -> dict[str, Estimate]:
    units = {name: "J" if name.endswith("energy") else "N" if name.endswith("force") else "m" for name in fine}
    return {
        name: Estimate.between(value, coarse[name], units[name], ROUNDING * abs(value)) for name, value in fine.items()
    }


def graded_strip() -> dict[str, Estimate]:
    """Known values by polynomials."""
    return _estimates(by_ritz(DEGREES[1]), by_ritz(DEGREES[0]))


def graded_strip_by_equilibrium() -> dict[str, Estimate]:
    """Known values by the equations of equilibrium."""
    return _estimates(by_equilibrium(STEPS[1]), by_equilibrium(STEPS[0]))
