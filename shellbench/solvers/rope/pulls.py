"""Pulls of links: tensions, and the impulses of links that become taut, for many chains at once.

Both solve the same inequalities along each chain, for pulls T_i >= 0 of links i = 1..m,

    D_i T_i - L_i T_{i-1} - U_i T_{i+1} >= R_i,

with T_i = 0 where link i is slack, and equality where T_i > 0. Sweeps set each T_i in turn to the larger of zero and
the solution of its row (eqs. (5) and (9) of the paper). The direct method solves all rows as one tridiagonal system.
Then it releases links whose pull would be negative and adds links that would be stretched, until none is left
(principal pivoting). The exact matrix J M^-1 J^T has positive minors, so that the answer is unique.

Arrays have links first and chains last: (m, C); vectors are (m, C, 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUNDS = 30  # of pivoting in which all wrong links of a chain change at once; then one by one, which always terminates
MOST_SWEEPS = 100_000
FEW = 16  # chains
SLACK = 1e-13  # relative: a row that lacks no more is met


@dataclass(frozen=True)
class Rows:
    """The inequalities of all links: arrays (m, C)."""

    diagonal: Array
    lower: Array
    upper: Array
    right: Array
    taut: Mask


def dot(a: Array, b: Array) -> Array:
    """Return the scalar products of vectors (..., 3)."""
    return np.asarray(np.einsum("...k,...k->...", a, b))


def cosines(directions: Array) -> tuple[Array, Array]:
    """Return the cosines of each link with the link before it and the link after it; zero without such a link."""
    before, after = np.zeros(directions.shape[:-1]), np.zeros(directions.shape[:-1])
    before[1:] = after[:-1] = dot(directions[1:], directions[:-1])
    return before, after


def inverse_masses(masses: Array) -> tuple[Array, Array]:
    """Return 1/M at the near end of each link, which is zero at the root, and at its far end."""
    far = 1.0 / masses
    return np.concatenate([np.zeros_like(far[:1]), far[:-1]]), far


def mass_rows(directions: Array, masses: Array, right: Array, taut: Mask) -> Rows:
    """Return the rows of J M^-1 J^T: those of impulses (8), and of tensions in their corrected form."""
    near, far = inverse_masses(masses)
    before, after = cosines(directions)
    return Rows(near + far, near * before, far * after, right, taut)


def printed_rows(directions: Array, right: Array, taut: Mask) -> Rows:
    """Return the rows of tensions as printed (4): twos on the diagonal, one at the root, whatever the masses."""
    before, after = cosines(directions)
    diagonal = np.full(right.shape, 2.0)
    diagonal[0] = 1.0
    return Rows(diagonal, before, after, right, taut)


def sweep_pulls(rows: Rows, count: int | None, tolerance: float, *, from_tip: bool) -> Array:
    """Return the pulls (m, C) after sweeps from zero: so many, or until they change by less than the tolerance.

    The tolerance is relative to the largest pull of all.
    """
    links = len(rows.right)
    order = range(links - 1, -1, -1) if from_tip else range(links)
    pulls = np.zeros_like(rows.right)
    for _ in range(MOST_SWEEPS if count is None else count):
        previous = pulls.copy()
        for i in order:
            wanted = rows.right[i]
            if i > 0:
                wanted = wanted + rows.lower[i] * pulls[i - 1]
            if i < links - 1:
                wanted = wanted + rows.upper[i] * pulls[i + 1]
            pulls[i] = np.where(rows.taut[i], np.maximum(0.0, wanted / rows.diagonal[i]), 0.0)
        if count is None and np.abs(pulls - previous).max() <= tolerance * np.abs(pulls).max():
            break
    return pulls


def eliminate(rows: Rows, active: Mask) -> Array:
    """Return the solution of the active rows as equations, zero elsewhere.

    Thomas's elimination along the links, all chains at once; a few chains are quicker as dense matrices.
    """
    if rows.right.shape[1] <= FEW:
        return solve_dense(rows, active)
    diagonal, lower = np.where(active, rows.diagonal, 1.0), np.where(active, rows.lower, 0.0)
    upper, right = np.where(active, rows.upper, 0.0), np.where(active, rows.right, 0.0)
    ahead, pulls = np.empty_like(right), np.empty_like(right)
    ahead[0], pulls[0] = upper[0] / diagonal[0], right[0] / diagonal[0]
    for i in range(1, len(right)):
        pivot = diagonal[i] - lower[i] * ahead[i - 1]
        ahead[i] = upper[i] / pivot
        pulls[i] = (right[i] + lower[i] * pulls[i - 1]) / pivot
    for i in range(len(right) - 2, -1, -1):
        pulls[i] += ahead[i] * pulls[i + 1]
    return pulls


def solve_dense(rows: Rows, active: Mask) -> Array:
    """Return the result of `eliminate`, by a dense matrix for each chain."""
    links, chains = rows.right.shape
    matrices = np.zeros((chains, links, links))
    number = np.arange(links)
    matrices[:, number, number] = np.where(active, rows.diagonal, 1.0).T
    matrices[:, number[1:], number[:-1]] = np.where(active, -rows.lower, 0.0)[1:].T
    matrices[:, number[:-1], number[1:]] = np.where(active, -rows.upper, 0.0)[:-1].T
    right = np.where(active, rows.right, 0.0).T
    return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0].T)


def shortfall(rows: Rows, pulls: Array) -> Array:
    """Return the amount by which each row falls short of its right side."""
    short = rows.right - rows.diagonal * pulls
    short[1:] += rows.lower[1:] * pulls[:-1]
    short[:-1] += rows.upper[:-1] * pulls[1:]
    return short


def direct_pulls(rows: Rows) -> Array:
    """Return the pulls (m, C) that meet all inequalities of taut links."""
    active = rows.taut
    least = SLACK * np.abs(rows.right).max(initial=0.0)
    number = np.arange(len(rows.right))[:, None]
    for attempt in range(2**20):
        pulls = eliminate(rows, active)
        wrong = (active & (pulls < 0)) | (rows.taut & ~active & (shortfall(rows, pulls) > least))
        if not wrong.any():
            break
        if attempt >= ROUNDS:  # Murty's rule: the last wrong link only
            wrong &= number == np.where(wrong, number, -1).max(axis=0)
        active = active ^ wrong
    return np.where(active, pulls, 0.0)
