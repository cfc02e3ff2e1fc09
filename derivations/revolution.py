r"""Linear Kirchhoff-Love shells of revolution: one angular harmonic, by covariant derivatives and Legendre-Ritz.

A meridian (r(t), z(t)) is turned about the z-axis by the angle theta. With ds = g dt along the meridian, the displacement
is u e_s + v e_theta + w n, where n = e_s x e_theta = (-z_t e_r + r_t e_z) / g points inward where z grows with t. The metric
is ds^2 + r^2 dtheta^2, and b_ab = a_a,b . n has the principal curvatures

    k1 = (r_t z_tt - r_tt z_t) / g^3,    k2 = z_t / (r g).

The linear strains are those of tensor calculus (Koiter 1966), a bar denoting the covariant derivative:

    eps_ab = (u_a|b + u_b|a) / 2 - b_ab w
    kap_ab = -(w|ab - b_a^l b_lb w + b_a^l u_l|b + b_b^l u_l|a + b_a^l|b u_l)

This is kap_ab = -d_ab . a3, the exact linearisation of bbar_ab - b_ab. By Codazzi's equations k2' = (r'/r) (k1 - k2) is all
that b_1^l|2 u_l and b_2^l|2 u_l need; a prime is a derivative by s. In physical components, a dot for d/dtheta:

    eps_1 = u' - k1 w           eps_2 = e - k2 w,  e = v./r + r' u/r       2 eps_12 = u./r + v' - r' v/r
    kap_1 = -(w'' - k1^2 w + 2 k1 u' + k1' u)
    kap_2 = -(w../r^2 + r' w'/r - k2^2 w + 2 k2 e + k2' u)
    2 kap_12 = -2 (w.'/r - r' w./r^2 + k2 v' + k1 (u./r - r' v/r) + k2' v)

A field u = U cos(n theta), v = V sin(n theta), w = W cos(n theta) leaves q(t) = (U, V, W). Each harmonic is minimised
by itself over the Legendre functions of `strip`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .strip import Strip

Array = NDArray[np.float64]
Curve = Callable[[Array], tuple[Array, Array]]
"""Derivatives 0..3 by t of r and of z, each (4, points), m, at t (points,)."""


@dataclass(frozen=True)
class Meridian:
    """Geometry of a shell of revolution at points of its meridian, all (points,); see the module.

    Attributes
    ----------
    radius, slope : r in m, and r' = r_t / g
    stretch, stretch_slope : g = ds/dt and dg/dt
    tangent, normal : e_s and n in the directions (e_r, e_z), (points, 2)
    first, second, first_slope, second_slope : k1, k2 in 1/m, and k1', k2' in 1/m^2
    """

    radius: Array
    slope: Array
    stretch: Array
    stretch_slope: Array
    tangent: Array
    normal: Array
    first: Array
    second: Array
    first_slope: Array
    second_slope: Array

    @classmethod
    def at(cls, curve: Curve, t: Array) -> Meridian:
        """Take it at t (points,)."""
        (r, r_t, r_tt, r_ttt), (_, z_t, z_tt, z_ttt) = curve(t)
        g = np.hypot(r_t, z_t)
        g_t = (r_t * r_tt + z_t * z_tt) / g
        tangent, normal = np.stack([r_t, z_t], axis=-1) / g[:, None], np.stack([-z_t, r_t], axis=-1) / g[:, None]
        k1, k2 = (r_t * z_tt - r_tt * z_t) / g**3, z_t / (r * g)
        k1_t = (r_t * z_ttt - r_ttt * z_t) / g**3 - 3 * k1 * g_t / g
        return cls(r, r_t / g, g, g_t, tangent, normal, k1, k2, k1_t / g, r_t / (g * r) * (k1 - k2))

    def strains_of_harmonic(self, n: int) -> Array:
        """S (3, points, 6, 3): strains are S[0] q + S[1] q_t + S[2] q_tt of q = (U, V, W).

        Rows are eps_1, eps_2, 2 eps_12, kap_1, kap_2, 2 kap_12; the shears carry sin(n theta), the others cos(n theta).
        """
        r, dr, k1, k2, dk1, dk2 = self.radius, self.slope, self.first, self.second, self.first_slope, self.second_slope
        s = np.zeros((3, len(r), 6, 3))  # by derivatives along s at first
        s[1, :, 0, 0], s[0, :, 0, 2] = 1.0, -k1
        s[0, :, 1, 0], s[0, :, 1, 1], s[0, :, 1, 2] = dr / r, n / r, -k2
        s[0, :, 2, 0], s[1, :, 2, 1], s[0, :, 2, 1] = -n / r, 1.0, -dr / r
        s[2, :, 3, 2], s[0, :, 3, 2], s[1, :, 3, 0], s[0, :, 3, 0] = -1.0, k1**2, -2 * k1, -dk1
        s[0, :, 4, 2], s[1, :, 4, 2] = n**2 / r**2 + k2**2, -dr / r
        s[0, :, 4, 1], s[0, :, 4, 0] = -2 * k2 * n / r, -2 * k2 * dr / r - dk2
        s[1, :, 5, 2], s[0, :, 5, 2] = 2 * n / r, -2 * n * dr / r**2
        s[1, :, 5, 1], s[0, :, 5, 1], s[0, :, 5, 0] = -2 * k2, 2 * k1 * dr / r - 2 * dk2, 2 * k1 * n / r
        # d/ds = (d/dt) / g and d2/ds2 = (d2/dt2) / g^2 - (g_t / g^3) d/dt
        g = self.stretch[:, None, None]
        s[1] = s[1] / g - s[2] * self.stretch_slope[:, None, None] / g**3
        s[2] /= g**2
        return s


@dataclass(frozen=True)
class Revolution:
    """A shell of revolution: meridian over [start, end], material, and the degree of its trial functions.

    Attributes
    ----------
    curve : see `Curve`
    start, end : bounds of t
    young, poisson, thickness : Pa, 1, m
    degree : of the Legendre functions; the quadrature has half as many points again
    """

    curve: Curve
    start: float
    end: float
    young: float
    poisson: float
    thickness: float
    degree: int

    @cached_property
    def strip(self) -> Strip:
        """The trial functions."""
        return Strip(self.start, self.end, self.degree)

    @cached_property
    def _rule(self) -> tuple[Array, Array, Array, Meridian]:
        """Points t, weights g r dt, trial functions (derivative, point, component, coefficient) and the geometry."""
        x, weights = np.polynomial.legendre.leggauss(3 * self.degree // 2 + 8)
        t = (self.start + self.end) / 2 + self.strip.half_length * x
        at = Meridian.at(self.curve, t)
        return t, weights * self.strip.half_length * at.stretch * at.radius, self.strip.basis(t), at

    @property
    def rounding(self) -> float:
        """Relative rounding error to expect where a shell bends without stretching: epsilon D R^2 / B, R = 1 / k2."""
        return float(np.finfo(float).eps * 12 / (self.thickness * self._rule[3].second.max()) ** 2)

    def stiffnesses(self, n: int) -> tuple[Array, Array]:
        """Membrane and bending stiffness of a harmonic n > 0, integrated around, each (coefficients, coefficients)."""
        _, weights, basis, at = self._rule
        strain = sum(np.einsum("pic,pcj->pij", s, b) for s, b in zip(at.strains_of_harmonic(n), basis, strict=True))
        nu = self.poisson
        plane = self.young * self.thickness / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
        found = []
        for rows, factor in ((slice(0, 3), 1.0), (slice(3, 6), self.thickness**2 / 12)):
            part = strain[:, rows]
            stress = np.pi * factor * weights[:, None, None] * np.einsum("ij,pjk->pik", plane, part)
            found.append(part.reshape(-1, part.shape[-1]).T @ stress.reshape(-1, part.shape[-1]))
        return found[0], found[1]

    def outward_load(self, pressure: float) -> Array:
        """Work of a pressure along -n, times cos(m theta), on each coefficient of the harmonic m, any m > 0."""
        _, weights, basis, _ = self._rule
        return np.asarray(-np.pi * pressure * weights @ basis[0, :, 2])

    def amplitudes(self, q: Array, t: Array) -> Array:
        """Amplitudes of (u_r, u_theta, u_z), (points, 3), m."""
        at = Meridian.at(self.curve, t)
        u, v, w = np.einsum("pcj,j->cp", self.strip.basis(t)[0], q)
        along = u[:, None] * at.tangent + w[:, None] * at.normal
        return np.stack([along[:, 0], v, along[:, 1]], axis=-1)

    def displacement(self, n: int, q: Array, theta: float, t: float) -> Array:
        """Cartesian displacement (3,) of a harmonic at a point, m."""
        u_r, u_t, u_z = self.amplitudes(q, np.array([t]))[0] * (np.cos(n * theta), np.sin(n * theta), np.cos(n * theta))
        c, s = np.cos(theta), np.sin(theta)
        return np.array([c * u_r - s * u_t, s * u_r + c * u_t, u_z])
