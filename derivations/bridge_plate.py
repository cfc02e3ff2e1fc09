r"""A square plate, supported at two opposite edges and free at the others, whose bending has its own Poisson's ratio.

It is the continuum limit of the local structures of Shu et al. (cases/field_bridge_12.toml). Over all directions their
losses are, for small strains E and curvatures k,

    w_s 3 (2 tr E^2 + tr^2 E) / 8      and      w_b s^2 (3/4 tr^2 k - 2 det k),

the energies of a shell with D = 9/4 w_s and nu = 1/3, and with B = 3/2 w_b s^2 and nu_b = -1/3. A shell of thickness h
has B = D h^2 / 12, hence h = s sqrt(8 w_b / w_s); with E h = D (1 - nu^2) that is all of its material.

With w = sum_m Y_m(y) sin(alpha x), alpha = m pi, B laplace^2 w = q has Levy's solution

    Y = 4 q / (m pi B alpha^4) + A cosh(alpha y) + C alpha y sinh(alpha y),    -1/2 < y < 1/2,

and the free edges say Y'' = nu_b alpha^2 Y, Y''' = (2 - nu_b) alpha^2 Y' (Timoshenko & Woinowsky-Krieger 1959,
section 48). A negative nu_b bends the plate alike in both directions: it sags most at its centre.

The second form minimises the potential energy over polynomials.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss

from .estimate import Estimate
from .surface_strains import Array

STRAIN, HEIGHT = 0.005, 0.1  # w_s of the structures, and h, m
WEIGHT = 2.0 * 3e-8  # w_g m g, N/m^2
STRETCHING = 9 / 4 * STRAIN
BENDING = STRETCHING * HEIGHT**2 / 12
POISSON = -1 / 3  # of bending
TERMS = 400, 200
DEGREES = 20, 16
ROUNDING = 1e-12


def levy(terms: int) -> tuple[Array, float]:
    """Downward displacement (2,) of the centre and of the middle of a free edge, m, and strain energy, J."""
    deflections, volume = np.zeros(2), 0.0
    for m in range(1, 2 * terms, 2):
        alpha, beta = m * np.pi, m * np.pi / 2
        first = 4 * WEIGHT / (m * np.pi * BENDING * alpha**4)
        # hyperbolic functions over cosh(beta)
        c, s, least = 1.0, np.tanh(beta), 2 * np.exp(-beta) / (1 + np.exp(-2 * beta))
        rows = [
            [(1 - POISSON) * c, 2 * c + (1 - POISSON) * beta * s],
            [(POISSON - 1) * s, (1 + POISSON) * s + (POISSON - 1) * beta * c],
        ]
        a, b = np.linalg.solve(rows, [POISSON * first, 0.0])
        deflections += np.sin(alpha / 2) * np.array([first + a * least, first + a * c + b * beta * s])
        volume += 2 / alpha * (first + 2 * a * s / alpha + b * (c - 2 * s / alpha))
    return deflections, WEIGHT * volume / 2


def ritz(degree: int) -> tuple[Array, float]:
    """The same, w = x (1 - x) times products of even Legendre polynomials up to a degree."""
    places, weights = leggauss(degree + 6)
    x = (places + 1) / 2
    bubble = Legendre.fromroots([-1, 1]) * -0.25  # x (1 - x) of 2 x - 1

    def functions(along: Legendre | float, at: Array) -> list[Array]:
        families = [along * Legendre.basis(k) for k in range(0, degree + 1, 2)]
        return [np.stack([2.0**d * f.deriv(d)(2 * at - 1) for f in families], axis=1) for d in range(3)]

    f, g = functions(bubble, x), functions(1.0, x)

    def product(i: int, j: int) -> Array:
        return np.einsum("pa,qb->pqab", f[i], g[j]).reshape(len(x) ** 2, -1)

    shares = np.outer(weights, weights).ravel() / 4
    xx, yy, xy = product(2, 0), product(0, 2), product(1, 1)
    trace = xx + yy
    mixed = (xx * shares[:, None]).T @ yy
    gauss = mixed + mixed.T - 2 * (xy * shares[:, None]).T @ xy
    stiffness = BENDING * ((trace * shares[:, None]).T @ trace - (1 - POISSON) * gauss)
    load = WEIGHT * shares @ product(0, 0)
    scale = 1 / np.sqrt(np.diag(stiffness))
    factors = scale * np.linalg.solve(stiffness * scale[:, None] * scale, load * scale)
    (middle,), across = functions(bubble, np.array([0.5]))[0], functions(1.0, np.array([0.5, 0.0]))[0]
    return np.array([np.outer(middle, row).ravel() @ factors for row in across]), float(load @ factors / 2)


def _estimates(fine: tuple[Array, float], coarse: tuple[Array, float], rounding: float) -> dict[str, Estimate]:
    centre, edge = (Estimate.between(f, c, "m", rounding * f) for f, c in zip(fine[0], coarse[0], strict=True))
    energy = Estimate.between(fine[1], coarse[1], "J", rounding * fine[1])
    return {
        "centre_deflection": centre,
        "edge_deflection": edge,
        "largest_displacement": centre,
        "strain_energy": energy,
        "bending_energy": energy,
    }


APART = 2.0  # s^2 times this bounds what a sheet of structures may differ from its limit by, measured, relative


def sheet(side: float) -> dict[str, Estimate]:
    """Values of cases/field_bridge_*.toml in the limit; their uncertainty is the deviation of structures of a side s, m."""
    return _of_a_sheet(bridge_plate(), side)


def sheet_by_ritz(side: float) -> dict[str, Estimate]:
    """The same by polynomials."""
    return _of_a_sheet(bridge_plate_by_ritz(), side)


def _of_a_sheet(plate: dict[str, Estimate], side: float) -> dict[str, Estimate]:
    names = {"centre": "centre_deflection", "edge": "edge_deflection"}
    values = {name: plate[known] for name, known in names.items()}
    return {n: Estimate(-v.value, v.uncertainty + APART * side**2 * v.value, "m") for n, v in values.items()}


def bridge_plate() -> dict[str, Estimate]:
    """Known values of cases/bridge_plate.toml: Levy's series."""
    return _estimates(levy(TERMS[0]), levy(TERMS[1]), ROUNDING)


def bridge_plate_by_ritz() -> dict[str, Estimate]:
    """The same by polynomials."""
    return _estimates(ritz(DEGREES[0]), ritz(DEGREES[1]), 1e2 * ROUNDING)
