r"""The compressed sleeve before it buckles, as a boundary value problem along its axis.

An axisymmetric state is a meridian (r, y)(s), 0 <= s <= L/2, with r' = l sin(psi), y' = l cos(psi). Its strains, per
unit length of the undeformed cylinder, are

    E_s = (l^2 - 1)/2,  E_t = (r^2/R^2 - 1)/2,  k_s = -l psi',  k_t = (r cos(psi) - R)/R^2,

and W = D/2 (E_s^2 + 2 nu E_s E_t + E_t^2) + B/2 (k_s^2 + 2 nu k_s k_t + k_t^2). With multipliers H and V of the two
constraints, M = dW/dpsi' and primes d/ds, it is stationary where

    H' = dW/dr,  V' = 0,  M' = dW/dpsi - l (H cos(psi) - V sin(psi)),  dW/dl = H sin(psi) + V cos(psi).

The last equation gives l at each point. At the rim r = R and psi = 0; in the middle y = 0, psi = 0 and H = 0. The rim is
moved by half the shortening. The axial force is -2 pi R V. SciPy's collocation of fourth order (`solve_bvp`) solves it;
nothing of it is shared with `sleeve`, which minimises the energy of positions in polynomials.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp

from .estimate import Estimate
from .surface_strains import Array

RADIUS, LENGTH, YOUNG, POISSON, THICKNESS = 0.25, 1.0, 5000.0, 0.25, 0.0012
STRETCHING = YOUNG * THICKNESS / (1 - POISSON**2)
BENDING = STRETCHING * THICKNESS**2 / 12
MOST_POINTS = 100_000
NEWTON_STEPS = 8
"""For the stretch l, which is within a percent of one: the error squares in each."""


@dataclass(frozen=True)
class Layers:
    """Force, N, and energies, J, of the whole sleeve."""

    force: float
    membrane: float
    bending: float


def _stretch(r: Array, psi: Array, moment: Array, radial: Array, axial: float | Array) -> tuple[Array, Array]:
    """Return l and psi' where M, H and V are given."""
    around = (r**2 / RADIUS**2 - 1) / 2
    bent = (r * np.cos(psi) - RADIUS) / RADIUS**2
    pull = radial * np.sin(psi) + axial * np.cos(psi)
    stretch = np.ones_like(r)
    for _ in range(NEWTON_STEPS):
        turn = _turn(stretch, moment, bent)
        residual = STRETCHING * stretch * ((stretch**2 - 1) / 2 + POISSON * around) + turn * moment / stretch - pull
        # The second term varies by B/D of the first: Newton's method without its derivative converges as well.
        stretch = stretch - residual / (STRETCHING * ((3 * stretch**2 - 1) / 2 + POISSON * around))
    return stretch, _turn(stretch, moment, bent)


def _turn(stretch: Array, moment: Array, bent: Array) -> Array:
    """Return psi' of M = -l B (k_s + nu k_t) and k_s = -l psi'."""
    return (moment / (BENDING * stretch) + POISSON * bent) / stretch


def compressed(shortening: float, tolerance: float) -> Layers:
    """Return the axisymmetric equilibrium at a shortening, m.

    Raises
    ------
    ArithmeticError : the collocation does not converge
    """
    force_scale, moment_scale = STRETCHING * shortening / LENGTH, BENDING / RADIUS

    def rates(s: Array, z: Array, p: Array) -> Array:
        r, _, psi, moment, radial = _unscaled(z)
        axial = p[0] * force_scale
        stretch, turn = _stretch(r, psi, moment, radial, axial)
        along, around = (stretch**2 - 1) / 2, (r**2 / RADIUS**2 - 1) / 2
        bent_along, bent_around = -stretch * turn, (r * np.cos(psi) - RADIUS) / RADIUS**2
        hoop = STRETCHING * (around + POISSON * along) * r / RADIUS**2
        couple = BENDING * (bent_around + POISSON * bent_along) / RADIUS**2
        return np.stack(
            [
                stretch * np.sin(psi) / shortening,
                (stretch * np.cos(psi) - 1) / shortening,
                turn,
                (-couple * r * np.sin(psi) - stretch * (radial * np.cos(psi) - axial * np.sin(psi))) / moment_scale,
                (hoop + couple * np.cos(psi)) / force_scale,
            ]
        )

    def _unscaled(z: Array) -> tuple[Array, ...]:
        # z holds the displacements over the shortening (y as its difference from s), psi, and scaled M and H.
        return RADIUS + shortening * z[0], z[1], z[2], moment_scale * z[3], force_scale * z[4]

    def ends(a: Array, b: Array, p: Array) -> Array:
        return np.array([a[1], a[2], a[4], b[0], b[2], b[1] + 0.5])

    # Points crowd at the rim, s = L/2, where the state bends over sqrt(R h).
    s = LENGTH / 2 * (1 - np.linspace(1, 0, 400) ** 2)
    found = solve_bvp(rates, ends, s, np.zeros((5, len(s))), p=[-1.0], tol=tolerance, max_nodes=MOST_POINTS)
    if not found.success:
        raise ArithmeticError(found.message)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    width = np.diff(found.x)[:, None] / 2
    points = (found.x[:-1, None] + width * (1 + nodes)).ravel()
    weights = 2 * 2 * np.pi * RADIUS * (width * weights).ravel()  # both halves, all around
    r, _, psi, moment, radial = _unscaled(found.sol(points))
    axial = found.p[0] * force_scale
    stretch, turn = _stretch(r, psi, moment, radial, axial)
    strains = ((stretch**2 - 1) / 2, (r**2 / RADIUS**2 - 1) / 2)
    bends = (-stretch * turn, (r * np.cos(psi) - RADIUS) / RADIUS**2)
    membrane, bending = (
        float(weights @ (stiffness / 2 * (a**2 + 2 * POISSON * a * b + b**2)))
        for stiffness, (a, b) in ((STRETCHING, strains), (BENDING, bends))
    )
    return Layers(float(-2 * np.pi * RADIUS * axial), membrane, bending)


def sleeve_compression_thin_by_collocation() -> dict[str, Estimate]:
    """Second origin of the compressed sleeve of h = 0.0012 m, before it buckles."""
    values: dict[str, Estimate] = {}
    for millimetres in (1, 2):
        fine, coarse = (compressed(millimetres / 1000, tolerance) for tolerance in (1e-9, 1e-7))
        pairs = {
            "force": (fine.force, coarse.force, "N"),
            "strain_energy": (fine.membrane + fine.bending, coarse.membrane + coarse.bending, "J"),
            "bending_energy": (fine.bending, coarse.bending, "J"),
        }
        for name, (one, other, unit) in pairs.items():
            values[f"{name}_{millimetres}mm"] = Estimate.between(one, other, unit, 1e-9 * abs(one))
    return values
