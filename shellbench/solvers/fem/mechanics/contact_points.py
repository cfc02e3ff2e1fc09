"""The points of a mesh at which gaps to obstacles are evaluated."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch
from shellbench.solvers.fem.algebra.block_matrix import BlockMatrix, add_cell_matrices
from shellbench.solvers.fem.algebra.cell_matrices import CellMatrices
from shellbench.solvers.fem.mechanics.kinematics import Midsurface, stiffness_moduli
from shellbench.solvers.fem.mesh.basis import COMPONENTS, CORNERS, gauss_rule, tabulate
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature, basis_scales, cell_portions

Array = NDArray[np.float64]
Matrix = BlockMatrix | CellMatrices

Flags = NDArray[np.bool_]
# Stiffness of the penalty at a point in contact, in units of the bending stiffness between such points. Each step of
# the multipliers divides gaps by it. A smaller value takes more steps; a larger one costs digits of K.
STIFFNESS = 100.0
# Gaps that are closed: of the largest displacement at rest, of the shell's size in motion. Far below the tolerance of
# contact, 5e-4, and above what a solve leaves.
CLOSED = 1e-8
SOFTER = 1 / 40  # of the penalty, while an edge of contact is far from its place; it moves 2.5 times as far
REACH = 2.0  # cells over which forces make a pressure


@dataclass(frozen=True)
class ContactPoints:
    """The points of a mesh at which the gap is evaluated, m of them in each of c cells.

    Attributes
    ----------
    points
        (c m, 2) in the domain.
    areas
        (c, m) areas of the shell at rest that they represent, m^2.
    values
        (c, m, 4, kinds) basis functions there, in the scaled degrees of freedom.
    stiffness
        (c, m) of the penalty, N/m^3.
    lengths, reach
        See `shellbench.problems.shell.question.contact.Touch`.
    """

    case: Case
    mesh: TensorMesh
    points: Array
    areas: Array
    values: Array
    stiffness: Array
    lengths: Array
    reach: Array

    @classmethod
    def on_mesh(cls, case: Case, mesh: TensorMesh) -> ContactPoints:
        """Choose the points of a mesh."""
        count = mesh.degree - 1
        x, w = gauss_rule(count)
        unit = np.stack(np.meshgrid((x + 1) / 2, (x + 1) / 2, indexing="ij"), axis=-1).reshape(-1, 2)
        one, two = (part.ravel() / 2 for part in np.meshgrid(w, w, indexing="ij"))
        rule = Quadrature(unit, one * two)
        table = tabulate(unit, (0, 0), mesh.basis)
        points, areas, values, stiffness, lengths, longest = [], [], [], [], [], []
        for cells in cell_portions(mesh):
            at, weights = rule.on_cells(mesh, cells)
            flat = at.reshape(-1, 2)
            surface = Midsurface.from_position(case.surface.derivatives(flat, order=2))
            bending = stiffness_moduli(case.surface, case.material, flat)[:, 1].reshape(weights.shape)
            area = surface.area.reshape(weights.shape)
            sides = np.linalg.norm(surface.base, axis=-1).reshape(*weights.shape, 2) * mesh.sizes[cells][:, None]
            points.append(flat)
            areas.append(weights * area)
            values.append(table * basis_scales(mesh, cells)[:, None])
            stiffness.append(STIFFNESS * bending * np.sum((count / sides) ** 4, axis=-1))
            lengths.append((sides * np.stack([one, two], axis=-1)).reshape(-1, 2))
            longest.append(sides.reshape(-1, 2).max(axis=0))
        whole = [np.concatenate(part) for part in (points, areas, values, stiffness, lengths)]
        return cls(case, mesh, whole[0], whole[1], whole[2], whole[3], whole[4], REACH * np.max(longest, axis=0))

    def displacement(self, q: Array) -> Array:
        """Return the displacement (c m, 3) at the points of q (nodes, 12, 1)."""
        nodal = q.reshape(-1, COMPONENTS, len(self.mesh.kinds))[self.mesh.nodes]
        found = np.einsum("cmak,caik->cmi", self.values, nodal, optimize=True)
        return np.asarray(found.reshape(-1, COMPONENTS))

    def nodal_forces(self, forces: Array) -> Array:
        """Return the nodal forces (nodes, 12, 1) of forces (c m, 3), N, at the points."""
        spread = np.einsum("cmak,cmi->caik", self.values, forces.reshape(*self.areas.shape, COMPONENTS), optimize=True)
        result = np.zeros((self.mesh.node_count, COMPONENTS, len(self.mesh.kinds)))
        for corner in range(len(CORNERS)):
            np.add.at(result, self.mesh.nodes[:, corner], spread[:, corner])
        return result.reshape(len(result), -1, 1)

    def with_penalty(self, matrix: Matrix, normals: Array, penalty: Array) -> Matrix:
        """Return a stiffness matrix with the penalty (c m,) of the points in contact, N/m^3, zero at others."""
        stiff = (self.areas * penalty.reshape(self.areas.shape))[..., None]
        cells = np.flatnonzero(np.any(stiff > 0, axis=(1, 2)))
        if not len(cells):
            return matrix
        directions = normals.reshape(*self.areas.shape, COMPONENTS)[cells]
        values = self.values[cells]
        rows = np.einsum("cmi,cmak->cmiak", directions, values).reshape(*values.shape[:2], -1)
        terms = np.swapaxes(rows * stiff[cells], 1, 2) @ rows
        shape = (COMPONENTS, *values.shape[2:])
        terms = terms.reshape(-1, *shape, *shape)
        if isinstance(matrix, CellMatrices):
            stiffened = matrix.with_cells_copied(cells)
            stiffened.add(cells, terms)
            return stiffened
        result = replace(matrix, blocks=matrix.blocks.copy())
        add_cell_matrices(result.blocks, self.mesh.nodes[cells], terms)
        return result

    @cached_property
    def penalty(self) -> Array:
        """(c m,) stiffness of each point, N/m^3."""
        return self.stiffness.ravel()

    def penalty_factors(self) -> Array:
        """Return factors of the penalty, increasing to 1: the first has the length of the shell."""
        size = float(np.ptp(self.case.surface.position(self.points), axis=0).max())
        coarse = size / (self.reach.min() / REACH)
        return np.asarray([SOFTER**k for k in range(math.ceil(-math.log(coarse**4) / math.log(SOFTER)), 0, -1)])

    def nearest_points_of(self, touch: Touch) -> NDArray[np.int64]:
        """Return the numbers (c m,) of the nearest points of another mesh."""
        _, nearest = cKDTree(touch.points / self.mesh.domain.size).query(self.points / self.mesh.domain.size)
        return np.asarray(nearest)

    def pressed_near(self, touch: Touch) -> Flags:
        """Return a mask (c m,) of the points that are nearest to pressed points of another mesh."""
        return np.asarray(np.any(touch.forces[self.nearest_points_of(touch)] != 0, axis=-1))

    def touch(self, forces: Array) -> Touch:
        """Return forces (c m, 3) at the points as contact."""
        return Touch(self.points, forces, self.lengths, self.reach)
