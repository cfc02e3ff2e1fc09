r"""A flat ring, clamped at its hub, under a load q cos(2 theta) across it and a traction tau along its circles.

In linear theory the two answers are apart. Across, w = f(r) cos(n theta), downward, n = 2, with

    B L^2 f = q,   L = d^2/dr^2 + (1/r) d/dr - n^2 / r^2,   f = q r^4 log(r) / (48 B) + c1 r^2 + c2 r^-2 + c3 r^4 + c4,

f = f' = 0 at the hub and, at the free rim, no moment, f'' + nu (f'/r - n^2 f / r^2) = 0, and no shear force in Kirchhoff's
sense, (L f)' - (1 - nu) n^2 (f'/r - f/r^2) / r = 0 (Timoshenko & Woinowsky-Krieger 1959, section 63). The ring twists:
kappa_rt = n (f'/r - f/r^2) sin(n theta).

In the plane every point moves along its circle by V(r), G h (V'' + V'/r - V/r^2) = -tau, with V = 0 at the hub and no shear,
V' - V/r = 0, at the rim: V = -tau r^2 / (3 G h) + d1 r + d2 / r.

`by_ritz` minimises the energies of both over polynomials times what vanishes at the hub: no condition at the rim.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre

from .estimate import Estimate

INNER, OUTER = 1.0, 2.0  # m
YOUNG, POISSON, THICKNESS = 2e11, 0.3, 0.02
LOAD, TRACTION = 1000.0, 2e4  # q and tau, N/m^2
WAVES = 2
BENDING = YOUNG * THICKNESS**3 / 12 / (1 - POISSON**2)
SHEAR = YOUNG * THICKNESS / (2 * (1 + POISSON))  # G h, N/m
ROUNDING = 1e-12  # relative
POINTS = {  # theta, degrees, and r, m; direction
    "rim_deflection": (((20.0, 2.0),), (0.0, 0.0, -1.0)),
    "oblique_displacement": (((65.0, 1.6),), (1.0, 2.0, -2.0)),
    "mean_slide": (((20.0, 2.0), (110.0, 1.5), (250.0, 1.7)), (-3.0, 0.0, 0.0)),
}


@dataclass(frozen=True)
class Ring:
    """Values and derivatives of f and V at radii, as Gauss points of the energies see them.

    Attributes
    ----------
    points, weights : radii (N,), m
    across : f, f', f'' there, (3, N)
    around : V, V' there, (2, N)
    at : f and V at any radius, m
    """

    points: np.ndarray
    weights: np.ndarray
    across: np.ndarray
    around: np.ndarray
    at: Callable[[float], tuple[float, float]]

    def bending_energy(self) -> tuple[float, float]:
        """Bending energy, J, and the part of it that twist stores."""
        r, (f, first, second) = self.points, self.across
        around = first / r - WAVES**2 * f / r**2
        twist = WAVES * (first / r - f / r**2)
        stretch = (second + around) ** 2 - 2 * (1 - POISSON) * second * around
        shares = [np.pi * BENDING / 2 * (self.weights * r) @ part for part in (stretch, 2 * (1 - POISSON) * twist**2)]
        return float(sum(shares)), float(shares[1])

    def membrane_energy(self) -> float:
        """Energy of the traction's displacement, J."""
        r, (v, slope) = self.points, self.around
        return float(np.pi * SHEAR * (self.weights * r) @ (slope - v / r) ** 2)

    def values(self) -> dict[str, float]:
        """All quantities of cases/ring_twist.toml."""
        found = {}
        for name, (points, direction) in POINTS.items():
            unit = np.array(direction) / np.linalg.norm(direction)
            moved = []
            for degrees, r in points:
                t = np.radians(degrees)
                f, v = self.at(r)
                moved.append([-v * np.sin(t), v * np.cos(t), -f * np.cos(WAVES * t)])
            found[name] = float(np.mean(np.array(moved) @ unit))
        bending, membrane = self.bending_energy()[0], self.membrane_energy()
        return found | {"strain_energy": bending + membrane, "membrane_energy": membrane, "bending_energy": bending}


def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    x, weights = np.polynomial.legendre.leggauss(count)
    half = (OUTER - INNER) / 2
    return INNER + half * (1 + x), weights * half


def closed_form() -> Ring:
    """The ring by its closed form."""
    n2, nu, p = WAVES**2, POISSON, LOAD / (48 * BENDING)
    powers = np.array([2.0, -2.0, 4.0, 0.0])

    def terms(r: float, order: int) -> np.ndarray:
        """Derivatives of the four powers."""
        factor = np.ones(4)
        for k in range(order):
            factor = factor * (powers - k)
        return factor * r ** (powers - order)

    def particular(r: float) -> np.ndarray:
        """q r^4 log(r) / (48 B) and three derivatives."""
        log = np.log(r)
        parts = [r**4 * log, r**3 * (4 * log + 1), r**2 * (12 * log + 7), r * (24 * log + 26)]
        return p * np.array(parts)

    def rim(f: float, first: float, second: float, third: float, r: float) -> list[float]:  # moment and shear force
        slope = third + second / r - (1 + n2) * first / r**2 + 2 * n2 * f / r**3
        return [
            second + nu * (first / r - n2 * f / r**2),
            slope - (1 - nu) * n2 * (first / r - f / r**2) / r,
        ]

    rows = np.array([terms(INNER, 0), terms(INNER, 1), *rim(*(terms(OUTER, k) for k in range(4)), OUTER)])
    right = -np.array([*particular(INNER)[:2], *rim(*particular(OUTER), OUTER)])
    c = np.linalg.solve(rows, right)

    s = -TRACTION / (3 * SHEAR)  # V = s r^2 + d1 r + d2 / r; V' - V/r = s r - 2 d2 / r^2
    d2 = s * OUTER**3 / 2
    d1 = -s * INNER - d2 / INNER**2

    def at(r: float) -> tuple[float, float]:
        return float(particular(r)[0] + terms(r, 0) @ c), s * r**2 + d1 * r + d2 / r

    r, weights = _gauss(60)
    across = np.array([particular(x)[:3] + [terms(x, k) @ c for k in range(3)] for x in r]).T
    around = np.array([s * r**2 + d1 * r + d2 / r, 2 * s * r + d1 - d2 / r**2])
    return Ring(r, weights, across, around, at)


def by_ritz(degree: int) -> Ring:
    """The ring by minimising its energy over polynomials of a degree in r, times (r - a)^2 across and r - a around."""
    r, weights = _gauss(4 * degree)
    half = (OUTER - INNER) / 2
    arm = Legendre([half, half], domain=[INNER, OUTER])  # r - a
    shapes = [Legendre.basis(k, domain=[INNER, OUTER]) for k in range(degree)]

    def solve(factor: Legendre, energy: Callable[[np.ndarray], np.ndarray], load: float) -> Legendre:
        trial = [factor * s for s in shapes]
        f = np.array([[t.deriv(k)(r) if k else t(r) for t in trial] for k in range(3)])
        stiffness = energy(f)
        return sum(c * t for c, t in zip(np.linalg.solve(stiffness, load * f[0] @ (weights * r)), trial, strict=True))

    def across(f: np.ndarray) -> np.ndarray:
        around = f[1] / r - WAVES**2 * f[0] / r**2
        twist = WAVES * (f[1] / r - f[0] / r**2)
        trace = f[2] + around
        dr = weights * r
        mixed = (f[2] * dr) @ around.T
        return BENDING * ((trace * dr) @ trace.T - (1 - POISSON) * (mixed + mixed.T - 2 * (twist * dr) @ twist.T))

    def around(v: np.ndarray) -> np.ndarray:
        shear = v[1] - v[0] / r
        return SHEAR * (shear * weights * r) @ shear.T

    f, v = solve(arm**2, across, LOAD), solve(arm, around, TRACTION)
    return Ring(
        r,
        weights,
        np.array([f(r), f.deriv()(r), f.deriv(2)(r)]),
        np.array([v(r), v.deriv()(r)]),
        lambda x: (float(f(x)), float(v(x))),
    )


def _estimates(fine: Ring, coarse: Ring, rounding: float) -> dict[str, Estimate]:
    values, rough = fine.values(), coarse.values()
    return {
        name: Estimate.between(value, rough[name], "J" if name.endswith("energy") else "m", rounding * abs(value))
        for name, value in values.items()
    }


def ring_twist() -> dict[str, Estimate]:
    """Known values by the closed form."""
    ring = closed_form()
    return _estimates(ring, ring, ROUNDING)


def ring_twist_by_ritz(degree: int = 15) -> dict[str, Estimate]:
    """Values by Ritz's method; the uncertainty is the change from 2/3 of the degree."""
    return _estimates(by_ritz(degree), by_ritz(2 * degree // 3), 1e-10)
