r"""Linear strains of Naghdi's shell, and its strain energy (Naghdi 1973; Chapelle & Bathe 2011, section 4.2).

The displacement u is a vector, the change d of the normal a3 another one, tangential: d = psi_1 t_1 + psi_2 t_2 with
t_1 along a_1 and t_2 = a3 x t_1. The strains

    2 eps_ab = a_a . u,b + a_b . u,a                                          of the midsurface
    2 chi_ab = a_a . d,b + a_b . d,a + a3,a . u,b + a3,b . u,a                of bending
    gamma_a  = a3 . u,a + a_a . d                                             of transverse shear

are the changes of a_a . a_b / 2, of a_a . a3,b and of a_a . a3. For gamma = 0 they are those of Kirchhoff and Love. The
energy per area is (D eps : H : eps + B chi : H : chi + k G h gamma . gamma) / 2 with k = 5/6 (Bastek & Kochmann 2023).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case

Array = NDArray[np.float64]

SHEAR_FACTOR = 5.0 / 6.0
VOIGT = ((0, 0), (1, 1), (0, 1))
FIELDS = 5  # u_x, u_y, u_z, psi_1, psi_2
STRAINS = 8  # eps_11, eps_22, 2 eps_12, chi likewise, gamma_1, gamma_2


@dataclass(frozen=True)
class Frame:
    """The midsurface and its frame at points.

    Attributes
    ----------
    base, normal
        a_a (N, 2, 3) and a3 (N, 3).
    normal_slopes
        a3,a (N, 2, 3).
    tangents, tangent_slopes
        t_i (N, 2, 3), and their derivatives along b (N, 2 of i, 2 of b, 3).
    metric
        Contravariant, (N, 2, 2).
    area
        |a_1 x a_2| (N,), m^2 per unit of the coordinates.
    """

    base: Array
    normal: Array
    normal_slopes: Array
    tangents: Array
    tangent_slopes: Array
    metric: Array
    area: Array

    @classmethod
    def at(cls, case: Case, xi: Array) -> Frame:
        """Return the frame at points (N, 2)."""
        x = case.surface.derivatives(xi, order=2)
        base = np.stack([x[1, 0], x[0, 1]], axis=1)
        bent = np.stack([np.stack([x[2, 0], x[1, 1]], axis=1), np.stack([x[1, 1], x[0, 2]], axis=1)], axis=1)
        cross = np.cross(base[:, 0], base[:, 1])
        area = np.linalg.norm(cross, axis=-1)
        normal = cross / area[:, None]
        metric = np.linalg.inv(np.einsum("nac,nbc->nab", base, base))
        # Weingarten: a3,b = -b_b^a a_a.
        curvature = np.einsum("nabc,nc->nab", bent, normal)
        normal_slopes = -np.einsum("nba,nae,nec->nbc", curvature, metric, base)
        length = np.linalg.norm(base[:, 0], axis=-1)[:, None]
        first = base[:, 0] / length
        second = np.cross(normal, first)
        # t_1,b is the part of a_1,b / |a_1| across t_1; t_2 follows by the product rule.
        turned = bent[:, 0] / length[:, None]
        first_slopes = turned - np.einsum("nbc,nc->nb", turned, first)[..., None] * first[:, None]
        second_slopes = np.cross(normal_slopes, first[:, None]) + np.cross(normal[:, None], first_slopes)
        tangents = np.stack([first, second], axis=1)
        slopes = np.stack([first_slopes, second_slopes], axis=1)
        return cls(base, normal, normal_slopes, tangents, slopes, metric, area)

    def operator(self) -> Array:
        """Return E (N, 8, 15) of strain = E z with z = (q, q,1, q,2) and the five fields q."""
        n = len(self.area)
        u, d = np.zeros((2, n, 2, 3, 3 * FIELDS))  # u,b and d,b by z
        for b in range(2):
            u[:, b, np.arange(3), (b + 1) * FIELDS + np.arange(3)] = 1.0
            for i in range(2):
                d[:, b, :, 3 + i] = self.tangent_slopes[:, i, b]
                d[:, b, :, (b + 1) * FIELDS + 3 + i] = self.tangents[:, i]
        change = np.zeros((n, 3, 3 * FIELDS))
        change[:, :, 3:FIELDS] = np.swapaxes(self.tangents, 1, 2)
        stretch = np.einsum("nac,nbcz->nabz", self.base, u)
        bend = np.einsum("nac,nbcz->nabz", self.base, d) + np.einsum("nac,nbcz->nabz", self.normal_slopes, u)
        shear = np.einsum("nc,nacz->naz", self.normal, u) + np.einsum("nac,ncz->naz", self.base, change)
        rows = [of[:, a, b] if a == b else of[:, a, b] + of[:, b, a] for of in (stretch, bend) for a, b in VOIGT]
        return np.stack([*rows, shear[:, 0], shear[:, 1]], axis=1)

    def stiffness(self, case: Case) -> tuple[Array, Array, Array]:
        """Return the stiffness (N, 8, 8) of membrane, bending and shear, N/m and N m, by covariant strains."""
        m, g = case.isotropic, self.metric
        nu = m.poissons_ratio
        plane = np.zeros((len(g), 3, 3))
        for i, (a, b) in enumerate(VOIGT):
            for j, (c, d) in enumerate(VOIGT):
                mixed = g[:, a, c] * g[:, b, d] + g[:, a, d] * g[:, b, c]
                plane[:, i, j] = nu * g[:, a, b] * g[:, c, d] + (1 - nu) / 2 * mixed
        membrane, bending, shear = np.zeros((3, len(g), STRAINS, STRAINS))
        membrane[:, :3, :3] = m.membrane_stiffness * plane
        bending[:, 3:6, 3:6] = m.bending_stiffness * plane
        modulus = m.youngs_modulus / (2 * (1 + nu))
        shear[:, 6:, 6:] = SHEAR_FACTOR * modulus * m.thickness * g
        return membrane, bending, shear


def load_density(case: Case, frame: Frame, xi: Array) -> Array:
    """Return the load (N, 3) per reference area at points (N, 2), N/m^2."""
    total = np.zeros((len(xi), 3))
    for load in case.loads:
        match load.kind:
            case "area":
                total += case.evaluate(load.vector, xi)[0, 0]
            case "gravity":
                total += case.material.areal_density * case.evaluate(load.acceleration, xi)[0, 0]
            case "pressure":
                total += case.formula(load.value).derivatives(xi, 0)[0, 0][:, None] * frame.normal
    return total
