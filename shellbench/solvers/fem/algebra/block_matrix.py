"""Matrices in blocks: 12 x 12 numbers for every pair of neighbouring nodes.

A node has twelve degrees of freedom, three Cartesian components (slow) by four `KINDS` (fast), each derivative times
the local length of the mesh. On a tensor mesh a node has nine neighbours, itself included, so the matrix is an array
(nodes, 9, 12, 12) whose pattern never changes, and assembly is sixteen additions without any sorting.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from shellbench.solvers.fem.mesh.basis import COMPONENTS, CORNERS, KINDS
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

NODE_DOFS = COMPONENTS * len(KINDS)
NEIGHBOURS: tuple[tuple[int, int], ...] = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1))


@dataclass(frozen=True)
class BlockMatrix:
    """A symmetric matrix in blocks of nodes.

    Attributes
    ----------
    blocks
        (nodes, 9, 12, 12) by row node, by neighbour in the order of `NEIGHBOURS`, by row and by column.
    columns
        (nodes, 9) node of each neighbour, or -1 where the mesh ends.
    """

    blocks: Array
    columns: Integers

    @property
    def largest(self) -> float:
        """Largest magnitude of an entry; not finite if one is not."""
        return float(np.max([self.blocks.max(), -self.blocks.min()]))

    def to_csr(self) -> sp.csr_matrix:
        """Return the matrix (12 nodes, 12 nodes), explicit zeros included."""
        present = self.columns >= 0
        starts = np.concatenate([[0], np.cumsum(present.sum(axis=1))])
        return sp.bsr_matrix((self.blocks[present], self.columns[present], starts)).tocsr()

    def __matmul__(self, vector: Array) -> Array:
        """Multiply vectors (nodes, 12, n)."""
        result = np.zeros_like(vector)
        for slot in range(len(NEIGHBOURS)):
            rows = np.flatnonzero(self.columns[:, slot] >= 0)
            result[rows] += self.blocks[rows, slot] @ vector[self.columns[rows, slot]]
        return result


def neighbour_columns(mesh: TensorMesh) -> Integers:
    """Return the nodes (nodes, 9) around each node, -1 where the mesh ends."""
    first, second = np.divmod(np.arange(mesh.node_count), mesh.shape[1])
    columns = np.empty((mesh.node_count, len(NEIGHBOURS)), dtype=np.int64)
    for slot, offset in enumerate(NEIGHBOURS):
        inside = np.ones(mesh.node_count, dtype=bool)
        index = []
        for axis, at in enumerate((first, second)):
            moved = at + offset[axis]
            if not mesh.domain.periodic[axis]:
                inside &= (moved >= 0) & (moved < mesh.shape[axis])
            index.append(moved % mesh.shape[axis])
        columns[:, slot] = np.where(inside, index[0] * mesh.shape[1] + index[1], -1)
    return columns


def add_cell_matrices(blocks: Array, nodes: Integers, matrices: Array) -> None:
    """Add matrices (cells, 3, 4, 4, 3, 4, 4) of different cells with corners `nodes` (cells, 4), in place."""
    for a, (i, j) in enumerate(CORNERS):
        for b, (k, m) in enumerate(CORNERS):
            # Textbooks collect triplets and sort them. On a tensor mesh corners a and b are the same neighbours in
            # every cell. All cells' blocks of this pair go to one slot at once.
            slot = NEIGHBOURS.index((k - i, m - j))
            pair = matrices[:, :, a, :, :, b, :].reshape(-1, NODE_DOFS, NODE_DOFS)
            blocks[nodes[:, a], slot] += pair  # a node is this corner of one cell only: no index repeats
