"""The strain energy of a deformed mesh with its nodal forces and its tangent stiffness."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.question.orthotropic import AnyMaterial, OrthotropicMaterial
from shellbench.problems.shell.question.surface import Surface
from shellbench.solvers.fem.algebra.block_matrix import NODE_DOFS, BlockMatrix, add_cell_matrices, neighbour_columns
from shellbench.solvers.fem.mechanics.kinematics import (
    DERIVATIVES,
    GRADIENT,
    Deformation,
    Midsurface,
    dot,
    elasticities,
    empty_points_fastest,
    points_fastest,
    stiffness_moduli,
)
from shellbench.solvers.fem.mechanics.orthotropic import StiffeningMembrane, material_strains
from shellbench.solvers.fem.mesh.basis import COMPONENTS, CORNERS, FUNCTIONS, KINDS, tabulate
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature, basis_scales

Array = NDArray[np.float64]

PAIRS = tuple((c, d) for d in range(COMPONENTS) for c in range(d + 1))  # components of the upper triangle
CELLS = 128  # that are integrated at once: their second variations stay in the cache


@dataclass(frozen=True)
class Portion:
    """Some cells of a mesh with the data of their n Gauss points that do not depend on the deformation.

    Attributes
    ----------
    cells
        Slice or numbers of the cells.
    reference
        Geometry at the points.
    stiffness
        (n, 2, 3, 3) elasticity of membrane and bending, times the points' share of the area.
    steps
        (cells, 5) lengths of the cells to the power of each of `DERIVATIVES`.
    scales
        (cells, 16) from the unit cell's basis to the scaled degrees of freedom.
    stiffening, share
        The membrane that stiffens, if any, and the points' share (n,) of the area.
    """

    cells: slice
    reference: Midsurface
    stiffness: Array
    steps: Array
    scales: Array
    stiffening: StiffeningMembrane | None
    share: Array

    def respond(self, strains: Array) -> tuple[Array, Array]:
        """Return the stresses (n, 6) conjugate to strains (n, 6), J, and the energies (2,), membrane and bending, J."""
        stresses = self._linear_stresses(strains)
        work = strains * stresses
        energies = np.array([work[:, :3].sum(), work[:, 3:].sum()]) / 2
        if self.stiffening is not None:
            energy, stress, _ = self.stiffening.respond(strains[:, :3])
            energies[0], stresses[:, :3] = energy @ self.share, stress * self.share[:, None]
        return stresses, energies

    def stiffness_at(self, deformation: Deformation) -> Array:
        """Return the derivative (n, 2, 3, 3) of the stresses by the strains."""
        if self.stiffening is None:
            return self.stiffness
        stiffness = self.stiffness.copy()
        stiffness[:, 0] = self.stiffening.respond(deformation.strains[:, :3])[2] * self.share[:, None, None]
        return stiffness

    def stress_rates(self, deformation: Deformation, rates: Array) -> Array:
        """Return the rates (n, 6) of the stresses at rates (n, 6) of the strains."""
        if self.stiffening is None:
            return self._linear_stresses(rates)
        return (self.stiffness_at(deformation) @ rates.reshape(-1, 2, 3, 1)).reshape(-1, 6)

    def _linear_stresses(self, strains: Array) -> Array:
        stresses = empty_points_fastest(len(strains), 6)
        for part, rows in enumerate((slice(0, 3), slice(3, 6))):
            stresses[:, rows] = dot(self.moduli[:, part], strains[:, None, rows])
        return stresses

    @cached_property
    def moduli(self) -> Array:
        """`stiffness` with the points running fastest in memory."""
        return points_fastest(self.stiffness)


@dataclass(frozen=True)
class StrainedMesh:
    """A deformed mesh.

    Attributes
    ----------
    membrane, bending
        Parts of the strain energy, J.
    forces
        (nodes, 12) first variation of the energy.
    deformations
        By portion.
    stresses
        By portion (n, 6), of the displacement itself.
    """

    membrane: float
    bending: float
    forces: Array
    deformations: tuple[Deformation, ...]
    stresses: tuple[Array, ...]

    @property
    def energy(self) -> float:
        """Strain energy, J."""
        return self.membrane + self.bending


@dataclass(frozen=True)
class StrainEnergy:
    """The strain energy of a shell on a mesh as a function of the scaled degrees of freedom (nodes, 12)."""

    mesh: TensorMesh
    surface: Surface
    material: AnyMaterial
    quadrature: Quadrature

    @cached_property
    def portions(self) -> tuple[Portion, ...]:
        """All cells."""
        return tuple(self._portions())

    def _portions(self) -> Iterator[Portion]:
        mesh, count = self.mesh, len(self.mesh.nodes)
        for start in range(0, count, CELLS):
            cells = slice(start, min(start + CELLS, count))
            points, weights = self.quadrature.on_cells(mesh, cells)
            moduli = stiffness_moduli(self.surface, self.material, points.reshape(-1, 2))
            reference = Midsurface.from_position(self.surface.derivatives(points.reshape(-1, 2), order=2))
            share = weights.ravel() * reference.area
            tensor = elasticities(reference, self.material)
            sizes = mesh.sizes[cells]
            fast = Midsurface(
                *map(points_fastest, (reference.base, reference.normal, reference.second, reference.area))
            )
            yield Portion(
                cells,
                fast,
                tensor * moduli[:, :, None, None] * share[:, None, None, None],
                np.stack([sizes[:, 0] ** i * sizes[:, 1] ** j for i, j in DERIVATIVES], axis=-1),
                basis_scales(mesh, cells).reshape(-1, FUNCTIONS),
                stiffening_membrane(reference, self.material),
                share,
            )

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """(nodes, 9) see `neighbour_columns`."""
        return neighbour_columns(self.mesh)

    @cached_property
    def _table(self) -> Array:
        """(q, 5, 16) derivatives of the unit cell's basis at the Gauss points."""
        unit = self.quadrature.points
        return np.stack([tabulate(unit, d).reshape(-1, FUNCTIONS) for d in DERIVATIVES], axis=1)

    def gradients(self, portion: Portion, q: Array) -> Array:
        """Return the derivatives (n, 5, 3) of a displacement at the points of a portion."""
        # One product for all cells: by function of a cell, and by cell and component.
        nodal = q.reshape(-1, COMPONENTS, len(KINDS))[self.mesh.nodes[portion.cells]].transpose(1, 3, 0, 2)
        count = nodal.shape[2]
        local = nodal.reshape(FUNCTIONS, count, COMPONENTS) * portion.scales.T[:, :, None]
        values = self._table.reshape(-1, FUNCTIONS) @ local.reshape(FUNCTIONS, -1)
        by_cell = values.reshape(-1, len(DERIVATIVES), count, COMPONENTS).transpose(1, 3, 2, 0)
        gradients = by_cell / portion.steps.T[:, None, :, None]
        return np.ascontiguousarray(gradients).reshape(len(DERIVATIVES), COMPONENTS, -1).transpose(2, 0, 1)

    def deform(self, q: Array) -> StrainedMesh:
        """Deform the mesh."""
        forces = np.zeros((self.mesh.node_count, NODE_DOFS))
        energies = np.zeros(2)
        deformations, stresses = [], []
        for portion in self.portions:
            deformation = Deformation.from_gradients(portion.reference, self.gradients(portion, q))
            stress, work = portion.respond(deformation.strains)
            energies += work
            self.add_forces(forces, portion, deformation.first_variation(stress))
            deformations.append(deformation)
            stresses.append(stress)
        return StrainedMesh(float(energies[0]), float(energies[1]), forces, tuple(deformations), tuple(stresses))

    def parts(self, q: Array) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy, J, at half the cost of `deform`."""
        energies = np.zeros(2)
        for portion in self.portions:
            strains = Deformation.from_gradients(portion.reference, self.gradients(portion, q)).strains
            energies += portion.respond(strains)[1]
        return float(energies[0]), float(energies[1])

    def predicted_stresses(self, strained: StrainedMesh, step: Array) -> tuple[Array, ...]:
        """Return the stresses by portion that the strains' first variation predicts after a step (nodes, 12)."""
        predicted = []
        for portion, deformation, stress in zip(self.portions, strained.deformations, strained.stresses, strict=True):
            change = self.gradients(portion, step).reshape(-1, GRADIENT, 1)
            predicted.append(stress + portion.stress_rates(deformation, (deformation.operator @ change)[..., 0]))
        return tuple(predicted)

    def tangent(self, strained: StrainedMesh, stresses: tuple[Array, ...] | None = None) -> BlockMatrix:
        """Return the second variation of the energy.

        `stresses`, by portion, replace the displacement's own in the geometric part (see `problem`).
        """
        blocks = np.zeros((self.mesh.node_count, 9, NODE_DOFS, NODE_DOFS))
        for portion, deformation, stress in zip(
            self.portions, strained.deformations, stresses or strained.stresses, strict=True
        ):
            operator = deformation.operator.reshape(-1, 2, 3, GRADIENT)
            elastic = (portion.stiffness_at(deformation) @ operator).reshape(-1, 6, GRADIENT)
            form = np.swapaxes(deformation.operator, 1, 2) @ elastic
            form += deformation.second_variation(stress)
            add_cell_matrices(blocks, self.mesh.nodes[portion.cells], self._cell_matrices(portion, form))
        return BlockMatrix(blocks, self.columns)

    def _cell_matrices(self, portion: Portion, form: Array) -> Array:
        """Turn forms (n, 15, 15) of the derivatives into matrices (cells, 3, 4, 4, 3, 4, 4) of the cells' freedoms."""
        # 1. Divide the components c <= c' of a form by the cells' lengths; order them so that a point's are one matrix.
        # 2. Multiply by the table from the right, point by point, and from the left, all points at once.
        # 3. Scale; the components c' < c are the transposes.
        count, points, derivatives = len(portion.steps), len(self.quadrature.points), len(DERIVATIVES)
        shares = 1 / (portion.steps[:, None, :, None] * portion.steps[:, None, None, :])
        by_point = form.reshape(count, points, derivatives, COMPONENTS, derivatives, COMPONENTS)
        ordered = np.empty((points, derivatives, len(PAIRS), count, derivatives))
        for k, (c, d) in enumerate(PAIRS):
            np.multiply(by_point[:, :, :, c, :, d], shares, out=ordered[:, :, k].transpose(2, 0, 1, 3))
        half = np.empty((points, derivatives, len(PAIRS), count, FUNCTIONS))
        for q in range(points):
            np.matmul(ordered[q].reshape(-1, derivatives), self._table[q], out=half[q].reshape(-1, FUNCTIONS))
        full = self._table.reshape(-1, FUNCTIONS).T @ half.reshape(points * derivatives, -1)
        scaled = full.reshape(FUNCTIONS, len(PAIRS), count, FUNCTIONS).transpose(1, 2, 0, 3)
        scales = portion.scales[:, :, None] * portion.scales[:, None]
        matrices = np.empty((count, COMPONENTS, FUNCTIONS, COMPONENTS, FUNCTIONS))
        for k, (c, d) in enumerate(PAIRS):
            np.multiply(scaled[k], scales, out=matrices[:, c, :, d])
            if c < d:
                matrices[:, d, :, c] = np.swapaxes(matrices[:, c, :, d], 1, 2)
        shape = (COMPONENTS, len(CORNERS), len(KINDS))
        return matrices.reshape(count, *shape, *shape)

    def add_forces(self, forces: Array, portion: Portion, work: Array) -> None:
        """Add the nodal forces of the stresses (n, 15) conjugate to the derivatives."""
        count, points = len(portion.steps), len(self.quadrature.points)
        by_derivative = work.T.reshape(len(DERIVATIVES), COMPONENTS, count, points)
        scaled = by_derivative / portion.steps.T[:, None, :, None]
        local = self._table.reshape(-1, FUNCTIONS).T @ scaled.transpose(3, 0, 2, 1).reshape(
            points * len(DERIVATIVES), -1
        )
        local = local.reshape(FUNCTIONS, count, COMPONENTS) * portion.scales.T[:, :, None]
        by_corner = local.reshape(len(CORNERS), len(KINDS), count, COMPONENTS).transpose(0, 2, 3, 1)
        nodes = self.mesh.nodes[portion.cells]
        for corner in range(len(CORNERS)):
            forces[nodes[:, corner]] += by_corner[corner].reshape(count, NODE_DOFS)


def stiffening_membrane(surface: Midsurface, material: AnyMaterial) -> StiffeningMembrane | None:
    """Return the membrane of a material that stiffens at the points of a surface; None for a linear one."""
    if not isinstance(material, OrthotropicMaterial) or material.stiffening is None:
        return None
    turn = material_strains(surface.base, surface.normal, surface.contravariant_metric, material)
    return StiffeningMembrane(material, turn)
