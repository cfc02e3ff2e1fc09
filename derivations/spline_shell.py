r"""Large displacements of a Kirchhoff-Love shell by its potential energy on tensor-product splines.

The displacement's Cartesian components are B-splines of high degree on one patch, C^{p-1} inside, and the potential
energy is made stationary. Everything is taken from positions: with x,a and x,ab of the deformed and of the reference
surface, a_ab = x,a . x,b, b_ab = x,ab . n and n = x,1 cross x,2 / abs,

    W = 1/2 D eps.H.eps + 1/2 B kappa.H.kappa,  eps = (a - abar) / 2,  kappa = bbar - b.

First and second variations are the closed formulas of `surface_strains`; no covariant basis, finite element or network is
involved. A condition on an edge is one on the first coefficients of a component across it: a component is free
there, `zero`, `even` (no slope across the edge) or `clamped` (zero with no slope), which holds symmetry planes and
supports exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from .surface_strains import DERIVATIVES, first_variation, second_variation, strains

Array = NDArray[np.float64]
Edge = Literal["free", "zero", "even", "clamped"]
Ends = tuple[Edge, Edge]

CHUNK = 64
"""Knot spans whose stiffness is formed at once: a bound on memory."""


@dataclass(frozen=True)
class Splines:
    """Splines of one variable with simple inner knots: their values at the Gauss points of every knot span."""

    breaks: Array
    degree: int

    @cached_property
    def knots(self) -> Array:
        """Knots with both ends repeated degree + 1 times."""
        ends = [self.breaks[0]] * self.degree, [self.breaks[-1]] * self.degree
        return np.concatenate([ends[0], self.breaks, ends[1]])

    @property
    def count(self) -> int:
        """Number of functions."""
        return len(self.breaks) - 1 + self.degree

    def matrix(self, points: Array, order: int) -> Array:
        """Derivative of every function at the points, (points, functions)."""
        spline = BSpline(self.knots, np.eye(self.count), self.degree)
        return np.asarray(spline.derivative(order)(points) if order else spline(points))

    @cached_property
    def gauss(self) -> tuple[Array, Array]:
        """Points and weights, (spans, degree + 1)."""
        x, w = np.polynomial.legendre.leggauss(self.degree + 1)
        half = np.diff(self.breaks) / 2
        return self.breaks[:-1, None] + half[:, None] * (1 + x), half[:, None] * w

    def local(self, order: int) -> Array:
        """Derivative of the functions that live on a span, (spans, points, degree + 1)."""
        points = self.gauss[0]
        values = self.matrix(points.ravel(), order).reshape(*points.shape, -1)
        return np.stack([v[:, i : i + self.degree + 1] for i, v in enumerate(values)])

    def reduction(self, ends: Ends) -> sparse.csr_array:
        """Matrix from the coefficients that the conditions at both ends leave to all of them."""
        identity = np.eye(self.count)
        kept = np.ones(self.count, dtype=bool)
        for end, (first, second) in zip(ends, ((0, 1), (-1, -2)), strict=True):
            if end == "even":  # the derivative at an end is proportional to the difference of two coefficients
                identity[:, second] += identity[:, first]
            kept[first] = end == "free"
            kept[second] &= end != "clamped"
        return sparse.csr_array(identity[:, kept])


@dataclass(frozen=True)
class State:
    """Free coefficients of a displacement and the load factor that balances them."""

    free: Array
    factor: float


@dataclass(frozen=True)
class Shell:
    """A patch of a shell with its supports and its dead load.

    Attributes
    ----------
    surface : derivative of the reference position, of given orders, at (points,) xi1 and xi2: (points, 3)
    splines : along xi1 and xi2
    ends : for each Cartesian component the conditions at the ends of xi1 and of xi2
    young, poisson, thickness : Pa, 1, m
    load : force per reference area at load factor 1, of (points,) xi1 and xi2: (points, 3); None for none
    forces : (xi1, xi2, force) at load factor 1
    edge_load : force per parametric length along xi2 at the upper end of xi1, load factor 1
    """

    surface: Callable[[Array, Array, int, int], Array]
    splines: tuple[Splines, Splines]
    ends: Sequence[tuple[Ends, Ends]]
    young: float
    poisson: float
    thickness: float
    load: Callable[[Array, Array], Array] | None = None
    forces: tuple[tuple[float, float, tuple[float, float, float]], ...] = ()
    edge_load: tuple[float, float, float] | None = None

    @cached_property
    def reduction(self) -> sparse.csr_array:
        """Matrix from the free to all coefficients, which are numbered by component, then xi1, then xi2."""
        first, second = self.splines
        blocks = [sparse.kron(first.reduction(one), second.reduction(two)) for one, two in self.ends]
        return sparse.csr_array(sparse.block_diag(blocks))

    @cached_property
    def _spans(self) -> Array:
        """Numbers of the functions of each knot span, (spans, functions of a span)."""
        second = self.splines[1]
        local = [np.arange(s.degree + 1)[None] + np.arange(len(s.breaks) - 1)[:, None] for s in self.splines]
        numbers = local[0][:, None, :, None] * second.count + local[1][None, :, None, :]
        return numbers.reshape(len(local[0]) * len(local[1]), -1)

    def _shapes(self, one: int, two: int) -> Array:
        """Products of derivatives, (spans, points of a span, functions of a span)."""
        a, b = self.splines[0].local(one), self.splines[1].local(two)
        product = np.einsum("ipa,jqb->ijpqab", a, b)
        i, j, p, q, m, n = product.shape
        return product.reshape(i * j, p * q, m * n)

    @cached_property
    def _basis(self) -> Array:
        """The five derivatives, (spans, points, 5, functions)."""
        return np.stack([self._shapes(*orders) for orders in DERIVATIVES], axis=2)

    def _of_points(self, function: Callable[[Array, Array], Array]) -> Array:
        """Values of a function at the quadrature points, (spans, points, ...)."""
        (p, _), (q, _) = self.splines[0].gauss, self.splines[1].gauss
        one = np.broadcast_to(p[:, None, :, None], (len(p), len(q), p.shape[1], q.shape[1]))
        two = np.broadcast_to(q[None, :, None, :], one.shape)
        values = function(one.ravel(), two.ravel())
        return values.reshape(len(p) * len(q), -1, *values.shape[1:])

    @cached_property
    def _reference(self) -> tuple[Array, Array, Array, Array]:
        """The five vectors and the strains of the reference, area weights, and H (3 x 3, of doubled shears)."""
        vectors = [self._of_points(lambda a, b, o=orders: self.surface(a, b, *o)) for orders in DERIVATIVES]
        x = np.stack(vectors, axis=2)
        weights = [s.gauss[1] for s in self.splines]
        weight = np.einsum("ip,jq->ijpq", *weights).reshape(x.shape[:2])
        metric = np.einsum("...kc,...lc->...kl", x[..., :2, :], x[..., :2, :])
        inverse = np.linalg.inv(metric)
        pairs = ((0, 0), (1, 1), (0, 1))
        nu = self.poisson
        stiffness = np.empty((*x.shape[:2], 3, 3))
        for i, (a, b) in enumerate(pairs):
            for j, (c, d) in enumerate(pairs):
                crossed = inverse[..., a, c] * inverse[..., b, d] + inverse[..., a, d] * inverse[..., b, c]
                stiffness[..., i, j] = nu * inverse[..., a, b] * inverse[..., c, d] + (1 - nu) / 2 * crossed
        return x, strains(x), weight * np.sqrt(np.linalg.det(metric)), stiffness

    @cached_property
    def _material(self) -> Array:
        """D H and B H with the area weight, (spans, points, 6, 6)."""
        _, _, weight, stiffness = self._reference
        stretching = self.young * self.thickness / (1 - self.poisson**2)
        material = np.zeros((*weight.shape, 6, 6))
        material[..., :3, :3] = stretching * stiffness * weight[..., None, None]
        material[..., 3:, 3:] = stretching * self.thickness**2 / 12 * stiffness * weight[..., None, None]
        return material

    @cached_property
    def load_vector(self) -> Array:
        """Work of the load at load factor 1 on every free coefficient."""
        first, second = self.splines
        work = np.zeros((3, first.count * second.count))
        if self.load is not None:
            density = self._of_points(self.load) * self._reference[2][..., None]
            local = np.einsum("epn,epc->cen", self._shapes(0, 0), density)
            for c in range(3):
                np.add.at(work[c], self._spans, local[c])
        for one, two, force in self.forces:
            work += np.outer(force, self.values(one, two))
        if self.edge_load is not None:
            points, weights = second.gauss
            line = weights.ravel() @ second.matrix(points.ravel(), 0)
            work.reshape(3, first.count, -1)[:, -1] += np.outer(self.edge_load, line)
        return np.asarray(self.reduction.T @ work.ravel())

    def values(self, one: float, two: float) -> Array:
        """Value of every function at a point."""
        first, second = (s.matrix(np.array([at]), 0)[0] for s, at in zip(self.splines, (one, two), strict=True))
        return np.kron(first, second)

    def row(self, one: float, two: float, direction: Sequence[float]) -> Array:
        """Row that gives the displacement along a direction at a point from the free coefficients."""
        return np.asarray(self.reduction.T @ np.kron(direction, self.values(one, two)))

    def _vectors(self, free: Array) -> Array:
        coefficients = (self.reduction @ free).reshape(3, -1)[:, self._spans]
        moved = np.einsum("epkn,cen->epkc", self._basis, coefficients)
        return np.asarray(self._reference[0] + moved)

    def energies(self, free: Array) -> tuple[float, float]:
        """Membrane and bending energy, J."""
        change = strains(self._vectors(free)) - self._reference[1]
        stress = np.einsum("epij,epj->epi", self._material, change)
        products = np.sum(change * stress, axis=(0, 1)) / 2
        return float(products[:3].sum()), float(products[3:].sum())

    def displacements(self, free: Array, one: Array, two: Array) -> Array:
        """Displacement on the grid of the given coordinates, (xi1, xi2, 3)."""
        coefficients = (self.reduction @ free).reshape(3, self.splines[0].count, -1)
        return np.einsum("ia,jb,cab->ijc", self.splines[0].matrix(one, 0), self.splines[1].matrix(two, 0), coefficients)

    def linearised(self, free: Array) -> Linearised:
        """Strains, stresses and first variation at a displacement."""
        x = self._vectors(free)
        values, gradient = first_variation(x)
        stress = np.einsum("epij,epj->epi", self._material, values - self._reference[1])
        return Linearised(self, x, stress, gradient.reshape(*gradient.shape[:3], 15))

    @cached_property
    def _pattern(self) -> tuple[Array, Array, Array]:
        """Compressed sparse rows of all coefficients, and where each entry of each span goes."""
        count = self.splines[0].count * self.splines[1].count
        numbers = (np.arange(3)[None, None] * count + self._spans[..., None]).reshape(len(self._spans), -1)
        codes = (numbers[:, :, None] * (3 * count) + numbers[:, None, :]).ravel()
        unique, position = np.unique(codes, return_inverse=True)
        rows = np.concatenate([[0], np.cumsum(np.bincount(unique // (3 * count), minlength=3 * count))])
        return rows, unique % (3 * count), position

    def assemble(self, blocks: Array) -> sparse.csr_array:
        """Sum the matrices of the spans and reduce them to the free coefficients."""
        rows, columns, position = self._pattern
        data = np.bincount(position, weights=blocks.ravel(), minlength=len(columns))
        full = sparse.csr_array((data, columns, rows))
        return sparse.csr_array(self.reduction.T @ full @ self.reduction)


@dataclass(frozen=True)
class Linearised:
    """The shell at a displacement: vectors (spans, points, 5, 3), weighted stresses and strain gradients."""

    shell: Shell
    vectors: Array
    stress: Array
    gradient: Array

    def forces(self) -> Array:
        """Derivative of the strain energy by the free coefficients."""
        density = np.einsum("epi,epij->epj", self.stress, self.gradient)
        density = density.reshape(*density.shape[:2], 5, 3)
        local = np.einsum("epkn,epkc->cen", self.shell._basis, density)
        count = self.shell.splines[0].count * self.shell.splines[1].count
        total = np.stack([np.bincount(self.shell._spans.ravel(), c.ravel(), minlength=count) for c in local])
        return np.asarray(self.shell.reduction.T @ total.ravel())

    def predicted_stress(self, step: Array) -> Array:
        """Stress with the strain linear in a step of the free coefficients."""
        moved = self.shell._vectors(step) - self.shell._reference[0]
        change = np.einsum("epij,epj->epi", self.gradient, moved.reshape(*moved.shape[:2], 15))
        return np.asarray(self.stress + np.einsum("epij,epj->epi", self.shell._material, change))

    def stiffness(self, stress: Array | None = None) -> sparse.csr_array:
        """Tangent stiffness; its part from the stress with the given one (its own if None)."""
        stress = self.stress if stress is None else stress
        basis = self.shell._basis
        spans, points, _, functions = basis.shape
        blocks = np.empty((spans, 3 * functions, 3 * functions))
        for start in range(0, spans, CHUNK):
            part = slice(start, start + CHUNK)
            b = self.gradient[part]
            inner = np.swapaxes(b, -1, -2) @ self.shell._material[part] @ b
            inner = inner.reshape(*b.shape[:2], 5, 3, 5, 3)
            inner += second_variation(self.vectors[part], stress[part])
            by_right = np.einsum("epkcld->epkcdl", inner).reshape(*b.shape[:2], 45, 5) @ basis[part]
            right = by_right.reshape(len(b), points, 5, 3 * 3 * functions).reshape(len(b), points * 5, -1)
            left = np.swapaxes(basis[part].reshape(len(b), points * 5, functions), -1, -2)
            block = (left @ right).reshape(len(b), functions, 3, 3, functions)
            blocks[part] = np.einsum("eacdb->eacbd", block).reshape(len(b), 3 * functions, -1)
        return self.shell.assemble(blocks)
