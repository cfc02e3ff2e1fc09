"""Square plate, simply supported, one edge clamped over its middle part, under uniform load: a dual series.

Moments M(y) on the part turn the edge x = 0 back by as much as the load turns it. By Levy's series in sin(m pi y) the
slope of the simply supported plate there is, with b = m pi and a side of 1,

    by the load q   4 q / (m pi) / (2 B b^3) (tanh b/2 - b/2 / cosh^2 b/2),     by M_m   M_m / (2 B b) (coth b - b / sinh^2 b).

The moment is infinite at both ends of the part as the inverse square root of the distance (Williams 1952). So it is
sought as M(y) = sum_j a_j T_2j(s) / sqrt(1 - s^2), s = (y - 1/2) / c, which has Fourier coefficients in closed form,

    M_m = 2 pi c sin(m pi / 2) sum_j (-1)^j a_j J_2j(m pi c),

and that the slope vanishes on the part is asked against the same functions (Galerkin). The sums over m go as 1 / m^2;
what is left of them is added by the mean of the Bessel functions' asymptotes.
"""

from __future__ import annotations

import numpy as np
from scipy.special import jv

from derivations.estimate import ROUNDING, Estimate

HALF = 0.25  # c: the part is as long as half of the edge
TERMS, FUNCTIONS = 200_001, 8  # of the sums, and of the moment


def deflection(
    load: float = 1.0, bending_stiffness: float = 1.0, terms: int = TERMS, functions: int = FUNCTIONS
) -> float:
    """Return the deflection of the centre of a plate of side 1, along the load, m."""
    m = np.arange(1, terms + 1, 2)
    b = m * np.pi
    small = np.minimum(b, 300.0)  # hyperbolic functions beyond it are one, or nothing
    sign = np.where(m % 4 == 1, 1.0, -1.0)
    turned = 2 * load / (m * np.pi) / (bending_stiffness * b**3)
    turned = turned * (np.tanh(small / 2) - small / 2 / np.cosh(small / 2) ** 2)
    gives = (1 / np.tanh(small) - small / np.sinh(small) ** 2) / (2 * bending_stiffness * b)
    order = np.arange(functions)
    bessel = (-1.0) ** order[:, None] * jv(2 * order[:, None], b * HALF)
    matrix = 2 * np.pi * HALF * (bessel * gives) @ bessel.T
    # J_2j(z) goes as (-1)^j sqrt(2 / (pi z)) cos(z - pi/4), whose square has the mean 1/2 over m; the sum of 1/m^2 over
    # odd m beyond n is 1 / (2 n).
    matrix += 2 * np.pi * HALF / (2 * bending_stiffness * np.pi) / (np.pi**2 * HALF) / (2 * (terms + 1))
    moment = np.linalg.solve(matrix, -(bessel @ (sign * turned)))
    moments = 2 * np.pi * HALF * sign * (moment @ bessel)
    a = small / 2
    by_load = 4 * load / (m * np.pi) / (bending_stiffness * b**4) * (1 - (1 + a * np.tanh(a) / 2) / np.cosh(a))
    by_moment = (np.cosh(a) / 2 - np.sinh(a) / np.tanh(small)) / (-2 * bending_stiffness * b * np.sinh(small))
    return float(np.sum(sign * (by_load + moments * by_moment)))


def partly_clamped_plate(load: float = 1.0, bending_stiffness: float = 1.0) -> Estimate:
    """Return the deflection of the centre, as sure as fewer terms and functions say."""
    value = deflection(load, bending_stiffness)
    fewer = deflection(load, bending_stiffness, TERMS // 4 * 2 + 1, FUNCTIONS - 2)
    return Estimate.between(value, fewer, "m", ROUNDING * abs(value))
