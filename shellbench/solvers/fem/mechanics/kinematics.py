"""Membrane and bending strains from the deformed midsurface's metric and curvature: linear, and exact.

The deformed surface is x + u. Linear strains consist of first variations: those of its metric a_ab and curvature b_ab =
a_a,b . a3 are

    delta a_ab = u,a . a_b + a_a . u,b
    delta b_ab = u,ab . a3 + x,ab . delta a3,    delta a3 = (m - (m . a3) a3) / J,
    m = u,1 x a2 + a1 x u,2,    J = |a1 x a2|

so that eps_ab = delta a_ab / 2 and kappa_ab = -delta b_ab (Kairanda et al. 2023, eqs. (15), (16), linearised). No large
numbers are subtracted from each other: the triple product is rearranged, x,ab . (m - (m . a3) a3) = p_ab . m with p_ab
the tangential part of x,ab, so that p . m = u,1 . (a2 x p) + u,2 . (p x a1).

Exact strains have two variations. With a_a = x,a + u,a the deformed base vectors, g = a1 x a2 = j n and n the deformed
unit normal,

    eps_ab = (a_a . a_b - abar_ab) / 2,    kappa_ab = bbar_ab - (x,ab + u,ab) . n     (eqs. (15), (16)).

Both are evaluated without subtracting large numbers, from u's derivatives: with g = J N + m, J N the reference value,

    m = u,1 x x,2 + x,1 x u,2 + u,1 x u,2,    j - J = (2 J N + m) . m / (j + J),    n - N = (m - (j - J) N) / j,
    eps_ab = (x,a . u,b + x,b . u,a + u,a . u,b) / 2,    kappa_ab = -u,ab . n - x,ab . (n - N).

The first variation is that of the linear theory, taken at the deformed surface (`strain_operator`). The second one
follows from dn = P dg / j with P = 1 - n n^T:

    d2n = P d2g / j - [ P dg (n . dg) + (n . dg) P dg + n (dg . P dg) ] / j^2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.orthotropic import AnyMaterial, OrthotropicMaterial
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.question.surface import Surface
from shellbench.solvers.fem.mechanics.orthotropic import orthotropic_elasticity
from shellbench.solvers.fem.mesh.basis import Derivative

Array = NDArray[np.float64]

DERIVATIVES: tuple[Derivative, ...] = ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1))  # of u, that strains depend on
STRAINS: tuple[tuple[int, int], ...] = ((0, 0), (1, 1), (0, 1))  # covariant components 11, 22, 12
SECOND: tuple[Derivative, ...] = ((2, 0), (0, 2), (1, 1))  # the second derivative that goes with each of STRAINS


def empty_points_fastest(count: int, *shape: int) -> Array:
    """Return an array (count, *shape) of numbers to be filled in, the points running fastest in memory."""
    # Most work at points is done component by component. If components run fastest, NumPy's loops are short and take
    # several times as long.
    return np.empty((*shape, count)).transpose(len(shape), *range(len(shape)))


def points_fastest(array: Array) -> Array:
    """Return the same array, the points of its first axis running fastest in memory."""
    last = array.ndim - 1  # `transpose` takes a tenth of the time of `moveaxis`, which matters with few points
    return np.ascontiguousarray(array.transpose(*range(1, last + 1), 0)).transpose(last, *range(last))


def cross(first: Array, second: Array) -> Array:
    """Return the vector products (n, ..., 3); NumPy's own takes four times as long over its axes."""
    product = empty_points_fastest(*np.broadcast_shapes(first.shape, second.shape))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        np.multiply(first[..., i], second[..., j], out=product[..., k])
        product[..., k] -= first[..., j] * second[..., i]
    return product


def dot(first: Array, second: Array) -> Array:
    """Return the scalar products of vectors (..., 3)."""
    product = first[..., 0] * second[..., 0]
    for k in (1, 2):
        product += first[..., k] * second[..., k]
    return np.asarray(product)


@dataclass(frozen=True)
class Midsurface:
    """Geometry of the reference midsurface at n points.

    Attributes
    ----------
    base
        (n, 2, 3) covariant base vectors a1, a2.
    normal
        (n, 3) unit normal a3 along a1 x a2.
    second
        (n, 3, 3) x,11, x,22, x,12.
    area
        (n,) |a1 x a2|, the area of the surface per area of the parametric rectangle.
    """

    base: Array
    normal: Array
    second: Array
    area: Array

    @classmethod
    def from_position(cls, x: Mapping[Derivative, Array]) -> Midsurface:
        """Compute it from the derivatives (n, 3) of the position up to order 2."""
        base = np.stack([x[1, 0], x[0, 1]], axis=-2)
        product = cross(x[1, 0], x[0, 1])
        area = np.sqrt(dot(product, product))
        return cls(base, product / area[..., None], np.stack([x[key] for key in SECOND], axis=-2), area)

    def with_points_fastest(self) -> Midsurface:
        """Return the same geometry in arrays in which the points run fastest."""
        return Midsurface(*map(points_fastest, (self.base, self.normal, self.second, self.area)))

    @property
    def contravariant_metric(self) -> Array:
        """a^ab (n, 2, 2)."""
        # a^-1 by its adjoint; |a1 x a2|^2 is the determinant, without the cancellation of a_11 a_22 - a_12^2
        a1, a2 = self.base[:, 0], self.base[:, 1]
        inverse = np.empty((len(a1), 2, 2))
        inverse[:, 0, 0], inverse[:, 1, 1] = np.einsum("nc,nc->n", a2, a2), np.einsum("nc,nc->n", a1, a1)
        inverse[:, 0, 1] = inverse[:, 1, 0] = -np.einsum("nc,nc->n", a1, a2)
        determinant = self.area**2
        if not determinant.all():
            raise np.linalg.LinAlgError("the metric is singular")
        inverse /= determinant[:, None, None]
        return inverse


def local_axes(x: Mapping[Derivative, Array], edge: Edge | None) -> tuple[Array, Array]:
    """Return unit vectors (n, 3, 3) along an edge, across it and normal, and their derivatives along the edge.

    Without an edge along xi1. `x` are derivatives (n, 3) of the position up to order 2.
    """
    running: Derivative = (0, 1) if edge is not None and edge.axis == 0 else (1, 0)
    twice = (2 * running[0], 2 * running[1])
    first, second = (x[1, 1], x[0, 2]) if running == (0, 1) else (x[2, 0], x[1, 1])  # of a1 and a2 along the edge
    along, along_t = _unit(x[running], x[twice])
    normal, normal_t = _unit(np.cross(x[1, 0], x[0, 1]), np.cross(first, x[0, 1]) + np.cross(x[1, 0], second))
    across, across_t = np.cross(normal, along), np.cross(normal_t, along) + np.cross(normal, along_t)
    if edge is not None and (edge.axis == 0) == (edge.side == "max"):
        across, across_t = -across, -across_t
    return np.stack([along, across, normal], axis=1), np.stack([along_t, across_t, normal_t], axis=1)


def _unit(vector: Array, rate: Array) -> tuple[Array, Array]:
    """Return vectors (n, 3) over their lengths, and the derivative of that."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    unit = vector / length
    return unit, (rate - np.sum(unit * rate, axis=-1, keepdims=True) * unit) / length


def strain_operator(surface: Midsurface) -> Array:
    """Return the linear map from the derivatives of u to the strains.

    Parameters
    ----------
    surface
        Geometry at n points.

    Returns
    -------
    Array
        (n, 6, 3, 5): membrane strains eps_11, eps_22, eps_12, then bending strains kappa_11, kappa_22, kappa_12,
        by Cartesian component of u and by derivative in the order of `DERIVATIVES`.
    """
    a1, a2 = surface.base[:, :1], surface.base[:, 1:]
    operator = np.zeros((len(surface.area), 6, len(DERIVATIVES), 3))  # as `Deformation.operator` takes it, uncopied
    for row, (a, b) in enumerate(STRAINS):
        operator[:, row, a] += surface.base[:, b] / 2
        operator[:, row, b] += surface.base[:, a] / 2
    curvature = np.einsum("nkc,nc->nk", surface.second, surface.normal)[..., None]
    tangential = (surface.second - curvature * surface.normal[:, None]) / surface.area[:, None, None]
    operator[:, 3:, 0] = cross(tangential, a2)
    operator[:, 3:, 1] = cross(a1, tangential)
    for row, key in enumerate(SECOND):
        operator[:, 3 + row, DERIVATIVES.index(key)] = -surface.normal
    return np.swapaxes(operator, 2, 3)


def linear_strains(surface: Midsurface, gradients: Array) -> Array:
    """Return the linear strains (n, 6): `strain_operator` times gradients, without computing the operator.

    These are the derivatives (n, 5, 3) of the displacement in the order of `DERIVATIVES`.
    """
    x, normal, u = surface.base, surface.normal, points_fastest(gradients)
    turned = cross(u[:, 0], x[:, 1]) + cross(x[:, 0], u[:, 1])
    turned -= dot(turned, normal)[:, None] * normal
    turned /= surface.area[:, None]
    strains = empty_points_fastest(len(u), 6)
    for row, (i, j) in enumerate(STRAINS):
        strains[:, row] = (dot(x[:, i], u[:, j]) + dot(x[:, j], u[:, i])) / 2
        strains[:, 3 + row] = -dot(u[:, 2 + row], normal) - dot(surface.second[:, row], turned)
    return strains


def elasticity(surface: Midsurface, poissons_ratio: float) -> Array:
    """Return H^{abcd} (n, 3, 3) on the components 11, 22, 12 (Kairanda et al. 2023, eq. (19)).

    The component 12 stands for itself and for 21, so that strain @ H @ strain is the full double contraction.
    """
    metric = surface.contravariant_metric
    nu = poissons_ratio
    h = np.empty((len(surface.area), 3, 3), dtype=np.result_type(float, type(nu)))  # complex for a complex step
    for row, (a, b) in enumerate(STRAINS):
        for column, (c, d) in enumerate(STRAINS[: row + 1]):
            times = (1 if a == b else 2) * (1 if c == d else 2)
            exchanged = metric[:, a, c] * metric[:, b, d] + metric[:, a, d] * metric[:, b, c]
            h[:, row, column] = times * (nu * metric[:, a, b] * metric[:, c, d] + (1 - nu) / 2 * exchanged)
            h[:, column, row] = h[:, row, column]
    return h


def stiffness_moduli(surface: Surface, material: AnyMaterial, points: Array) -> Array:
    """Return D and B (n, 2) at points (n, 2), N/m and N m; they are proportional to E h and E h^3."""
    modulus, thickness = material.factors(points, surface.named_constants)
    membrane, bending = material.membrane_stiffness, material.bending_stiffness
    return np.stack([membrane * modulus * thickness, bending * modulus * thickness**3], axis=-1)


def elasticities(surface: Midsurface, material: AnyMaterial) -> Array:
    """Return H (n, 2, 3, 3) of stretching and of bending."""
    if isinstance(material, OrthotropicMaterial):
        return orthotropic_elasticity(surface.base, surface.normal, surface.contravariant_metric, material)
    known = {nu: elasticity(surface, nu) for nu in set(material.poissons_ratios)}
    return np.stack([known[nu] for nu in material.poissons_ratios], axis=1)


def stress_root_operator(surface: Midsurface, material: AnyMaterial, moduli: Array) -> Array:
    """Return the operator (n, 6, 3, 5) whose squared length is twice the strain energy density; `moduli` (n, 2): D, B.

    It is `strain_operator` times the square roots of the membrane and bending stiffness: with it a stiffness matrix
    is a product of a matrix with its own transpose, symmetric and positive semidefinite by construction.
    """
    operator = np.swapaxes(strain_operator(surface), -1, -2)  # as it lies in memory, uncopied
    root = np.swapaxes(np.linalg.cholesky(elasticities(surface, material)), -1, -2)
    rooted = (root * np.sqrt(moduli)[:, :, None, None]) @ operator.reshape(len(operator), 2, 3, -1)
    return np.swapaxes(rooted.reshape(operator.shape), -1, -2)


GRADIENT = 3 * len(DERIVATIVES)  # derivatives of u at a point, by derivative (slow) and component
FIRST = slice(0, 6)  # those of first order among them


def cross_matrix(vectors: Array) -> Array:
    """Return the matrices [v]x (n, 3, 3) with [v]x w = v x w, of vectors (n, 3)."""
    matrix = np.zeros((len(vectors), 3, 3))
    matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    return matrix - np.swapaxes(matrix, 1, 2)


@dataclass(frozen=True)
class Deformation:
    """A deformed midsurface at n points.

    Attributes
    ----------
    reference, current
        Geometry before and after.
    gradients
        (n, 5, 3) derivatives of the displacement in the order of `kinematics.DERIVATIVES`.
    rise
        (n, 3) n - N, the change of the unit normal.
    """

    reference: Midsurface
    current: Midsurface
    gradients: Array
    rise: Array

    @classmethod
    def from_gradients(cls, reference: Midsurface, gradients: Array) -> Deformation:
        """Deform a midsurface by a displacement with these derivatives (n, 5, 3)."""
        u = points_fastest(gradients)
        u1, u2 = u[:, 0], u[:, 1]
        x1, x2 = reference.base[:, 0], reference.base[:, 1]
        before, normal = reference.area, reference.normal
        m = cross(u1, x2 + u2) + cross(x1, u2)
        product = before[:, None] * normal
        growth = product + m
        area = np.sqrt(dot(growth, growth))
        product += growth
        larger = dot(product, m) / (area + before)
        current = Midsurface(
            base=reference.base + u[:, :2],
            normal=growth / area[:, None],
            second=reference.second + u[:, 2:],
            area=area,
        )
        return cls(reference, current, gradients, (m - larger[:, None] * normal) / area[:, None])

    @property
    def strains(self) -> Array:
        """(n, 6) eps_11, eps_22, eps_12, kappa_11, kappa_22, kappa_12."""
        x, a, second = self.reference.base, self.current.base, self.reference.second
        u = points_fastest(self.gradients)
        strains = empty_points_fastest(len(u), 6)
        for row, (i, j) in enumerate(STRAINS):
            strains[:, row] = (dot(a[:, i], u[:, j]) + dot(x[:, j], u[:, i])) / 2
        strains[:, 3:] = -dot(u[:, 2:], self.current.normal[:, None]) - dot(second, self.rise[:, None])
        return strains

    @cached_property
    def operator(self) -> Array:
        """(n, 6, 15) first variation of the strains, by derivative (slow) and component of u."""
        operator = np.swapaxes(strain_operator(self.current), -1, -2)
        return operator.reshape(len(operator), 6, GRADIENT)

    def first_variation(self, resultants: Array) -> Array:
        """Return the sum (n, 15) of resultants (n, 6) times the first variations of the strains.

        This is their product with `operator`, computed without the operator.
        """
        base, normal, second = self.current.base, self.current.normal, self.current.second
        n11, n22, n12 = (component[:, None] for component in resultants.T[:3])
        moments = resultants[:, 3:]
        form = empty_points_fastest(len(normal), len(DERIVATIVES), 3)
        np.multiply(moments[:, :, None], -normal[:, None], out=form[:, 2:])
        pulled = dot(second.transpose(0, 2, 1), moments[:, None])
        pulled -= dot(pulled, normal)[:, None] * normal
        pulled /= self.current.area[:, None]
        half = n12 / 2
        np.add(n11 * base[:, 0], half * base[:, 1], out=form[:, 0])
        np.add(n22 * base[:, 1], half * base[:, 0], out=form[:, 1])
        form[:, 0] += cross(pulled, base[:, 1])
        form[:, 1] += cross(base[:, 0], pulled)
        return form.reshape(-1, GRADIENT)

    @cached_property
    def _base_variation(self) -> Array:
        """(n, 3, 6) dg as a linear map of du,1 and du,2."""
        a1, a2 = self.current.base[:, 0], self.current.base[:, 1]
        return np.concatenate([-cross_matrix(a2), cross_matrix(a1)], axis=-1)

    @cached_property
    def normal_change(self) -> Array:
        """(n, 3, 6) dn as a linear map of du,1 and du,2."""
        n, spread = self.current.normal, self._base_variation
        tangential = spread - n[:, :, None] * (n[:, None] @ spread)
        return np.asarray(tangential / self.current.area[:, None, None])

    def second_normal_change(self, vectors: Array) -> Array:
        """Return vectors . d2n (n, 6, 6) as symmetric forms of du,1 and du,2, for vectors (n, 3)."""
        # With s = n . dg / j and p = v . dn one product gives -(v . n) dn . dn - p s - s p. The part of d2g, of
        # du,1 x du,2, is added to it.
        n, area = self.current.normal, self.current.area
        along = np.einsum("nc,nc->n", vectors, n)[:, None]
        tangential = vectors - along * n
        rates = np.empty((len(n), 5, 6))
        rates[:, :3] = self.normal_change
        rates[:, 3:4] = (n / area[:, None])[:, None] @ self._base_variation
        rates[:, 4:] = tangential[:, None] @ self.normal_change
        others = np.empty_like(rates)
        others[:, :3] = -along[:, :, None] * self.normal_change
        others[:, 3], others[:, 4] = -rates[:, 4], -rates[:, 3]
        form = np.swapaxes(rates, 1, 2) @ others
        across = cross_matrix(tangential / area[:, None])
        form[:, :3, 3:] -= across
        form[:, 3:, :3] += across
        return np.asarray(form)

    def second_variation(self, resultants: Array) -> Array:
        """Return the sum of resultants times the second variations of the strains.

        Parameters
        ----------
        resultants
            (n, 6) stresses conjugate to the strains, N/m and N in physical components.

        Returns
        -------
        Array
            (n, 15, 15) symmetric.
        """
        membrane, bending = resultants[:, :3], resultants[:, 3:]
        form = np.zeros((len(resultants), GRADIENT, GRADIENT))
        pulled = np.einsum("nk,nkc->nc", bending, self.current.second)
        form[:, FIRST, FIRST] = -self.second_normal_change(pulled)
        tensor = np.empty((len(form), 2, 2))
        tensor[:, 0, 0], tensor[:, 1, 1] = membrane[:, 0], membrane[:, 1]
        tensor[:, 0, 1] = tensor[:, 1, 0] = membrane[:, 2] / 2
        for c in range(3):  # components of u do not mix
            form[:, c : FIRST.stop : 3, c : FIRST.stop : 3] += tensor
        coupling = (bending[:, :, None, None] * self.normal_change[:, None]).reshape(len(form), -1, FIRST.stop)
        form[:, FIRST.stop :, FIRST] = -coupling
        form[:, FIRST, FIRST.stop :] = -np.swapaxes(coupling, 1, 2)
        return form


def outward_conormal(surface: Midsurface, edge: Edge) -> Array:
    """Return the unit vectors (n, 3) tangential to the surface, normal to an edge and away from the surface."""
    # a_t x a3 is normal to the edge in the surface. Its sign is settled by the base vector across the edge. That points
    # inward on the side "min", outward on the side "max".
    tangent = surface.base[:, 1 - edge.axis]
    conormal = np.cross(tangent, surface.normal)
    conormal /= np.linalg.norm(conormal, axis=-1, keepdims=True)
    inward = np.sum(conormal * surface.base[:, edge.axis], axis=-1, keepdims=True) < 0
    outward: Array = np.where(inward == (edge.side == "max"), -conormal, conormal)
    return outward
