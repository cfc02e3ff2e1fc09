r"""Linear Kirchhoff-Love shells of revolution once more: vectors in the turning frame, B-splines along the meridian.

No covariant derivative and no curvature of the surface is formed. The displacement is U cos(n theta) e_r +
V sin(n theta) e_theta + W cos(n theta) e_z. With x,1 = x_t and x,2 = x_theta, the strains are products of vectors
(Kairanda et al. 2023, eq. (30), linear):

    eps_ab = (x,a . u,b + x,b . u,a) / 2,    kap_ab = -(u,ab - Gamma^m_ab u,m) . a3,

Gamma^m_ab the solution of x,ab = Gamma^m_ab x,m + b_ab a3. Everything is a component of (e_r, e_theta, e_z). A
derivative by theta turns that frame: d(f)/dtheta = f. + e_z x f. The parts of a vector with cos(n theta) and with
sin(n theta) are kept apart as two sets of three components.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, null_space

from .revolution import Curve
from .spline_shell import Splines
from .surface_strains import Array

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
"""Matrix of e_z x f in the frame (e_r, e_theta, e_z)."""
PAIRS = ((0, 0), (1, 1), (0, 1))


def turned(parts: Array, n: int) -> Array:
    """Derivative by theta of vectors (2, 3, ...): their parts with cos(n theta) and with sin(n theta)."""
    cosine, sine = parts
    return np.stack([n * sine + np.tensordot(TURN, cosine, 1), -n * cosine + np.tensordot(TURN, sine, 1)])


@dataclass(frozen=True)
class SplineRevolution:
    """A shell of revolution and the splines of the meridian; `curve` as of `revolution.Revolution`.

    Attributes
    ----------
    curve, splines : the meridian and the functions of t
    young, poisson, thickness : Pa, 1, m
    """

    curve: Curve
    splines: Splines
    young: float
    poisson: float
    thickness: float

    def _vectors(self, t: Array) -> tuple[Array, Array, Array]:
        """x,a (2, points, 3), x,ab (3, points, 3) for ab = 11, 22, 12, and a3 (points, 3)."""
        (r, r_t, r_tt, _), (_, z_t, z_tt, _) = self.curve(t)
        o = np.zeros_like(t)
        first = np.stack([np.stack([r_t, o, z_t], -1), np.stack([o, r, o], -1)])
        second = np.stack([np.stack([r_tt, o, z_tt], -1), np.stack([-r, o, o], -1), np.stack([o, r_t, o], -1)])
        normal = np.cross(*first)
        return first, second, normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        points, weights = self.splines.gauss
        return points.ravel(), weights.ravel()

    def stiffnesses(self, n: int) -> tuple[Array, Array]:
        """Membrane and bending stiffness of a harmonic n > 0, coefficients numbered by component, then function."""
        t, weights = self._rule
        x, xx, a3 = self._vectors(t)
        metric = np.einsum("apc,bpc->pab", x, x)
        inverse = np.linalg.inv(metric)
        christoffel = np.einsum("kpc,mpc,pml->kpl", xx, x, inverse)
        values = [self.splines.matrix(t, order) for order in range(3)]
        # u, u,1 and u,11 as (2 parts, 3 components, points, coefficients)
        fields = []
        for value in values:
            parts = np.zeros((2, 3, len(t), 3, value.shape[1]))
            for component, part in enumerate((0, 1, 0)):
                parts[part, component, :, component] = value
            fields.append(parts.reshape(2, 3, len(t), -1))
        u, u_1, u_11 = fields
        u_2 = turned(u, n)
        gradient, second = (u_1, u_2), (u_11, turned(u_2, n), turned(u_1, n))
        membrane, bending = [], []
        for k, (a, b) in enumerate(PAIRS):
            stretch = [np.einsum("pc,scpj->spj", x[i], gradient[j]) for i, j in ((a, b), (b, a))]
            membrane.append((stretch[0] + stretch[1]) * (0.5 if a == b else 1.0))
            free = second[k] - sum(christoffel[k, :, m, None] * gradient[m] for m in (0, 1))
            bending.append(np.einsum("pc,scpj->spj", -a3, free) * (1.0 if a == b else 2.0))
        elastic = np.empty((len(t), 3, 3))
        nu = self.poisson
        for i, (a, b) in enumerate(PAIRS):
            for j, (c, d) in enumerate(PAIRS):
                crossed = inverse[:, a, c] * inverse[:, b, d] + inverse[:, a, d] * inverse[:, b, c]
                elastic[:, i, j] = nu * inverse[:, a, b] * inverse[:, c, d] + (1 - nu) / 2 * crossed
        stretching = self.young * self.thickness / (1 - nu**2)
        area = np.pi * weights * np.sqrt(np.linalg.det(metric))
        found = []
        for rows, factor in ((membrane, stretching), (bending, stretching * self.thickness**2 / 12)):
            strain = np.stack(rows, axis=2)  # (2 parts, points, 3, coefficients)
            stress = factor * area[:, None, None] * np.einsum("pij,spjk->spik", elastic, strain)
            size = strain.shape[-1]
            found.append(strain.reshape(-1, size).T @ stress.reshape(-1, size))
        return found[0], found[1]

    def outward_load(self, pressure: float) -> Array:
        """Work of the pressure times cos(n theta) along the normal that points away from the axis, n > 0."""
        t, weights = self._rule
        x, _, a3 = self._vectors(t)
        outward = a3 * np.sign(a3[:, :1])
        area = np.linalg.norm(np.cross(*x), axis=-1)
        return np.asarray(
            np.pi * pressure * np.einsum("p,pc,pj->cj", weights * area, outward, self.splines.matrix(t, 0))
        ).ravel()

    def row(self, component: int, t: float, order: int = 0) -> Array:
        """Row of a component's amplitude, or of its derivative by t."""
        row = np.zeros((3, self.splines.count))
        row[component] = self.splines.matrix(np.array([t]), order)[0]
        return row.ravel()

    def slope_row(self, t: float) -> Array:
        """Row of the slope u,1 . a3."""
        _, _, a3 = self._vectors(np.array([t]))
        return sum(a3[0, c] * self.row(c, t, 1) for c in range(3))

    def displacement(self, n: int, q: Array, theta: float, t: float) -> Array:
        """Cartesian displacement (3,) at a point, m."""
        u_r, u_t, u_z = (self.row(c, t) @ q for c in range(3))
        c, s = np.cos(theta), np.sin(theta)
        u_r, u_t, u_z = u_r * np.cos(n * theta), u_t * np.sin(n * theta), u_z * np.cos(n * theta)
        return np.array([c * u_r - s * u_t, s * u_r + c * u_t, u_z])


def minimiser(stiffness: Array, load: Array, held: Sequence[Array]) -> Array:
    """Coefficients of least potential energy among those that the held rows leave at zero."""
    allowed = null_space(np.array(held))
    matrix = allowed.T @ stiffness @ allowed
    scale = 1 / np.sqrt(np.diag(matrix))
    matrix = scale[:, None] * matrix * scale
    factor, right = cho_factor(matrix), scale * (allowed.T @ load)
    found = cho_solve(factor, right)
    found += cho_solve(factor, right - matrix @ found)
    return np.asarray(allowed @ (scale * found))
