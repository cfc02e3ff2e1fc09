r"""A closed cylindrical sleeve, clamped at both rims and twisted: closed form of the linear theory.

The rims turn by +-lambda/2 without axial motion. Take v = R phi(x), phi = lambda (x/L - 1/2), and
u = w = 0: it meets the supports and the clamp (w_x = 0 at the rims), and strains

    2 eps_xt = R lambda / L,    kappa_xt = v_x / R = lambda / L,    all others zero.

The stress resultants N_xt and M_xt are constant, so the first variation
int (N_xt 2 delta eps_xt + 2 M_xt delta kappa_xt) dA, with 2 delta eps_xt = delta u_t / R +
delta v_x and delta kappa_xt = (delta v_x - delta w_xt) / R, integrates to rim values and periodic
terms, all zero: this is the exact minimiser. With D (1 - nu) / 2 = G h and B (1 - nu) = G h^3 / 6,

    W = 2 pi R L [G h (R lambda / L)^2 / 2 + G h^3 / 6 (lambda / L)^2],
    T = dW/dlambda = (2 pi R^3 G h / L) (1 + h^2 / (3 R^2)) lambda.

The first term is the membrane energy, the second bending; W = T lambda / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .estimate import Estimate


@dataclass(frozen=True)
class Sleeve:
    """Radius, length and thickness in m; Young's modulus in Pa."""

    radius: float = 0.25
    length: float = 1.0
    thickness: float = 0.0012
    young: float = 5000.0
    poisson: float = 0.25

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)), Pa."""
        return self.young / (2.0 * (1.0 + self.poisson))


def membrane_energy(sleeve: Sleeve, twist: float) -> float:
    """Membrane energy at the total relative twist (rad), J."""
    shear = sleeve.radius * twist / sleeve.length
    area = 2.0 * np.pi * sleeve.radius * sleeve.length
    return float(area * sleeve.shear_modulus * sleeve.thickness * shear**2 / 2.0)


def bending_energy(sleeve: Sleeve, twist: float) -> float:
    """Bending energy at the total relative twist (rad), J."""
    area = 2.0 * np.pi * sleeve.radius * sleeve.length
    stiffness = sleeve.shear_modulus * sleeve.thickness**3 / 6.0
    return float(area * stiffness * (twist / sleeve.length) ** 2)


def torque_per_radian(sleeve: Sleeve) -> float:
    """Torque over total relative twist, N m / rad."""
    r, h = sleeve.radius, sleeve.thickness
    membrane = 2.0 * np.pi * r**3 * sleeve.shear_modulus * h / sleeve.length
    return float(membrane * (1.0 + h**2 / (3.0 * r**2)))


def sleeve_torque(twist: float = 1.0, thickness: float = 0.0012) -> dict[str, Estimate]:
    """Known values at a total relative twist; energies go like its square, the rest is linear."""
    sleeve = Sleeve(thickness=thickness)
    membrane, bending = membrane_energy(sleeve, twist), bending_energy(sleeve, twist)
    return {
        "torque_per_radian": Estimate.exact(torque_per_radian(sleeve), "N m/rad"),
        "largest_displacement": Estimate.exact(sleeve.radius * abs(twist) / 2.0, "m"),
        "strain_energy": Estimate.exact(membrane + bending, "J"),
        "membrane_energy": Estimate.exact(membrane, "J"),
        "bending_energy": Estimate.exact(bending, "J"),
    }


FINITE = 10.0
"""Squares of the shear strain by which finite strains change torque and energy, at most: a rim that is held axially
pulls on the generators as they slant, and hoops give way, each by about one such square."""


def sleeve_twist_thin_by_torsion() -> dict[str, Estimate]:
    """Second origin of the sleeve of h = 0.0012 m twisted by 0.004 rad: linear torsion, and how far strains are finite."""
    sleeve, twist = Sleeve(), 0.004
    share = FINITE * (sleeve.radius * twist / sleeve.length) ** 2
    torque = torque_per_radian(sleeve) * twist
    return {
        "torque_4mrad": Estimate(torque, share * torque, "N m"),
        "strain_energy_4mrad": Estimate(torque * twist / 2, share * torque * twist / 2, "J"),
    }
