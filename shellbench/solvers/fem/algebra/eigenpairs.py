"""The largest eigenvalues of A u = mu B u, A symmetric, B positive definite and factorised: a block Lanczos method.

Vibration and buckling both have this form, with mu the reciprocal of the value that is asked for. The first values are
therefore found first (the transformation of Ericsson & Ruhe 1980, at the shift zero or below).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, eigvalsh

Array = NDArray[np.float64]
Apply = Callable[[Array], Array]

BLOCK = 8  # vectors at a time: no eigenvalue may occur more often
MOST_BLOCKS = 60
PAIR_FOUND = 1e-6  # residual of a pair relative to mu: the error of mu itself is its square over a gap
# Relative squared length of a vector after orthogonalisation that counts as rounding.
LOST = 1e-12


class NotFoundError(ArithmeticError):
    """There are fewer eigenvalues above zero than asked for, or they did not converge.

    Attributes
    ----------
    positive
        Number of eigenvalues that are certainly above zero: the projected matrix has no more of them than A.
    """

    def __init__(self, positive: int) -> None:
        super().__init__(f"{positive} eigenvalues above zero were found")
        self.positive = positive


def largest_eigenpairs(apply: Apply, solve: Apply, start: Array, count: int) -> tuple[Array, Array]:
    """Return the largest eigenvalues (count,), decreasing, and their vectors (n, count) of length one in B.

    Parameters
    ----------
    apply, solve
        A and B^-1 times vectors (n, m).
    start
        (n, BLOCK) independent vectors.

    Raises
    ------
    NotFoundError
        If there are fewer above zero, or they did not converge.
    """
    # 1. Compute W = B^-1 A Q of the last block Q. Its components along all blocks so far are Q^T A Q, the projected A.
    # 2. Subtract them, twice, and make the rest orthonormal in B: the next block.
    # 3. Compute the eigenvalues of the projected A; the part of their vectors in the last block gives the residuals.
    # The textbook's Lanczos method goes vector by vector. It finds one copy of a multiple eigenvalue at first, and the
    # other copies by rounding only. A block finds them all, and many right-hand sides cost hardly more than one. B
    # itself is never applied: B W = A Q is known, and linear combinations keep it.
    columns, dual = _first_block(solve(start), start)
    size, most = len(start), MOST_BLOCKS * BLOCK
    basis, known = (np.empty((size, most), order="F") for _ in range(2))
    projected = np.zeros((most, most))
    used = 0
    for _ in range(MOST_BLOCKS):
        before, used = used, used + columns.shape[1]
        basis[:, before:used], known[:, before:used] = columns, dual
        forward = apply(columns)
        projected[:used, before:used] = basis[:, :used].T @ forward
        projected[before:used, :used] = projected[:used, before:used].T
        vectors, rest = solve(forward), forward
        for _ in range(2):
            along = known[:, :used].T @ vectors
            vectors, rest = vectors - basis[:, :used] @ along, rest - known[:, :used] @ along
        if used >= count:
            values, shares = eigh(projected[:used, :used], subset_by_index=(used - count, used - 1))
            gram = vectors.T @ rest
            last = shares[before:]
            residuals = np.sqrt(np.maximum(np.einsum("ij,ik,kj->j", last, gram, last), 0.0))
            if np.all(residuals <= PAIR_FOUND * np.abs(values)):
                if not values[0] > LOST * values[-1]:
                    break
                return values[::-1], basis[:, :used] @ shares[:, ::-1]
        columns, dual = _orthonormal(vectors, rest)
        if not columns.shape[1]:
            break
    values = eigvalsh(projected[:used, :used])
    raise NotFoundError(int(np.sum(values > LOST * np.abs(values).max())))


def _first_block(vectors: Array, images: Array) -> tuple[Array, Array]:
    """Return vectors (n, m) made orthonormal in B, all of them, and B times them."""
    # If rigid motions are nearly free, B^-1 maps every vector nearly onto them, and the rest would count as rounding. A
    # block that has lost a vector does not find all copies of an eigenvalue. Therefore dependent vectors are made
    # orthonormal again, without the rigid motions.
    columns, dual = _orthonormal(vectors, images)
    while columns.shape[1] < vectors.shape[1]:
        rest, image = vectors, images
        for _ in range(2):
            along = dual.T @ rest
            rest, image = rest - columns @ along, image - dual @ along
        more, more_dual = _orthonormal(rest, image)
        missing = vectors.shape[1] - columns.shape[1]
        columns = np.concatenate([columns, more[:, -missing:]], axis=1)
        dual = np.concatenate([dual, more_dual[:, -missing:]], axis=1)
    return columns, dual


def _orthonormal(vectors: Array, images: Array) -> tuple[Array, Array]:
    """Return vectors (n, m) made orthonormal in B, without dependent ones, and B times them."""
    for _ in range(2):
        lengths, turn = eigh(vectors.T @ images)
        kept = lengths > LOST * max(float(lengths.max()), np.finfo(float).tiny)
        scaled = turn[:, kept] / np.sqrt(lengths[kept])
        vectors, images = vectors @ scaled, images @ scaled
    return vectors, images
