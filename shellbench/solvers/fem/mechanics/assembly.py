"""The stiffness matrix of the linear shell, and the forces of its strains.

Mass and springs: matrices of products of the basis, weighted over the area.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.orthotropic import AnyMaterial
from shellbench.problems.shell.question.surface import Surface
from shellbench.solvers.fem.algebra.block_matrix import (
    NEIGHBOURS,
    NODE_DOFS,
    BlockMatrix,
    add_cell_matrices,
    neighbour_columns,
)
from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices, cell_dofs
from shellbench.solvers.fem.mechanics.kinematics import DERIVATIVES, Midsurface, stiffness_moduli, stress_root_operator
from shellbench.solvers.fem.mesh.basis import (
    COMPONENTS,
    CORNERS,
    CUBIC,
    KINDS,
    Derivative,
    kind_scales,
    present_functions,
    tabulate,
)
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature, basis_scales, cell_portions

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


def derivatives_on_cells(
    mesh: TensorMesh,
    cells: slice | Integers,
    quadrature: Quadrature,
    coefficients: Array,
    orders: Sequence[Derivative] = DERIVATIVES,
) -> Array:
    """Return derivatives (points, orders, 3, n) at cells' Gauss points of fields with coefficients (nodes, 3, 4, n)."""
    sizes, count = mesh.sizes[cells], coefficients.shape[-1]
    table = quadrature.table(tuple(orders), mesh.basis)
    scales = kind_scales(sizes, mesh.basis)[:, None, :, None, None]
    local = np.swapaxes(coefficients[mesh.nodes[cells]], 2, 3) * scales
    values = table @ local.reshape(len(local), table.shape[-1], -1)
    steps = np.stack([sizes[:, 0] ** i * sizes[:, 1] ** j for i, j in orders], axis=-1)
    values = values.reshape(len(local), -1, len(orders), COMPONENTS * count) / steps[:, None, :, None]
    return np.asarray(values.reshape(-1, len(orders), COMPONENTS, count))


def stiffness(
    mesh: TensorMesh,
    surface: Surface,
    material: AnyMaterial,
    quadrature: Quadrature,
    roots: Sequence[Array] | None = None,
) -> BlockMatrix | CellMatrices:
    """Assemble the stiffness matrix of the linear shell.

    Parameters
    ----------
    mesh, surface, material
        The mesh, the surface and the material.
    quadrature
        Gauss points of a cell; p + 1 a direction are enough.
    roots
        See `root_operators`; computed if None.

    Returns
    -------
    BlockMatrix or CellMatrices
        In the scaled degrees of freedom, without supports; by cells if the degree is more than 3.
    """
    present = present_functions(mesh.basis)
    unit = [tabulate(quadrature.points, d, mesh.basis) for d in DERIVATIVES]
    table = np.stack([t.reshape(len(t), -1)[:, present] for t in unit], axis=1)
    made = roots or (_root_operator(mesh, cells, surface, material, quadrature) for cells in cell_portions(mesh))
    if mesh.degree > CUBIC:
        size = COMPONENTS * len(present)
        by_cell = np.empty((len(mesh.nodes), size, size))
        for cells, root in zip(cell_portions(mesh), made, strict=True):
            _cell_matrices(mesh, cells, root, table, by_cell[cells])
        return CellMatrices(by_cell, cell_dofs(mesh), present, mesh.node_count * COMPONENTS * len(mesh.kinds))
    blocks = np.zeros((mesh.node_count, len(NEIGHBOURS), NODE_DOFS, NODE_DOFS))
    shape = (COMPONENTS, len(CORNERS), len(KINDS))
    for cells, root in zip(cell_portions(mesh), made, strict=True):
        matrices = _cell_matrices(mesh, cells, root, table)
        add_cell_matrices(blocks, mesh.nodes[cells], matrices.reshape(-1, *shape, *shape))
    return BlockMatrix(blocks, neighbour_columns(mesh))


class InternalForces:
    """The stiffness matrix times displacements, computed from strains: G^T (G q), where K = G^T G.

    In K q the rounding of single products does work on every motion. Here rounding only makes small strains, which do
    no work on motions without strain. The softest motions of a thin shell, or of a tiny cell, are not disturbed.

    Attributes
    ----------
    mesh
        Domain of integration.
    """

    def __init__(self, mesh: TensorMesh, quadrature: Quadrature, roots: Sequence[Array]) -> None:
        self.mesh = mesh
        self._functions = len(CORNERS) * len(mesh.kinds)
        self._table = quadrature.table(DERIVATIVES, mesh.basis)
        self._portions = [
            (cells, root, basis_scales(mesh, cells)) for cells, root in zip(cell_portions(mesh), roots, strict=True)
        ]

    def __call__(self, q: Array) -> Array:
        """Return the nodal forces (nodes, 12, n) of displacements (nodes, 12, n)."""
        result, count, functions = np.zeros_like(q), q.shape[-1], self._functions
        kinds = len(self.mesh.kinds)
        nodal = q.reshape(-1, COMPONENTS, kinds, count)
        for cells, operator, scales in self._portions:
            nodes = self.mesh.nodes[cells]
            weights = scales.reshape(len(nodes), functions, 1, 1)
            local = np.swapaxes(nodal[nodes], 2, 3).reshape(len(nodes), functions, COMPONENTS, count) * weights
            gradients = (self._table @ local.reshape(len(nodes), functions, -1)).reshape(
                -1, len(DERIVATIVES), COMPONENTS, count
            )
            flat = operator.reshape(len(gradients), 6, -1)
            strains = flat @ np.swapaxes(gradients, 1, 2).reshape(len(gradients), -1, count)
            work = (np.swapaxes(flat, 1, 2) @ strains).reshape(-1, COMPONENTS, len(DERIVATIVES), count)
            spread = np.swapaxes(work, 1, 2).reshape(len(nodes), len(self._table), -1)
            forces = (self._table.T @ spread).reshape(len(nodes), len(CORNERS), kinds, COMPONENTS, count)
            forces *= weights.reshape(len(nodes), len(CORNERS), kinds, 1, 1)
            for corner in range(len(CORNERS)):
                result[nodes[:, corner]] += np.swapaxes(forces[:, corner], 1, 2).reshape(
                    len(nodes), COMPONENTS * kinds, count
                )
        return result


def root_operators(mesh: TensorMesh, surface: Surface, material: AnyMaterial, quadrature: Quadrature) -> list[Array]:
    """Return by portion of cells G (cells, points, 18, 5) on the derivatives of the unit cell; K = G^T G.

    It is by root strain and component (slow): see `stress_root_operator`.
    """
    return [_root_operator(mesh, cells, surface, material, quadrature) for cells in cell_portions(mesh)]


def _cell_matrices(mesh: TensorMesh, cells: slice, operator: Array, table: Array, out: Array | None = None) -> Array:
    """Return (cells, f, f): component (slow) and function of the row and of the column, in the order of the table."""
    # 1. Compute the geometry at the Gauss points, and the operator G whose square is twice the energy density.
    # 2. Multiply G by the root of a point's share of the area, on the derivatives of the unit cell.
    # 3. Multiply by the basis functions: a tall matrix of all points of a cell.
    # 4. K = G^T G.
    # The textbook sums B^T C B point by point. The root form has one product a cell, and K is symmetric and positive
    # semidefinite by construction.
    count, per_cell = operator.shape[:2]
    roots = np.empty((count, per_cell, 6 * COMPONENTS, table.shape[-1]))
    # Point by point, each for all cells of the portion: they share the point's table.
    for q in range(per_cell):
        np.matmul(operator[:, q], table[q], out=roots[:, q])
    scales = basis_scales(mesh, cells).reshape(count, -1)[:, present_functions(mesh.basis)]
    roots *= scales[:, None, None]
    flat = roots.reshape(count, per_cell * 6, -1)
    return np.matmul(np.swapaxes(flat, -1, -2), flat, out=out)


def _root_operator(
    mesh: TensorMesh, cells: slice, surface: Surface, material: AnyMaterial, quadrature: Quadrature
) -> Array:
    points, weights = quadrature.on_cells(mesh, cells)
    count, per_cell = weights.shape
    geometry = Midsurface.from_position(surface.derivatives(points.reshape(-1, 2), order=2))
    moduli = stiffness_moduli(surface, material, points.reshape(-1, 2))
    operator = stress_root_operator(geometry, material, moduli)
    sizes = np.repeat(mesh.sizes[cells], per_cell, axis=0)
    steps = np.stack([sizes[:, 0] ** i * sizes[:, 1] ** j for i, j in DERIVATIVES], axis=-1)
    factors = np.sqrt(weights.ravel() * geometry.area)[:, None] / steps
    operator = np.multiply(operator, factors[:, None, None], order="C")
    return np.asarray(operator.reshape(count, per_cell, 6 * COMPONENTS, len(DERIVATIVES)))


Density = Callable[[Array], Array]

SPRING_ORDER = 19  # degree to which springs are integrated: an elastic pin may be narrower than a cell


def product_matrix(
    mesh: TensorMesh, surface: Surface, quadrature: Quadrature, density: Density
) -> BlockMatrix | CellMatrices:
    """Return `weighted_products` of a mesh of any degree; by cells if it is more than 3."""
    if mesh.degree == CUBIC:
        return weighted_products(mesh, surface, quadrature, density)
    blocks = np.concatenate([matrices for _, matrices in _cell_products(mesh, surface, quadrature, density)])
    count = mesh.node_count * COMPONENTS * len(mesh.kinds)
    return CellMatrices(blocks, cell_dofs(mesh), present_functions(mesh.basis), count)


def weighted_products(mesh: TensorMesh, surface: Surface, quadrature: Quadrature, density: Density) -> BlockMatrix:
    """Return the matrix of the integrals over the area of w_c u_c v_c, summed over components, of a cubic mesh.

    Parameters
    ----------
    mesh, surface, quadrature
        Domain of integration.
    density
        w, of points (n, 2), by component (n, 3).

    Returns
    -------
    BlockMatrix
        In the scaled degrees of freedom.
    """
    blocks = np.zeros((mesh.node_count, len(NEIGHBOURS), NODE_DOFS, NODE_DOFS))
    shape = (COMPONENTS, len(CORNERS), len(KINDS))
    for cells, matrices in _cell_products(mesh, surface, quadrature, density):
        add_cell_matrices(blocks, mesh.nodes[cells], matrices.reshape(-1, *shape, *shape))
    return BlockMatrix(blocks, neighbour_columns(mesh))


def _cell_products(
    mesh: TensorMesh, surface: Surface, quadrature: Quadrature, density: Density
) -> Iterator[tuple[slice, Array]]:
    """Yield cells in portions and their matrices (cells, f, f), as `_cell_matrices` orders them."""
    present = present_functions(mesh.basis)
    table = tabulate(quadrature.points, (0, 0), mesh.basis).reshape(len(quadrature.points), -1)[:, present]
    products = np.einsum("qi,qj->qij", table, table).reshape(len(table), -1)
    for cells in cell_portions(mesh):
        points, weights = quadrature.on_cells(mesh, cells)
        flat = points.reshape(-1, 2)
        area = Midsurface.from_position(surface.derivatives(flat, order=2)).area * weights.ravel()
        share = (density(flat) * area[:, None]).reshape(*weights.shape, COMPONENTS)
        scales = basis_scales(mesh, cells).reshape(len(weights), -1)[:, present]
        scalar = (np.swapaxes(share, 1, 2) @ products).reshape(-1, COMPONENTS, len(present), len(present))
        scalar *= scales[:, None, :, None] * scales[:, None, None, :]
        matrices = np.zeros((len(scales), COMPONENTS, len(present), COMPONENTS, len(present)))
        for c in range(COMPONENTS):
            matrices[:, c, :, c] = scalar[:, c]
        yield cells, matrices.reshape(len(scales), COMPONENTS * len(present), -1)


def mass_matrix(case: Case, mesh: TensorMesh, quadrature: Quadrature) -> BlockMatrix:
    """Return the consistent mass matrix, kg."""
    density = case.material.areal_density
    return weighted_products(mesh, case.surface, quadrature, lambda points: np.full((len(points), COMPONENTS), density))


def spring_matrix(case: Case, mesh: TensorMesh) -> BlockMatrix:
    """Return the stiffness of the springs, N/m."""
    return weighted_products(mesh, case.surface, Quadrature.of_order(mesh, SPRING_ORDER), case.spring_stiffness)


def spring_blocks(case: Case, mesh: TensorMesh) -> Array:
    """Return the blocks of springs, to be added to those of `stiffness`, N/m."""
    if mesh.degree == CUBIC:
        return spring_matrix(case, mesh).blocks
    quadrature = Quadrature.of_order(mesh, SPRING_ORDER)
    return np.concatenate([m for _, m in _cell_products(mesh, case.surface, quadrature, case.spring_stiffness)])
