"""Ties: all conditions at the nodes resolved together, as u = T q + u0."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.conditions import COMPONENTS
from shellbench.solvers.fem.algebra.block_matrix import NEIGHBOURS, BlockMatrix
from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices
from shellbench.solvers.fem.mechanics.sharing import RANK_TOLERANCE, Conditions, Flags, Integers, Sharing
from shellbench.solvers.fem.mesh.mesh import TensorMesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ties:
    """The form q = B z + q0 that satisfies all conditions: z is free where `free`, and zero elsewhere.

    Attributes
    ----------
    nodes
        (k,) nodes with conditions.
    basis
        (k, 12, 12) orthogonal matrices B of these nodes; that of all others is the identity.
    free
        (nodes, 12) mask of z: True for unknowns.
    particular
        (nodes, 12, states) q0.
    sharing
        Division of the forces at these nodes among supports.
    """

    nodes: Integers
    basis: Array
    free: Flags
    particular: Array
    sharing: Sharing

    @classmethod
    def from_conditions(
        cls, case: Case, mesh: TensorMesh, stated: Sequence[Conditions], states: Sequence[float]
    ) -> Ties:
        """Resolve the conditions of all supports of a case.

        Raises
        ------
        InputError
            If supports contradict each other at a common node.
        """
        # 1. Stack all rows R q = r that supports state at a node, padded by zeros to one size.
        # 2. R = U S V^T for all nodes at once. Directions with S above rounding are bound: q0 = V S^-1 U^T r.
        # 3. The others are free. B = V turns a node's degrees of freedom into bound and free ones.
        # 4. Whatever R q0 misses of r is a contradiction between supports.
        # Textbooks eliminate a slave by a master, and have to choose both and an order. The decomposition needs no
        # choice, B is orthogonal, and K keeps its condition number. Penalties would cost the condition number, and
        # multipliers the definiteness.
        nodes = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(c.nodes for c in stated)]))
        counts = np.zeros(len(nodes), dtype=np.int64)
        starts = []
        for condition in stated:
            at = np.searchsorted(nodes, condition.nodes)
            starts.append(counts[at].copy())
            counts[at] += condition.rows.shape[1]
        carried = len(COMPONENTS) * len(mesh.kinds)
        most = int(counts.max(initial=0))
        rows = np.zeros((len(nodes), most, carried))
        values = np.zeros((len(nodes), most, len(states)))
        owners = np.full((len(nodes), most), -1)
        for condition, start in zip(stated, starts, strict=True):
            at = np.searchsorted(nodes, condition.nodes)
            place = start[:, None] + np.arange(condition.rows.shape[1])
            rows[at[:, None], place] = condition.rows
            values[at[:, None], place] = condition.values
            owners[at[:, None], place] = condition.support
        free = np.tile(mesh.used_dofs, len(COMPONENTS))
        particular = np.zeros((mesh.node_count, carried, len(states)))
        basis = np.zeros((len(nodes), carried, carried))
        for group in _dof_groups(mesh.kinds):
            stating = np.flatnonzero(np.any(rows[:, :, group], axis=(0, 2)))
            several = max(len(stating), len(group))
            part, asked = np.zeros((len(nodes), several, len(group))), np.zeros((len(nodes), several, len(states)))
            part[:, : len(stating)], asked[:, : len(stating)] = rows[:, stating][..., group], values[:, stating]
            if mesh.folds:  # numbers that a node does not carry are bound, and do not mix with those that it does
                unused = np.eye(len(group)) * ~free[nodes][:, group][:, :, None]
                part = np.concatenate([part, unused], axis=1)
                asked = np.concatenate([asked, np.zeros((*unused.shape[:2], len(states)))], axis=1)
            left, singular, right = np.linalg.svd(part)
            bound = singular > RANK_TOLERANCE
            inverse = np.where(bound, 1.0 / np.where(bound, singular, 1.0), 0.0)
            known = inverse[..., None] * (np.swapaxes(left, -1, -2)[:, : len(group)] @ asked)
            turned = np.swapaxes(right, -1, -2)
            basis[:, group[:, None], group] = turned
            free[nodes[:, None], group] = ~bound & (free[nodes][:, group] | bool(mesh.folds))
            particular[nodes[:, None], group] = turned @ known
        misfit = np.abs(rows @ particular[nodes] - values)
        if misfit.size and misfit.max() > RANK_TOLERANCE * np.abs(values).max():
            node = nodes[np.unravel_index(np.argmax(misfit), misfit.shape)[0]]
            raise InputError(_contradiction_in_words(case, mesh, stated, int(node)))
        return cls(nodes, basis, free, particular, Sharing.from_conditions(stated, nodes, rows, owners, mesh))

    def with_pins(self, nodes: Integers, dofs: Integers) -> Ties:
        """Return the same ties with further single degrees of freedom, of untied nodes, held at zero."""
        free = self.free.copy()
        free[nodes, dofs] = False
        return replace(self, free=free)

    def to_free(self, vector: Array) -> Array:
        """Return B^T vector (nodes, 12, n), zero where z is not free."""
        result = vector.copy()
        result[self.nodes] = np.swapaxes(self.basis, -1, -2) @ vector[self.nodes]
        return result * self.free[..., None]

    def to_nodal(self, unknowns: Array) -> Array:
        """Return B z (nodes, 12, n)."""
        result = unknowns.copy()
        result[self.nodes] = self.basis @ unknowns[self.nodes]
        return result

    def reduce_cells(self, matrix: CellMatrices) -> CellMatrices:
        """Return the result of `reduce` for a sum of cell matrices.

        The diagonal entry of a degree of freedom that is not free is the number of cells that have it, not 1.
        """
        # Conditions tie the degrees of freedom of one vertex or one side. A cell has all of these or none.
        dofs = matrix.dofs
        carried = self.free.shape[1]
        place = np.full(len(self.free), -1)
        place[self.nodes] = np.arange(len(self.nodes))
        node, dof = np.divmod(dofs, carried)
        tied, free = np.any(place[node] >= 0, axis=1), self.free.ravel()[dofs]
        partly = ~free.all(axis=1)
        result = matrix.with_cells_copied(np.flatnonzero(tied | partly))
        blocks = result.instead
        for at_edge, number in ((k, cell) for k, cell in enumerate(result.changed) if tied[cell]):
            at, own = place[node[number]], dof[number]
            known = self.basis[at[:, None], own[:, None], own]
            turn = np.where(at[:, None] >= 0, known, own[:, None] == own) * (node[number][:, None] == node[number])
            blocks[at_edge] = turn.T @ blocks[at_edge] @ turn
        free = free[result.changed]
        blocks *= free[:, :, None] & free[:, None]
        cell, row = np.nonzero(~free)
        blocks[cell, row, row] = 1.0
        return result

    def reduce(self, matrix: BlockMatrix) -> BlockMatrix:
        """Return B^T K B with the rows and columns of bound unknowns replaced by those of the identity."""
        # 1. B^T K B, block by block: the pattern stays, since conditions tie degrees of freedom of one node only.
        # 2. Zero the bound rows and columns, and put ones on their diagonal.
        # Textbooks remove them. Here they stay, so that all nodes have 12 unknowns, and the dissection's blocks have
        # one size.
        blocks = matrix.blocks.copy()
        blocks[self.nodes] = np.swapaxes(self.basis, -1, -2)[:, None] @ blocks[self.nodes]
        # The additional entry is that of the neighbour -1 beyond the mesh's end: it is tied to nothing.
        place = np.full(len(blocks) + 1, -1)
        place[self.nodes] = np.arange(len(self.nodes))
        row, slot = np.nonzero(place[matrix.columns] >= 0)
        blocks[row, slot] = blocks[row, slot] @ self.basis[place[matrix.columns[row, slot]]]
        partly = np.flatnonzero(~self.free.all(axis=1))
        blocks[partly] *= self.free[partly][:, None, :, None]
        fixed = np.zeros(len(blocks) + 1, dtype=bool)
        fixed[partly] = True
        row, slot = np.nonzero(fixed[matrix.columns])
        blocks[row, slot] *= self.free[matrix.columns[row, slot]][:, None, :]
        node, dof = np.nonzero(~self.free)
        blocks[node, NEIGHBOURS.index((0, 0)), dof, dof] = 1.0
        return BlockMatrix(blocks, matrix.columns)


def _dof_groups(kinds: Sequence[tuple[int, int]]) -> Iterator[Integers]:
    """Yield the degrees of freedom of a node that conditions may tie: of the vertex, and of each bubble on a side."""
    carried = {kind: number for number, kind in enumerate(kinds)}
    most = max(max(kind) for kind in kinds)
    groups = [[kind for kind in kinds if max(kind) < 2]]
    for b in range(2, most + 1):
        groups += [[kind for kind in kinds if kind[axis] == b and kind[1 - axis] < 2] for axis in (1, 0)]
    groups += [[(k, m)] for k, m in kinds if min(k, m) > 1]
    for group in groups:
        numbers = np.array([carried[kind] for kind in group])
        yield (np.arange(len(COMPONENTS))[:, None] * len(kinds) + numbers).ravel()


def _contradiction_in_words(case: Case, mesh: TensorMesh, stated: Sequence[Conditions], node: int) -> str:
    names = sorted({f"'{case.supports[c.support].name}'" for c in stated if node in c.nodes and c.support >= 0})
    where = ", ".join(f"{v:.6g}" for v in mesh.node_points[node])
    who = f"supports {' and '.join(names)} contradict each other" if len(names) > 1 else f"support {names[0]}"
    verb = "" if len(names) > 1 else " contradicts itself"
    return f"{who}{verb} at (xi1, xi2) = ({where}): they prescribe motions that no displacement has"
