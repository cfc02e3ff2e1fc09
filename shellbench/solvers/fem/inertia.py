"""Mass and springs: matrices of products of the basis, weighted over the area."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.surface import Surface
from shellbench.solvers.fem.assembly import (
    COMPONENTS,
    NODE_DOFS,
    BlockMatrix,
    Quadrature,
    add_cell_matrices,
    basis_scales,
    chunks,
    neighbour_columns,
)
from shellbench.solvers.fem.kinematics import Midsurface
from shellbench.solvers.fem.mesh import CORNERS, FUNCTIONS, KINDS, TensorMesh, tabulate

Array = NDArray[np.float64]
Density = Callable[[Array], Array]

SPRING_ORDER = 19  # degree to which springs are integrated: an elastic pin may be narrower than a cell


def weighted_products(mesh: TensorMesh, surface: Surface, quadrature: Quadrature, density: Density) -> BlockMatrix:
    """Return the matrix of the integrals over the area of w_c u_c v_c, summed over components.

    Parameters
    ----------
    mesh, surface, quadrature
        What it is integrated on.
    density
        w, of points (n, 2), by component (n, 3).

    Returns
    -------
    BlockMatrix
        In the scaled degrees of freedom.
    """
    table = tabulate(quadrature.points, (0, 0)).reshape(len(quadrature.points), FUNCTIONS)
    products = np.einsum("qi,qj->qij", table, table).reshape(len(table), -1)
    blocks = np.zeros((mesh.node_count, 9, NODE_DOFS, NODE_DOFS))
    shape = (len(CORNERS), len(KINDS))
    for cells in chunks(mesh):
        points, weights = quadrature.on_cells(mesh, cells)
        flat = points.reshape(-1, 2)
        area = Midsurface.at(surface.derivatives(flat, order=2)).area * weights.ravel()
        share = (density(flat) * area[:, None]).reshape(*weights.shape, COMPONENTS)
        scales = basis_scales(mesh, cells).reshape(-1, FUNCTIONS)
        scalar = (np.swapaxes(share, 1, 2) @ products).reshape(-1, COMPONENTS, FUNCTIONS, FUNCTIONS)
        scalar *= scales[:, None, :, None] * scales[:, None, None, :]
        matrices = np.zeros((len(scales), COMPONENTS, FUNCTIONS, COMPONENTS, FUNCTIONS))
        for c in range(COMPONENTS):
            matrices[:, c, :, c] = scalar[:, c]
        add_cell_matrices(blocks, mesh.nodes[cells], matrices.reshape(-1, COMPONENTS, *shape, COMPONENTS, *shape))
    return BlockMatrix(blocks, neighbour_columns(mesh))


def mass_matrix(case: Case, mesh: TensorMesh, quadrature: Quadrature) -> BlockMatrix:
    """Return the consistent mass matrix, kg."""
    density = case.material.areal_density
    return weighted_products(mesh, case.surface, quadrature, lambda points: np.full((len(points), COMPONENTS), density))


def spring_matrix(case: Case, mesh: TensorMesh) -> BlockMatrix:
    """Return the stiffness of the springs, N/m."""
    return weighted_products(mesh, case.surface, Quadrature.of_order(mesh, SPRING_ORDER), case.spring_stiffness)
