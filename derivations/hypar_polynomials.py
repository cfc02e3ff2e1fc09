r"""The clamped hyperbolic paraboloid once more: covariant derivatives, and polynomials of high degree on one patch.

The surface is the graph of f = x^2 - y^2, with A = 1 + f_x^2 + f_y^2: g_ab = delta_ab + f_a f_b, Gamma^m_ab = f_m f_ab / A and
b_ab = f_ab / sqrt(A). The displacement is u_a g^ab x,b + w a3, and its linear strains are those of tensor calculus (Koiter
1966), with b_a^l = g^lm b_ma:

    eps_ab = u_a|b symmetrised - b_ab w
    kap_ab = -(w|ab - b_a^l b_lb w + b_a^l u_l|b + b_b^l u_l|a + b_a^l|b u_l)

By Codazzi's equations b_ab|c is symmetric, so that b_a^l|b = g^lm (b_ma,b - Gamma^n_mb b_na - Gamma^n_ab b_mn). The trial
functions are products of those of `strip`, one degree along each coordinate, on x in [-1/2, 1/2] and, by symmetry, y in
[0, 1/2]. Polynomials of degree p see details of size p^-2 at edges, where the layers and singular corners are. They leave
an error that decays algebraically with the degree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .strip import Strip
from .surface_strains import Array

ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
PAIRS = ((0, 0), (1, 1), (0, 1))
ALONG_X = ("U(left)", "V(left)", "W(left)", "W'(left)")
ALONG_Y = ("V(left)", "W'(left)")


def strain_operators(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Matrix of strains (points, 6, 3 components, 6 derivatives), H with area (points, 3, 3) at x, y (points,).

    Components are (u_1, u_2, w), derivatives those of orders 00, 10, 01, 20, 02, 11; strains are eps_11, eps_22,
    2 eps_12, kap_11, kap_22, 2 kap_12. The third is the root of the metric's determinant, (points,).
    """
    slope = np.stack([2 * x, -2 * y], axis=-1)
    hessian = np.diag([2.0, -2.0])
    a = 1 + np.sum(slope**2, axis=-1)
    root = np.sqrt(a)
    inverse = np.eye(2) - slope[:, :, None] * slope[:, None, :] / a[:, None, None]
    gamma = np.einsum("pm,ab->pmab", slope / a[:, None], hessian)
    b = hessian / root[:, None, None]
    # b_ab,c = -f_ab (f_d f_dc) / A^(3/2)
    b_slope = -np.einsum("ab,pc->pabc", hessian, slope @ hessian) / (a * root)[:, None, None, None]
    return covariant_strains(inverse, gamma, b, b_slope), inverse, root


def covariant_strains(inverse: Array, gamma: Array, b: Array, b_slope: Array) -> Array:
    """Matrix of strains (points, 6, 3 components, 6 derivatives), as `strain_operators` has it.

    Parameters
    ----------
    inverse : metric g^ab, (points, 2, 2)
    gamma : Gamma^m_ab, (points, m, a, b)
    b, b_slope : curvature b_ab, and b_ab,c (points, a, b, c)
    """
    count = len(b)
    b_cov = b_slope - np.einsum("pnac,pnb->pabc", gamma, b) - np.einsum("pnbc,pan->pabc", gamma, b)
    mixed = np.einsum("plm,pma->pal", inverse, b)  # b_a^l
    mixed_cov = np.einsum("plm,pmab->palb", inverse, b_cov)  # b_a^l|b
    # u_c|d as rows of (component, derivative)
    covariant = np.zeros((count, 2, 2, 3, 6))
    for c in (0, 1):
        for d in (0, 1):
            covariant[:, c, d, c, 1 + d] += 1.0
            covariant[:, c, d, :2, 0] -= gamma[:, :, c, d]
    strains = np.zeros((count, 6, 3, 6))
    for row, (i, j) in enumerate(PAIRS):
        strains[:, row] = (covariant[:, i, j] + covariant[:, j, i]) * (0.5 if i == j else 1.0)
        strains[:, row, 2, 0] -= b[:, i, j] * (1.0 if i == j else 2.0)
        bent = np.einsum("pl,plcd->pcd", mixed[:, i], covariant[:, :, j])
        bent += np.einsum("pl,plcd->pcd", mixed[:, j], covariant[:, :, i])
        bent[:, :2, 0] += mixed_cov[:, i, :, j]
        bent[:, 2, 3 + row] += 1.0
        bent[:, 2, 1:3] -= gamma[:, :, i, j]
        bent[:, 2, 0] -= np.einsum("pl,pl->p", mixed[:, i], b[:, :, j])
        strains[:, 3 + row] = -bent * (1.0 if i == j else 2.0)
    return strains


@dataclass(frozen=True)
class Polynomials:
    """The shell with trial functions of a degree along x and along y.

    1. One-dimensional functions, their derivatives and Gauss rules along x and y.
    2. Column by column of Gauss points (one x, all y): strains of all products, times a root of H and of the area, are
       squared and added to the stiffnesses.
    3. For each thickness both are summed, scaled to a unit diagonal and factorised by Cholesky; the solution is
       corrected once by its residual.
    """

    degrees: tuple[int, int]
    young: float
    poisson: float

    @cached_property
    def _strips(self) -> tuple[Strip, Strip]:
        return Strip(-0.5, 0.5, self.degrees[0]), Strip(0.0, 0.5, self.degrees[1])

    def _functions(self, axis: int, at: Array) -> list[Array]:
        """Derivatives (3, points, functions) of each component's functions that supports leave, along an axis."""
        strip, size = self._strips[axis], self.degrees[axis] + 1
        held = {strip.end_coefficient(name) for name in (ALONG_X, ALONG_Y)[axis]}
        basis = strip.basis(at)
        return [basis[:, :, c, [k for k in range(c * size, (c + 1) * size) if k not in held]] for c in range(3)]

    @cached_property
    def _system(self) -> tuple[Array, Array, Array, Array]:
        """Membrane and bending stiffness for D = B = 1, work of 1 Pa downward, and where the components start."""
        rules = [np.polynomial.legendre.leggauss(d + 6) for d in self.degrees]
        xs, ys = rules[0][0] / 2, (rules[1][0] + 1) / 4
        wx, wy = rules[0][1] / 2, rules[1][1] / 4
        along, across = self._functions(0, xs), self._functions(1, ys)
        starts = np.cumsum([0] + [a.shape[2] * b.shape[2] for a, b in zip(along, across, strict=True)])
        total = int(starts[-1])
        stiffness = np.zeros((2, total, total))
        work = np.zeros(total)
        for k, x in enumerate(xs):
            strains, inverse, root = strain_operators(np.full_like(ys, x), ys)
            area = root * wx[k] * wy
            # -e_z has the covariant components -f_a, and -1 / sqrt(A) along the normal
            slope = np.stack([np.full_like(ys, 2 * x), -2 * ys], axis=-1)
            pushed = -np.concatenate([np.einsum("pab,pb->pa", inverse, slope), 1 / root[:, None]], axis=1)
            b = np.empty((len(ys), 6, total))
            for c in range(3):
                part = slice(int(starts[c]), int(starts[c + 1]))
                shapes = np.stack([along[c][i][k][None, :, None] * across[c][j][:, None] for i, j in ORDERS], axis=1)
                shapes = shapes.reshape(len(ys), 6, -1)
                b[:, :, part] = strains[:, :, c] @ shapes
                work[part] += (area * pushed[:, c]) @ shapes[:, 0]
            upper = np.swapaxes(np.linalg.cholesky(elasticity(inverse, self.poisson) * area[:, None, None]), 1, 2)
            for number in (0, 1):
                rows = (upper @ b[:, 3 * number : 3 * number + 3]).reshape(-1, total)
                stiffness[number] += rows.T @ rows
        return stiffness[0], stiffness[1], work, starts

    def solve(self, thickness: float, load: float) -> tuple[Array, float, float, float]:
        """Coefficients under a load downward per area, Pa; work / 2, membrane and bending energy of the whole shell, J."""
        stretching = self.young * thickness / (1 - self.poisson**2)
        membrane, bending, work, _ = self._system
        factors, right = (stretching, stretching * thickness**2 / 12), load * work
        matrix = factors[0] * membrane + factors[1] * bending
        scale = 1 / np.sqrt(np.diag(matrix))
        matrix *= scale[:, None] * scale
        factor = cho_factor(matrix)
        found = cho_solve(factor, scale * right)
        found += cho_solve(factor, scale * right - matrix @ found)
        q = scale * found
        energies = (float(f * (q @ k @ q)) for f, k in zip(factors, (membrane, bending), strict=True))
        return q, float(right @ q), *energies

    def displacement(self, q: Array, x: float, y: float) -> Array:
        """Cartesian displacement (3,) at a point with y >= 0, m."""
        ones, twos = self._functions(0, np.array([x])), self._functions(1, np.array([y]))
        starts = self._system[3]
        parts = [q[starts[c] : starts[c + 1]].reshape(ones[c].shape[2], -1) for c in range(3)]
        covariant = np.array([ones[c][0, 0] @ parts[c] @ twos[c][0, 0] for c in range(3)])
        slope = np.array([2 * x, -2 * y])
        a = 1 + slope @ slope
        contravariant = covariant[:2] - slope * (slope @ covariant[:2]) / a
        normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(a)
        return np.array([*contravariant, contravariant @ slope]) + covariant[2] * normal


def elasticity(inverse: Array, poisson: float) -> Array:
    """H (points, 3, 3) of (eps_11, eps_22, 2 eps_12) from the inverse metric."""
    found = np.empty((len(inverse), 3, 3))
    for i, (a, b) in enumerate(PAIRS):
        for j, (c, d) in enumerate(PAIRS):
            crossed = inverse[:, a, c] * inverse[:, b, d] + inverse[:, a, d] * inverse[:, b, c]
            found[:, i, j] = poisson * inverse[:, a, b] * inverse[:, c, d] + (1 - poisson) / 2 * crossed
    return found
