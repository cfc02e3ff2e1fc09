r"""Linear Kirchhoff-Love strains of a circular cylinder in physical components.

Coordinates are x along the axis and the angle theta; the displacement is u e_x + v e_theta + w e_r
with w *outward*. With d e_theta / d theta = -e_r and d e_r / d theta = e_theta,

    u,x     = u_x e_x + v_x e_theta + w_x e_r
    u,theta = u_theta e_x + (v_theta + w) e_theta + (w_theta - v) e_r

and once more for the second derivatives. All Christoffel symbols of (x, theta) vanish. The linear
strains eps_ab = (a_a . u,b + a_b . u,a) / 2 and kappa_ab = -u,ab . a3, the exact linearisation of
bbar_ab - b_ab, are therefore, in physical components and with a3 = e_r (Kairanda et al. 2023, eqs. (15),
(16), (30); cf. Koiter 1966),

    eps_x  = u_x          eps_t  = (v_theta + w) / R       2 eps_xt   = u_theta / R + v_x
    kap_x  = -w_xx        kap_t  = -(w_tt - 2 v_t - w) / R^2
    2 kap_xt = -2 (w_xt - v_x) / R

The choice of the normal's sign changes the sign of kappa alone, not the energy. This kappa is not
the modified measure of Sanders and Budiansky, which differs from it by terms of order eps / R.

A field that is harmonic in one of the two directions leaves three functions q = (U, V, W) of the
other one, s, and strains that are linear in q, q', q'': strain = S[0] q + S[1] q' + S[2] q'', with
S of shape (3, 6, 3) and rows (eps_x, eps_t, 2 eps_xt, kap_x, kap_t, 2 kap_xt).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Cylinder:
    """A circular cylinder's midsurface and material: lengths in m, Young's modulus in Pa."""

    radius: float
    length: float
    thickness: float
    young: float
    poisson: float

    @property
    def membrane_stiffness(self) -> float:
        """D = E h / (1 - nu^2), N/m."""
        return self.young * self.thickness / (1.0 - self.poisson**2)

    @property
    def bending_stiffness(self) -> float:
        """B = E h^3 / (12 (1 - nu^2)), N m."""
        return self.membrane_stiffness * self.thickness**2 / 12.0

    @property
    def rounding(self) -> float:
        """Relative rounding error to expect of a solved harmonic: epsilon D R^2 / B.

        Where a shell bends without stretching, stiffnesses of order D R^-2 cancel down to B R^-4.
        """
        ratio = self.membrane_stiffness * self.radius**2 / self.bending_stiffness
        return float(np.finfo(float).eps * ratio)

    def elasticity(self) -> tuple[np.ndarray, np.ndarray]:
        """Membrane and bending parts, each (6, 6), of the matrix C in W = strain . C strain / 2."""
        nu = self.poisson
        plane_stress = np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, (1.0 - nu) / 2.0]])
        membrane, bending = np.zeros((6, 6)), np.zeros((6, 6))
        membrane[:3, :3] = self.membrane_stiffness * plane_stress
        bending[3:, 3:] = self.bending_stiffness * plane_stress
        return membrane, bending


def strains_of_axial_harmonic(radius: float, alpha: float) -> np.ndarray:
    """S (3, 6, 3) of u = U(t) cos(alpha x), v = V(t) sin(alpha x), w = W(t) sin(alpha x), t = theta.

    The shear rows carry cos(alpha x), the others sin(alpha x); alpha in 1/m.
    """
    s = np.zeros((3, 6, 3))
    s[0, 0, 0] = -alpha
    s[1, 1, 1] = s[0, 1, 2] = 1.0 / radius
    s[1, 2, 0], s[0, 2, 1] = 1.0 / radius, alpha
    s[0, 3, 2] = alpha**2
    s[2, 4, 2], s[1, 4, 1], s[0, 4, 2] = -1.0 / radius**2, 2.0 / radius**2, 1.0 / radius**2
    s[1, 5, 2], s[0, 5, 1] = -2.0 * alpha / radius, 2.0 * alpha / radius
    return s


def strains_of_angular_harmonic(radius: float, n: int) -> np.ndarray:
    """S (3, 6, 3) of u = U(x) cos(n theta), v = V(x) sin(n theta), w = W(x) cos(n theta).

    The shear rows carry sin(n theta), the others cos(n theta).
    """
    s = np.zeros((3, 6, 3))
    s[1, 0, 0] = 1.0
    s[0, 1, 1], s[0, 1, 2] = n / radius, 1.0 / radius
    s[0, 2, 0], s[1, 2, 1] = -n / radius, 1.0
    s[2, 3, 2] = -1.0
    s[0, 4, 1], s[0, 4, 2] = 2.0 * n / radius**2, (n**2 + 1.0) / radius**2
    s[1, 5, 1], s[1, 5, 2] = 2.0 / radius, 2.0 * n / radius
    return s


def strains_of_double_harmonic(radius: float, alpha: np.ndarray, n: np.ndarray) -> np.ndarray:
    """S (..., 6, 3) for u = U cos(alpha x) cos(n t), v = V sin sin, w = W sin cos, amplitudes q.

    alpha (...) in 1/m and n (...) broadcast against each other; t = theta.
    """
    alpha, n = np.broadcast_arrays(np.asarray(alpha, float), np.asarray(n, float))
    s = np.zeros((*alpha.shape, 6, 3))
    s[..., 0, 0] = -alpha
    s[..., 1, 1], s[..., 1, 2] = n / radius, 1.0 / radius
    s[..., 2, 0], s[..., 2, 1] = -n / radius, alpha
    s[..., 3, 2] = alpha**2
    s[..., 4, 1], s[..., 4, 2] = 2.0 * n / radius**2, (n**2 + 1.0) / radius**2
    s[..., 5, 1], s[..., 5, 2] = 2.0 * alpha / radius, 2.0 * alpha * n / radius
    return s
