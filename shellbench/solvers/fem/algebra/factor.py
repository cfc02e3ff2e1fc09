"""The factorisation front by front, on a nested dissection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.linalg.blas import dsyrk, dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf

from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix
from shellbench.solvers.fem.algebra.dissection import Dissection, Part, Run, places_in_front

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Ratio of eigenvalues of a pivot block below which it can't be eliminated: 4.5 eps.
SINGULAR = 1e-15


class NotPositiveDefiniteError(ArithmeticError):
    """The matrix is not positive definite to working precision."""


Definiteness = Literal["required", "reported", "imposed"]


@dataclass(frozen=True)
class Triangle:
    """The pivot block of a part that is positive definite, A = R^T R."""

    upper: Array
    negative: int = 0

    @property
    def size(self) -> int:
        """Numbers kept."""
        return self.upper.size

    def forward(self, right: Array) -> Array:
        """Return R^-T right."""
        return self._triangular_solve(right, 0)

    def times_signs(self, right: Array) -> Array:
        """Return S right; here S is the identity."""
        return right

    def backward(self, right: Array) -> Array:
        """Return R^-1 right."""
        return self._triangular_solve(right, 1)

    def _triangular_solve(self, right: Array, transposed: int) -> Array:
        lower = self.upper.T  # as LAPACK reads it, uncopied
        if right.shape[1] == 1:  # half the time, from 200 unknowns on
            return np.asarray(dtrsv(lower, right[:, 0], lower=1, trans=transposed))[:, None]
        return np.asarray(dtrsm(1.0, lower, right, lower=1, trans_a=transposed))


@dataclass(frozen=True)
class Spectrum:
    """The pivot block of a part that is indefinite, A = R^T S R by its eigenvectors, S = +-1.

    Attributes
    ----------
    vectors
        (n, n) by columns.
    roots, signs
        (n,) square roots of the eigenvalues' magnitudes, and S.
    negative
        Number of negative eigenvalues, also where S was made positive.
    """

    vectors: Array
    roots: Array
    signs: Array
    negative: int

    @property
    def size(self) -> int:
        """Numbers kept."""
        return self.vectors.size

    def forward(self, right: Array) -> Array:
        """Return R^-T right."""
        return np.asarray((self.vectors.T @ right) / self.roots[:, None])

    def times_signs(self, right: Array) -> Array:
        """Return S right."""
        return right * self.signs[:, None]

    def backward(self, right: Array) -> Array:
        """Return R^-1 right."""
        return np.asarray(self.vectors @ (right / self.roots[:, None]))


@dataclass(frozen=True)
class Factor:
    """A factorisation K = R^T S R in fronts, S = 1 where the matrix is positive definite.

    Attributes
    ----------
    dissection
        The elimination order.
    pivots, coupling
        By part: its own block, and the rows of R (n, m) that couple its unknowns to its ring.
    block
        Unknowns of a node.
    """

    dissection: Dissection
    pivots: tuple[Triangle | Spectrum, ...]
    coupling: tuple[Array, ...]
    block: int

    @property
    def negative_count(self) -> int:
        """Number of negative eigenvalues of K (Sylvester's law of inertia), before any was made positive."""
        return sum(pivot.negative for pivot in self.pivots)

    def solve(self, right: Array) -> Array:
        """Solve K x = right for (nodes, block, n) right-hand sides."""
        columns = right.shape[-1]
        # R^T S R x = b, front by front. A part has the pivot block A = P^T S P and the coupling C = P^-T B.
        # 1. Upwards: y = S P^-T b on its own nodes, then b -= C^T y on its ring.
        # 2. Downwards: x = P^-1 (y - S C x_ring), its ring being known by then.
        x = right.reshape(-1, self.block, columns)[self.dissection.order]
        parts = list(zip(self.dissection.parts, self.pivots, self.coupling, strict=True))
        for part, pivot, coupling in parts:
            own = x[slice(*part.own)].reshape(-1, columns)
            own[...] = pivot.times_signs(pivot.forward(own))
            x[part.ring] -= (coupling.T @ own).reshape(-1, self.block, columns)
        for part, pivot, coupling in parts[::-1]:
            own = x[slice(*part.own)].reshape(-1, columns)
            own -= pivot.times_signs(coupling @ x[part.ring].reshape(-1, columns))
            own[...] = pivot.backward(own)
        result = np.zeros_like(right)
        result.reshape(-1, self.block, columns)[self.dissection.order] = x
        return result


def factorise(matrix: BlockMatrix, dissection: Dissection, definiteness: Definiteness = "required") -> Factor:
    """Factorise a symmetric matrix.

    Parameters
    ----------
    matrix, dissection
        The matrix, and the order of elimination.
    definiteness
        "required": the matrix must be positive definite. "reported": it need not be; a part whose pivot block is
        indefinite is eliminated by its eigenvectors, and `Factor.negative_count` counts the negative eigenvalues.
        "imposed": as "reported", but negative pivots are replaced by positive ones, which makes any step a descent
        direction.

    Raises
    ------
    NotPositiveDefiniteError
        If a pivot is not positive and must be, or is zero, or the matrix is not finite.
    MemoryError
        If the fronts do not fit.
    """
    # Multifrontal elimination, part by part in the order of the dissection:
    # 1. Assemble the front: the matrix's rows of the part's own nodes, and the children's Schur complements.
    # 2. Eliminate its own unknowns, A = P^T S P and C = P^-T B.
    # 3. Pass D - C^T S C on the ring to the parent.
    # The textbook assembles element matrices. Here the global matrix exists, and its rows enter once, with their node.
    # There is no pivoting between fronts, and none is delayed: the fronts keep the shape that the dissection gave them.
    block = matrix.blocks.shape[-1]
    rank = np.empty(len(dissection.order) + 1, dtype=np.int64)
    rank[dissection.order] = np.arange(len(dissection.order))
    rank[-1] = -1  # so that the neighbour -1 beyond the mesh's end has the place -1
    columns = rank[matrix.columns[dissection.order]]
    # A Schur complement lives until its parent takes it: only those of open parts are in memory.
    schur: dict[int, Array] = {}
    pivots, coupling = [], []
    for number, part in enumerate(dissection.parts):
        front = Front(part, block)
        nodes = dissection.order[slice(*part.own)]
        front.add_rows(matrix.blocks[nodes], columns[slice(*part.own)])
        for child, runs in zip(part.children, dissection.runs[number], strict=True):
            front.add_schur(schur.pop(child), runs)
        pivot, schur[number] = front.eliminate(definiteness)
        pivots.append(pivot)
        coupling.append(front.coupling)
    return Factor(dissection, tuple(pivots), tuple(coupling), block)


class Front:
    """The dense matrix of a part, at first `whole` or zero; only its upper triangle is used."""

    def __init__(self, part: Part, block: int, whole: Array | None = None) -> None:
        self.part, self.block = part, block
        self.size = part.own[1] - part.own[0]
        n, m = self.size * block, len(part.ring) * block
        if whole is None:
            self.own, self.coupling, self.rest = np.zeros((n, n)), np.zeros((n, m)), np.zeros((m, m))
        else:
            self.own, self.coupling, self.rest = map(
                np.ascontiguousarray, (whole[:n, :n], whole[:n, n:], whole[n:, n:])
            )

    def add_rows(self, blocks: Array, columns: Integers) -> None:
        """Add the matrix's rows of the part's own nodes, as far as they couple to nodes not yet eliminated."""
        # Nodes eliminated before couple to these in their own rows, by symmetry. The children's Schur complements
        # contain this.
        row, slot = np.nonzero(columns >= self.part.own[0])
        place = places_in_front(self.part, columns[row, slot])
        inside = place < self.size
        own = self.own.reshape(self.size, self.block, self.size, self.block)
        own[row[inside], :, place[inside], :] = blocks[row[inside], slot[inside]]
        coupling = self.coupling.reshape(self.size, self.block, -1, self.block)
        coupling[row[~inside], :, place[~inside] - self.size, :] = blocks[row[~inside], slot[~inside]]

    def add_schur(self, schur: Array, ring: tuple[Run, ...]) -> None:
        """Add a child's Schur complement, run by run of consecutive places."""
        # The textbook's extend-add scatters entry by entry through index arrays.
        # A child's ring is a few runs of places that are consecutive in the parent too: whole rectangles are added.
        # Places increase along the ring: the upper triangle of the child falls on the upper one of the parent.
        runs = [(slice(run.start * self.block, run.stop * self.block), run.place) for run in ring]
        for i, (rows, top) in enumerate(runs):
            for columns, left in runs[i:]:
                if left < self.size:
                    target, offset = self.own, (top, left)
                elif top < self.size:
                    target, offset = self.coupling, (top, left - self.size)
                else:
                    target, offset = self.rest, (top - self.size, left - self.size)
                r, c = (o * self.block for o in offset)
                source = schur[rows, columns]
                target[r : r + source.shape[0], c : c + source.shape[1]] += source

    def eliminate(self, definiteness: Definiteness) -> tuple[Triangle | Spectrum, Array]:
        """Eliminate the part's own unknowns; return their pivot block and the Schur complement on the ring."""
        # Cholesky comes first in every mode: it is cheaper, and fails only if a front has a negative eigenvalue. A
        # front that fails is factorised by eigenvectors, from the copy that Cholesky has not overwritten.
        kept = None if definiteness == "required" else self.own.copy()
        # a row-major upper triangle is LAPACK's column-major lower one, so that nothing is copied
        _, info = dpotrf(self.own.T, lower=1, clean=0, overwrite_a=1)
        pivot: Triangle | Spectrum = Triangle(self.own)
        # LAPACK may run to the end on numbers that are not finite.
        if info != 0 or not np.all(np.isfinite(np.diagonal(self.own))):
            if kept is None or not np.all(np.isfinite(kept)):
                raise NotPositiveDefiniteError
            pivot = _spectrum(kept, definiteness == "imposed")
            self.own = np.empty((0, 0))
        rest, self.rest = self.rest, np.empty((0, 0))
        if self.coupling.size == 0:
            return pivot, rest
        if isinstance(pivot, Triangle):
            # C = P^-T B and D - C^T C, in place and by BLAS 3.
            dtrsm(1.0, self.own.T, self.coupling.T, side=1, lower=1, trans_a=1, overwrite_b=1)
            dsyrk(-1.0, self.coupling.T, beta=1.0, c=rest.T, lower=1, overwrite_c=1)
            return pivot, rest
        self.coupling = pivot.forward(self.coupling)
        # D - C^T S C as two symmetric updates, one for each sign of S.
        for sign in (1.0, -1.0):
            rows = np.ascontiguousarray(self.coupling[pivot.signs == sign])
            if len(rows):
                dsyrk(-sign, rows.T, beta=1.0, c=rest.T, lower=1, overwrite_c=1)
        return pivot, rest


def _spectrum(upper: Array, imposed: bool) -> Spectrum:
    """Return the eigenvectors of the symmetric matrix whose upper triangle is given."""
    # The textbook takes Bunch and Kaufman's 1 x 1 and 2 x 2 pivots. Eigenvectors cost more and give more. Negative
    # eigenvalues are counted for the inertia, and |A| replaces A for a descent direction. The sign of an eigenvalue at
    # rounding is unreliable, and the Schur complement would be divided by it.
    values, vectors = eigh(upper, lower=False)
    if np.abs(values).min() <= SINGULAR * np.abs(values).max():
        raise NotPositiveDefiniteError
    signs = np.ones_like(values) if imposed else np.sign(values)
    return Spectrum(vectors, np.sqrt(np.abs(values)), signs, int(np.count_nonzero(values < 0)))
