"""Factorisation of a sum of cell matrices, for meshes of degree 4 and 5.

Vertices, sides and insides of cells are the points of a grid twice as fine: a vertex carries 12 unknowns, a side 6 (p -
3) and the inside 3 (p - 3)^2. They are dissected like nodes (see `dissection`), but only along mesh lines. A separator
therefore is one line of vertices with the sides along it, whatever the degree, and the inside of each cell is
eliminated first: static condensation is the innermost step of the dissection. Each cell's matrix enters the front that
eliminates its inside, as in the textbook (Duff & Reid 1983); no global matrix is made.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices
from shellbench.solvers.fem.algebra.dissection import Array, Dissection, Integers, Part, places_in_front
from shellbench.solvers.fem.algebra.factor import Factor, Front
from shellbench.solvers.fem.mesh.basis import COMPONENTS
from shellbench.solvers.fem.mesh.mesh import TensorMesh

HALVES = 2  # lines of the fine grid a cell


def dissect_cells(mesh: TensorMesh) -> Dissection:
    """Return the elimination order of the single degrees of freedom of a mesh."""
    # 1. Dissect the fine grid of vertices, sides and insides; only lines of vertices cut.
    # 2. Replace each of its points by the degrees of freedom that belong to it.
    closed = mesh.domain.periodic
    first, second = (HALVES * n - (not seam) for n, seam in zip(mesh.shape, closed, strict=True))
    grid = Dissection.from_shape((first, second), closed, every=HALVES)
    kinds = mesh.kinds
    i, j = np.divmod(grid.order, second)
    bases = ((i // HALVES) * mesh.shape[1] + j // HALVES) * COMPONENTS * len(kinds)
    local = {}  # by whether there is a bubble along either coordinate
    for halves in product((False, True), repeat=2):
        numbers = np.array([n for n, (k, m) in enumerate(kinds) if (k > 1, m > 1) == halves])
        local[halves] = (np.arange(COMPONENTS)[:, None] * len(kinds) + numbers).ravel()
    between = zip(i % HALVES > 0, j % HALVES > 0, strict=True)
    dofs = [base + local[bool(k), bool(m)] for base, (k, m) in zip(bases, between, strict=True)]
    lengths = np.array([len(d) for d in dofs])
    starts = np.concatenate([[0], np.cumsum(lengths)])
    parts = []
    for part in grid.parts:
        counts = lengths[part.ring]  # of consecutive degrees of freedom, each run from the start of its point
        shifts = starts[part.ring] - (np.cumsum(counts) - counts)
        ring = np.arange(counts.sum()) + np.repeat(shifts, counts)
        parts.append(Part((int(starts[part.own[0]]), int(starts[part.own[1]])), ring, part.children))
    return Dissection(np.concatenate(dofs), tuple(parts))


def factorise_cells(matrix: CellMatrices, dissection: Dissection) -> Factor:
    """Factorise a positive definite matrix.

    Raises
    ------
    NotPositiveDefiniteError
        If a pivot is not positive.
    MemoryError
        If the fronts do not fit.
    """
    rank = np.empty(matrix.count, dtype=np.int64)
    rank[dissection.order] = np.arange(len(dissection.order))
    ranks = rank[matrix.dofs]
    owners = np.searchsorted([part.own[0] for part in dissection.parts], ranks.min(axis=1), side="right") - 1
    entering: dict[int, list[int]] = {}
    for cell, owner in enumerate(owners):
        entering.setdefault(int(owner), []).append(cell)
    schur: dict[int, Array] = {}
    pivots, coupling = [], []
    for number, part in enumerate(dissection.parts):
        front = Front(part, 1, _sum(part, matrix, ranks, entering[number]) if number in entering else None)
        for child, runs in zip(part.children, dissection.runs[number], strict=True):
            front.add_schur(schur.pop(child), runs)
        pivot, schur[number] = front.eliminate("required")
        pivots.append(pivot)
        coupling.append(front.coupling)
    return Factor(dissection, tuple(pivots), tuple(coupling), 1)


def _sum(part: Part, matrix: CellMatrices, ranks: Integers, cells: Sequence[int]) -> Array:
    """Return the sum of the matrices of cells as the dense matrix of a part, its own unknowns first."""
    size = part.own[1] - part.own[0] + len(part.ring)
    dense = np.zeros((size, size))
    flat = dense.reshape(-1)
    for cell, place in zip(cells, places_in_front(part, ranks[cells]), strict=True):
        flat[(place[:, None] * size + place).ravel()] += matrix.of_cell(cell).ravel()  # no place occurs twice in a cell
    return dense
