"""Pressure that follows the deformed shell: its forces, and their unsymmetric tangent.

With g = a1 x a2 of the deformed surface, a pressure p along the deformed normal does the virtual work

    F(u; v) = int p g . v dxi1 dxi2,    L(u; v, w) = int p v . (w,1 x a2 + a1 x w,2) dxi1 dxi2,

per deformed area, with L its derivative in the direction w. Integration by parts gives, for constant p,

    L(v, w) - L(w, v) = closed integral of p (v x w) . dx over the deformed edge,

which vanishes at held edges. At a free edge it does not: such a load has no potential (Schweizerhof & Ramm 1984,
Displacement dependent pressure loads in nonlinear finite element analyses, Computers & Structures 18).

The tangent therefore is K - A, with K = W'' - (L + L^T) / 2 symmetric and A = (L - L^T) / 2. K is factorised as usual,
and preconditions an iteration for K - A. A acts through the edges only, so that a few products with it suffice.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.solvers.fem.algebra.block_matrix import NODE_DOFS, BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.mechanics.kinematics import cross, cross_matrix
from shellbench.solvers.fem.mechanics.strain_energy import Portion, StrainEnergy
from shellbench.solvers.fem.mesh.basis import COMPONENTS, CORNERS, FUNCTIONS, KINDS, tabulate

Array = NDArray[np.float64]

ROWS, COLUMNS = (1, 2, 3), (4, 5, 6)  # axes of cells' matrices


@dataclass(frozen=True)
class FollowingPressure:
    """All following pressures of a case, on the mesh and the quadrature of its strain energy."""

    case: Case
    energy: StrainEnergy

    @cached_property
    def _points(self) -> tuple[tuple[Array, Array], ...]:
        """By portion: points (n, 2) and their parametric weights (n,)."""
        rules = [self.energy.quadrature.on_cells(self.energy.mesh, p.cells) for p in self.energy.portions]
        return tuple((points.reshape(-1, 2), weights.ravel()) for points, weights in rules)

    @cached_property
    def _values(self) -> Array:
        """(q, 16) values of the unit cell's basis at the Gauss points."""
        unit = self.energy.quadrature.points
        return np.asarray(tabulate(unit, (0, 0)).reshape(len(unit), FUNCTIONS))

    @cached_property
    def _products(self) -> Array:
        """(2 q, 256) values times slopes in each coordinate, of all pairs of the unit cell's functions."""
        unit = self.energy.quadrature.points
        slopes = np.stack([tabulate(unit, d).reshape(len(unit), FUNCTIONS) for d in ((1, 0), (0, 1))], axis=1)
        return np.asarray(np.einsum("qi,qkj->qkij", self._values, slopes).reshape(-1, FUNCTIONS**2))

    def _base_vectors(self, portion: Portion, q: Array) -> tuple[Array, Array]:
        """Return the deformed base vectors a1, a2 (n, 3)."""
        base = portion.reference.base + self.energy.gradients(portion, q)[:, :2]
        return base[:, 0], base[:, 1]

    def forces(self, q: Array, t: float) -> Array:
        """Return the nodal forces (nodes, 12) on a displacement (nodes, 12)."""
        mesh = self.energy.mesh
        forces = np.zeros((mesh.node_count, NODE_DOFS))
        for portion, (points, weights) in zip(self.energy.portions, self._points, strict=True):
            push = (self.case.pressure(points, t) * weights)[:, None] * cross(*self._base_vectors(portion, q))
            local = self._values.T @ push.reshape(len(portion.steps), -1, COMPONENTS) * portion.scales[..., None]
            local = local.reshape(-1, len(CORNERS), len(KINDS), COMPONENTS)
            nodes = mesh.nodes[portion.cells]
            for corner in range(len(CORNERS)):
                forces[nodes[:, corner]] += np.swapaxes(local[:, corner], 1, 2).reshape(-1, NODE_DOFS)
        return forces

    def add_tangent(self, matrix: BlockMatrix, q: Array, t: float) -> None:
        """Subtract the symmetric part of the forces' derivative from a tangent stiffness, in place."""
        for nodes, local in self._derivative(q, t):
            add_cell_matrices(matrix.blocks, nodes, -(local + np.moveaxis(local, ROWS, COLUMNS)) / 2)

    def skew(self, q: Array, t: float) -> BlockMatrix:
        """Return the antisymmetric part A of the forces' derivative."""
        mesh = self.energy.mesh
        blocks = np.zeros((mesh.node_count, 9, NODE_DOFS, NODE_DOFS))
        for nodes, local in self._derivative(q, t):
            add_cell_matrices(blocks, nodes, (local - np.moveaxis(local, ROWS, COLUMNS)) / 2)
        return BlockMatrix(blocks, self.energy.columns)

    def _derivative(self, q: Array, t: float) -> Iterator[tuple[NDArray[np.int64], Array]]:
        """Yield by portion the corners (cells, 4), and the forces' derivative (cells, 3, 4, 4, 3, 4, 4)."""
        for portion, (points, weights) in zip(self.energy.portions, self._points, strict=True):
            pressure = self.case.pressure(points, t) * weights
            yield self.energy.mesh.nodes[portion.cells], self._cell_matrices(portion, q, pressure)

    def _cell_matrices(self, portion: Portion, q: Array, pressure: Array) -> Array:
        """Return L as (cells, 3, 4, 4, 3, 4, 4), for pressures (n,) times parametric weights."""
        # 1. Compute dg = -a2 x w,1 + a1 x w,2 at each point, as matrices on the slopes of the unit cell.
        # 2. Multiply by all products of a value and a slope, and sum over the points of a cell.
        a1, a2 = self._base_vectors(portion, q)
        count = len(portion.steps)
        spread = np.stack([-cross_matrix(a2), cross_matrix(a1)], axis=1) * pressure[:, None, None, None]
        spread = spread.reshape(count, -1, 2, COMPONENTS, COMPONENTS) / portion.steps[:, None, :2, None, None]
        on_points = spread.transpose(0, 3, 4, 1, 2).reshape(count * COMPONENTS**2, -1)
        local = (on_points @ self._products).reshape(count, COMPONENTS, COMPONENTS, FUNCTIONS, FUNCTIONS)
        local = local * portion.scales[:, None, None, :, None] * portion.scales[:, None, None, None, :]
        shape = (COMPONENTS, len(CORNERS), len(KINDS))
        return np.asarray(local.transpose(0, 1, 3, 2, 4).reshape(count, *shape, *shape))
