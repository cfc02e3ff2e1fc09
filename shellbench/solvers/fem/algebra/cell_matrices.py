"""A symmetric matrix as a sum of dense ones, one for each cell, for meshes of degree 4 and 5."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shellbench.solvers.fem.mesh.basis import COMPONENTS, CORNERS, present_functions
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class CellMatrices:
    """A symmetric matrix as a sum over cells, of a mesh of degree p > 3.

    Attributes
    ----------
    blocks
        (cells, f, f) with f = 3 (p + 1)^2, by component (slow) and by present function of a cell.
    dofs
        (cells, f) numbers of these degrees of freedom among all of the nodes, (nodes, 3 (p - 1)^2) flattened.
    present
        ((p + 1)^2,) see `present_functions`.
    count
        Degrees of freedom of all of the nodes.
    changed, instead
        (k,) increasing numbers of cells, and (k, f, f) matrices that replace their blocks.
    """

    blocks: Array
    dofs: Integers
    present: Integers
    count: int
    changed: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    instead: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))

    def of_cell(self, cell: int) -> Array:
        """Return the matrix (f, f) of a cell."""
        place = int(np.searchsorted(self.changed, cell))
        own = place < len(self.changed) and self.changed[place] == cell
        return np.asarray(self.instead[place] if own else self.blocks[cell])

    def with_cells_copied(self, cells: Integers) -> CellMatrices:
        """Return the same matrix, in which these cells have matrices of their own, `instead`, for changes in place.

        Supports change cells at edges only: a copy of all cells would take longer than their factorisation.
        """
        changed = np.union1d(self.changed, cells)
        instead = np.empty((len(changed), *self.blocks.shape[1:]))
        for place, cell in enumerate(changed):
            instead[place] = self.of_cell(int(cell))
        return replace(self, changed=changed, instead=instead)

    @property
    def largest(self) -> float:
        """Largest magnitude of an entry; not finite if one is not."""
        parts = [part for part in (self.blocks, self.instead) if part.size]
        return float(np.max([(part.max(), -part.min()) for part in parts]))  # Python's max can lose a NaN

    def __matmul__(self, vector: Array) -> Array:
        """Multiply vectors (nodes, 3 (p - 1)^2, n)."""
        flat = vector.reshape(-1, vector.shape[-1])
        products = self.blocks @ flat[self.dofs]
        if len(self.changed):
            products[self.changed] = self.instead @ flat[self.dofs[self.changed]]
        products = products.reshape(-1, flat.shape[1])
        places = self.dofs.ravel()
        columns = [np.bincount(places, weights=column, minlength=len(flat)) for column in products.T]
        return np.asarray(np.stack(columns, axis=-1).reshape(vector.shape), dtype=float)

    def to_csr(self) -> sp.csr_matrix:
        """Return the matrix of all degrees of freedom of the nodes; a degree of freedom without a cell gets a 1."""
        blocks = self.blocks.copy()
        blocks[self.changed] = self.instead if len(self.changed) else 0.0
        rows, columns = (
            np.broadcast_to(d, self.blocks.shape).ravel() for d in (self.dofs[..., None], self.dofs[:, None])
        )
        lonely = np.setdiff1d(np.arange(self.count), self.dofs)
        rows, columns = (np.concatenate([places, lonely]) for places in (rows, columns))
        values = np.concatenate([blocks.ravel(), np.ones(len(lonely))])
        return sp.csr_matrix((values, (rows, columns)), shape=(self.count, self.count))

    def add(self, cells: Integers, matrices: Array) -> None:
        """Add matrices (c, 3, 4, (p - 1)^2, 3, 4, (p - 1)^2) of different cells, in place.

        If some cells have own matrices, the cells of the sum are among them.
        """
        functions = matrices.shape[-1] * len(CORNERS)
        flat = matrices.reshape(len(cells), COMPONENTS, functions, COMPONENTS, functions)
        there = flat[:, :, self.present][..., self.present]
        terms = there.reshape(len(cells), *self.blocks.shape[1:])
        if len(self.changed):
            self.instead[np.searchsorted(self.changed, cells)] += terms
        else:
            self.blocks[cells] += terms


def cell_dofs(mesh: TensorMesh) -> Integers:
    """Return the numbers (cells, 3 (p + 1)^2) of the cells' degrees of freedom among all of the nodes."""
    kinds = len(mesh.kinds)
    corner, kind = np.divmod(present_functions(mesh.basis), kinds)
    scalar = mesh.nodes[:, corner] * COMPONENTS * kinds + kind
    return np.asarray((scalar[:, None] + np.arange(COMPONENTS)[:, None] * kinds).reshape(len(scalar), -1))
