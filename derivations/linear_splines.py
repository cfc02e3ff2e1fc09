r"""Linear Kirchhoff-Love shells by Ritz's method on tensor-product splines, in any frame.

The displacement is u = sum_c F_c(xi) phi_c(xi): three splines phi along three smooth vector fields F, the frame. In the
Cartesian frame a support holds Cartesian components. In the frame (x,1  x,2  x,1 cross x,2) a clamped edge is one
where phi_1 = phi_2 = 0 and phi_3 vanishes with its slope, for u = 0 leaves u,1 . a3 to phi_3 alone. The strains are products
of vectors (Kairanda et al. 2023, eq. (30), linear):

    eps_ab = (x,a . u,b + x,b . u,a) / 2,    kap_ab = -(u,ab - Gamma^m_ab u,m) . a3.

1. At each Gauss point a matrix L gives the six strains from u and its five derivatives.
2. The product rule turns derivatives of u into those of phi, a matrix of F and its derivatives.
3. Knot span by knot span, both stiffnesses are sums of B^T C B, B the strains of the functions of a span.
4. The sum is scaled to a unit diagonal, factorised, and the solution corrected once by its residual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from .spline_shell import Ends, Splines
from .surface_strains import Array

Field = Callable[[Array, Array, int, int], Array]
"""Derivative, of given orders, of vectors at (points,) xi1 and xi2."""
ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
PRODUCTS = {  # derivative of a product: numbers of ORDERS of either factor
    0: ((0, 0),),
    1: ((1, 0), (0, 1)),
    2: ((2, 0), (0, 2)),
    3: ((3, 0), (1, 1), (1, 1), (0, 3)),
    4: ((4, 0), (2, 2), (2, 2), (0, 4)),
    5: ((5, 0), (1, 2), (2, 1), (0, 5)),
}
PAIRS = ((0, 0), (1, 1), (0, 1))
CHUNK = 64
"""Knot spans whose strains are held at once: a bound on memory."""


def cartesian(one: Array, two: Array, i: int, j: int) -> Array:
    """Cartesian frame: derivatives (points, component, 3)."""
    del two
    return np.broadcast_to(np.eye(3) * (i + j == 0), (len(one), 3, 3))


def elasticity(inverse: Array, poisson: float) -> Array:
    """H (points, 3, 3) of (eps_11, eps_22, 2 eps_12) from the inverse metric (points, 2, 2)."""
    found = np.empty((len(inverse), 3, 3))
    for i, (a, b) in enumerate(PAIRS):
        for j, (c, d) in enumerate(PAIRS):
            crossed = inverse[:, a, c] * inverse[:, b, d] + inverse[:, a, d] * inverse[:, b, c]
            found[:, i, j] = poisson * inverse[:, a, b] * inverse[:, c, d] + (1 - poisson) / 2 * crossed
    return found


@dataclass(frozen=True)
class System:
    """The linear system of the free coefficients.

    Attributes
    ----------
    membrane, bending : stiffnesses
    load : work of the loads on each function
    pulled : by part of the energy, work of the stresses of `LinearShell.moved` on each function, (2, free)
    stored : by part, the energy of `LinearShell.moved` itself, J
    """

    membrane: sparse.csr_array
    bending: sparse.csr_array
    load: Array
    pulled: Array
    stored: Array


@dataclass(frozen=True)
class Answer:
    """A solved shell: its free coefficients, and half of the work of its loads, of membrane and of bending, J."""

    shell: LinearShell
    free: Array
    work: float
    membrane: float
    bending: float

    def displacement(self, one: float, two: float) -> Array:
        """Cartesian displacement (3,) at a point, m."""
        found = np.asarray(self.shell.rows(one, two) @ self.free)
        if self.shell.moved is not None:
            found += self.shell.moved(np.array([one]), np.array([two]), 0, 0)[0]
        return found


@dataclass(frozen=True)
class LinearShell:
    """A patch with its supports and loads.

    Attributes
    ----------
    surface : derivatives of the reference position, (points, 3)
    frame : derivatives of the vectors F_c, (points, c, 3)
    splines : along xi1 and xi2
    ends : for each component of the frame the conditions at the ends of xi1 and of xi2
    young, poisson, thickness : Pa, 1, m
    load : force per reference area, Pa: (3,), or a function of xi1 and xi2 that gives (points, 3)
    forces : (xi1, xi2, force), N
    moved : derivatives of a Cartesian displacement, (points, 3), that the splines are added to: one that supports prescribe
    """

    surface: Field
    frame: Field
    splines: tuple[Splines, Splines]
    ends: Sequence[tuple[Ends, Ends]]
    young: float
    poisson: float
    thickness: float
    load: tuple[float, float, float] | Callable[[Array, Array], Array] | None = None
    forces: tuple[tuple[float, float, tuple[float, float, float]], ...] = ()
    moved: Field | None = None

    @cached_property
    def reduction(self) -> sparse.csr_array:
        """Matrix from the free to all coefficients, which are numbered by component, then xi1, then xi2."""
        first, second = self.splines
        blocks = [sparse.kron(first.reduction(one), second.reduction(two)) for one, two in self.ends]
        return sparse.csr_array(sparse.block_diag(blocks))

    @cached_property
    def _places(self) -> tuple[Array, Array, Array]:
        """Points xi1, xi2 and parametric weights of all spans, each (spans, points of a span)."""
        (p, v), (q, w) = self.splines[0].gauss, self.splines[1].gauss
        shape = len(p), len(q), p.shape[1], q.shape[1]
        flat = len(p) * len(q), -1
        one = np.broadcast_to(p[:, None, :, None], shape).reshape(flat)
        two = np.broadcast_to(q[None, :, None, :], shape).reshape(flat)
        return one, two, np.einsum("ip,jq->ijpq", v, w).reshape(flat)

    @cached_property
    def _numbers(self) -> np.ndarray:
        """Numbers of the coefficients of each span, (spans, 3 x functions of a span)."""
        counts = [s.count for s in self.splines]
        local = [np.arange(s.degree + 1)[None] + np.arange(len(s.breaks) - 1)[:, None] for s in self.splines]
        numbers = (local[0][:, None, :, None] * counts[1] + local[1][None, :, None, :]).reshape(
            len(local[0]) * len(local[1]), -1
        )
        return (np.arange(3)[None, :, None] * counts[0] * counts[1] + numbers[:, None]).reshape(len(numbers), -1)

    def _shapes(self, part: slice) -> Array:
        """Functions of the spans and their derivatives, (spans, points, 6, functions)."""
        (a, b), found = self.splines, []
        across = len(b.breaks) - 1
        first, second = np.divmod(np.arange(len(self._numbers))[part], across)
        for i, j in ORDERS:
            product = np.einsum("sim,sjn->sijmn", a.local(i)[first], b.local(j)[second])
            s, p, q, m, n = product.shape
            found.append(product.reshape(s, p * q, m * n))
        return np.stack(found, axis=2)

    def _point_matrices(self, one: Array, two: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Strains from phi and from u (points, 6, 6, 3), H and F (points, 3, 3), root of the metric's determinant."""
        x = [self.surface(one, two, *orders) for orders in ORDERS]
        tangents = np.stack(x[1:3], axis=1)
        normal = np.cross(x[1], x[2])
        area = np.linalg.norm(normal, axis=-1)
        normal /= area[:, None]
        inverse = np.linalg.inv(tangents @ np.swapaxes(tangents, 1, 2))
        # L: rows of strain, derivative of u, component of u
        matrix = np.zeros((len(one), 6, 6, 3))
        for row, (a, b) in enumerate(PAIRS):
            matrix[:, row, 1 + b] += 0.5 * x[1 + a] * (1 + (a != b))
            matrix[:, row, 1 + a] += 0.5 * x[1 + b] * (1 + (a != b))
            christoffel = np.einsum("pc,pmc,pml->pl", x[3 + row], tangents, inverse)
            doubled = 1.0 + (a != b)
            matrix[:, 3 + row, 3 + row] -= doubled * normal
            for m in (0, 1):
                matrix[:, 3 + row, 1 + m] += doubled * christoffel[:, m, None] * normal
        frames = [self.frame(one, two, *orders) for orders in ORDERS]
        strains = np.zeros((len(one), 6, 6, 3))
        for kind, terms in PRODUCTS.items():
            for of_frame, of_function in terms:
                strains[:, :, of_function] += np.einsum("pri,pci->prc", matrix[:, :, kind], frames[of_frame])
        return strains, matrix, elasticity(inverse, self.poisson), frames[0], area

    @cached_property
    def system(self) -> System:
        """Stiffnesses and loads of the free coefficients."""
        spans, size = self._numbers.shape
        blocks = np.empty((2, spans, size, size))
        work = np.zeros(self.reduction.shape[0])
        pulled, stored = np.zeros((2, len(work))), np.zeros(2)
        stretching = self.young * self.thickness / (1 - self.poisson**2)
        factors = stretching, stretching * self.thickness**2 / 12
        for start in range(0, spans, CHUNK):
            part = slice(start, start + CHUNK)
            one, two, weight = (array[part] for array in self._places)
            strains, of_moved, elastic, frame, area = self._point_matrices(one.ravel(), two.ravel())
            shapes = self._shapes(part)
            shape = weight.shape
            area = area.reshape(shape) * weight
            b = np.einsum("sprkc,spkn->sprcn", strains.reshape(*shape, 6, 6, 3), shapes, optimize=True)
            b = b.reshape(*shape, 6, size)
            for number, factor in enumerate(factors):
                rows = b[:, :, 3 * number : 3 * number + 3]
                stress = elastic.reshape(*shape, 3, 3) @ rows * (factor * area[..., None, None])
                flat = len(rows), -1, size
                blocks[number, part] = np.swapaxes(rows.reshape(flat), 1, 2) @ stress.reshape(flat)
                if self.moved is not None:
                    u = np.stack([self.moved(one.ravel(), two.ravel(), *orders) for orders in ORDERS], axis=1)
                    strain = np.einsum("prki,pki->pr", of_moved[:, 3 * number : 3 * number + 3], u).reshape(*shape, 3)
                    np.add.at(pulled[number], self._numbers[part], np.einsum("sprn,spr->sn", stress, strain))
                    tension = elastic.reshape(*shape, 3, 3) @ strain[..., None]
                    stored[number] += factor / 2 * np.sum(strain * tension[..., 0] * area[..., None])
            if self.load is not None:
                load = self.load(one.ravel(), two.ravel()) if callable(self.load) else np.asarray(self.load)
                load = np.broadcast_to(load, (one.size, 3)).reshape(*shape, 3)
                pushed = np.einsum("spci,spi->spc", frame.reshape(*shape, 3, 3), load) * area[..., None]
                local = np.einsum("spc,spn->scn", pushed, shapes[:, :, 0])
                np.add.at(work, self._numbers[part], local.reshape(len(local), -1))
        for one, two, force in self.forces:
            work += np.asarray(force) @ self._all_rows(one, two)
        rows = np.broadcast_to(self._numbers[:, :, None], blocks.shape[1:]).ravel()
        columns = np.broadcast_to(self._numbers[:, None, :], blocks.shape[1:]).ravel()
        full = [sparse.csr_array((block.ravel(), (rows, columns)), shape=(len(work),) * 2) for block in blocks]
        membrane, bending = (sparse.csr_array(self.reduction.T @ k @ self.reduction) for k in full)
        return System(membrane, bending, np.asarray(self.reduction.T @ work), pulled @ self.reduction, stored)

    def _all_rows(self, one: float, two: float) -> Array:
        first, second = (s.matrix(np.array([at]), 0)[0] for s, at in zip(self.splines, (one, two), strict=True))
        frame = self.frame(np.array([one]), np.array([two]), 0, 0)[0]
        return np.asarray(np.einsum("ci,n->icn", frame, np.kron(first, second)).reshape(3, -1))

    def rows(self, one: float, two: float) -> Array:
        """Rows (3, free) that give the Cartesian displacement at a point."""
        return np.asarray((self.reduction.T @ self._all_rows(one, two).T).T)

    def solve(self, held: Sequence[Array] = ()) -> Answer:
        """Minimise the potential energy; the rows `held`, each of one free coefficient's number, take rigid motions."""
        system = self.system
        load, matrix = system.load - system.pulled.sum(axis=0), system.membrane + system.bending
        kept = np.setdiff1d(np.arange(len(load)), np.asarray(held, dtype=int))
        scale = 1 / np.sqrt(matrix.diagonal()[kept])
        scaled = sparse.diags_array(scale) @ matrix[kept][:, kept] @ sparse.diags_array(scale)
        solve = splu(
            scaled.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        ).solve
        right = scale * load[kept]
        found = solve(right)
        found += solve(right - scaled @ found)
        free = np.zeros_like(load)
        free[kept] = scale * found
        parts = zip((system.membrane, system.bending), system.pulled, system.stored, strict=True)
        energies = [float(free @ (k @ free) / 2 + pulled @ free + stored) for k, pulled, stored in parts]
        return Answer(self, free, float(system.load @ free) / 2, *energies)
