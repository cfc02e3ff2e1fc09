r"""Minimise a quadratic energy without forming its stiffness: orthogonal factors, strip by strip.

The energy of a shell is half the square of a long vector, A q: at each Gauss point its strains, times a root of their
stiffness and of the area. A^T A has the square of the condition number of A, and a thin shell that bends loses to it
all digits that graded meshes are for. Here A = Q R is found instead, R^T R = A^T A, and R^T R q = f is solved.

Rows come in pieces, one for each cell, and pieces in strips along xi1. The unknowns of one piece alone are eliminated
with it, and those that no later strip has with their strip: their rows of R are kept. The others, the front, wait for
the next strip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from .surface_strains import Array

Piece = tuple[np.ndarray, Array]
"""Numbers of unknowns, and rows of A with a column for each of them."""


@dataclass(frozen=True)
class Factor:
    """Rows of R: the unknowns that are eliminated, the others in these rows, and the coefficients of both."""

    ended: np.ndarray
    front: np.ndarray
    own: Array
    coupled: Array


def triangle(rows: Array) -> Array:
    """Return R of rows that are sorted by size.

    Householder's reflections then keep small rows beside large ones (Cox & Higham 1998). Cells near a corner have rows
    that are larger by powers of the ratio of their sizes.
    """
    return np.asarray(np.linalg.qr(rows[np.argsort(-np.abs(rows).max(axis=1, initial=0.0))], mode="r"))


def eliminated(piece: Piece, ends: np.ndarray) -> tuple[Factor, Array]:
    """Return the rows of R of the unknowns that end, and the rows that are left of the others."""
    columns, rows = piece
    order, count = np.argsort(~ends, kind="stable"), int(np.sum(ends))
    r = triangle(rows[:, order])
    columns = columns[order]
    return Factor(columns[:count], columns[count:], r[:count, :count], r[:count, count:]), r[count:, count:]


def factors(strips: Sequence[Sequence[Piece]], unknowns: int) -> list[Factor]:
    """Return the rows of R."""
    pieces, last = np.zeros((2, unknowns), dtype=int)
    for number, strip in enumerate(strips):
        for columns, _ in strip:
            pieces[columns] += 1
            last[columns] = number
    found: list[Factor] = []
    front, waiting = np.zeros(0, dtype=int), np.zeros((0, 0))
    for number, strip in enumerate(strips):
        shared = [(front, waiting)]
        for columns, rows in strip:
            factor, left = eliminated((columns, rows), pieces[columns] == 1)
            found.append(factor)
            shared.append((factor.front, left))
        every = np.unique(np.concatenate([columns for columns, _ in shared]))
        stacked = np.zeros((sum(len(rows) for _, rows in shared), len(every)))
        row = 0
        for columns, rows in shared:
            stacked[row : row + len(rows), np.searchsorted(every, columns)] = rows
            row += len(rows)
        factor, waiting = eliminated((every, stacked), last[every] == number)
        found.append(factor)
        front = factor.front
    return found


def minimiser(rows: list[Factor], load: Array) -> Array:
    """Return q of R^T R q = load."""
    left = load.copy()
    for f in rows:
        if len(f.ended):
            left[f.ended] = solve_triangular(f.own, left[f.ended], trans="T")
            left[f.front] -= f.coupled.T @ left[f.ended]
    q = left.copy()
    for f in reversed(rows):
        if len(f.ended):
            q[f.ended] = solve_triangular(f.own, left[f.ended] - f.coupled @ q[f.front])
    return q
