"""Kratos' thin quadrilaterals on a mesh: their stiffness and forces at a state, their strains and energies.

The element `ShellThinElementCorotational3D4N` joins Felippa's ANDES membrane, whose drilling rotations are stiff by
themselves (no spring is added to them), with the discrete Kirchhoff quadrilateral of Batoz and Ben Tahar (1982): its
limit is the theory of Kirchhoff and Love. Large motions are taken off by a corotating frame, strains are small.
Kratos computes and assembles the elements; the linear systems are not given to the direct solver that its wheels
bring, but to SuperLU with a minimum degree ordering, which is several times faster on these matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from shellbench.problems.shell.question.conditions import Material
from shellbench_kratos.engine import FreshModel, fresh_model, kratos, structural

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

ELEMENT = "ShellThinElementCorotational3D4N"
LAW = "LinearElasticPlaneStress2DLaw"
DOFS = 6  # a node: three displacements, three rotations
MAGNIFIED = 1e9  # displacements and rotations at which Kratos is asked for strains, which it finds linear in them
STEPS_KEPT = 2  # of the nodes' values: this element asks for two


def _components(variable: str) -> list[Any]:
    return [getattr(kratos, f"{variable}_{c}") for c in "XYZ"]


def _model(positions: Array, cells: Integers, material: Material, element: str = ELEMENT, law: str = LAW) -> FreshModel:
    """Return a model of nodes at positions (v, 3) and elements (e, k) between them; Kratos counts from 1."""
    model = fresh_model(kratos.DISPLACEMENT, kratos.ROTATION, kratos.REACTION, kratos.REACTION_MOMENT)
    part = model.part
    part.SetBufferSize(STEPS_KEPT)
    for number, x in enumerate(positions, start=1):
        part.CreateNewNode(number, *(float(c) for c in x))
    properties = part.CreateNewProperties(1)
    properties[kratos.YOUNG_MODULUS] = material.youngs_modulus
    properties[kratos.POISSON_RATIO] = material.poissons_ratio
    properties[kratos.THICKNESS] = material.thickness
    properties[kratos.DENSITY] = 0.0  # gravity comes with the other loads
    properties[kratos.CONSTITUTIVE_LAW] = getattr(structural, law)()
    for number, nodes in enumerate(cells + 1, start=1):
        part.CreateNewElement(element, number, nodes.tolist(), properties)
    for moved, reaction in (("DISPLACEMENT", "REACTION"), ("ROTATION", "REACTION_MOMENT")):
        for dof, force in zip(_components(moved), _components(reaction), strict=True):
            kratos.VariableUtils().AddDof(dof, force, part)
    return model


def _set(part: Any, variable: Any, values: Array) -> None:
    kratos.VariableUtils().SetSolutionStepValuesVector(part.Nodes, variable, kratos.Vector(values.ravel()), 0)


@dataclass(frozen=True)
class Elements:
    """Elements between nodes, whose state Kratos keeps.

    Attributes
    ----------
    positions
        (v, 3) of the nodes at rest, m.
    cells
        (e, k) nodes of each element.
    element, law
        Kratos' names of the element and of its constitutive law; an element of 10.4 crashes with another's law.
    """

    positions: Array
    cells: Integers
    material: Material
    element: str = ELEMENT
    law: str = LAW

    @cached_property
    def _model(self) -> FreshModel:
        return _model(self.positions, self.cells, self.material, self.element, self.law)

    @cached_property
    def _system(self) -> tuple[Any, Any, tuple[Any, Any, Any]]:
        """Kratos' scheme, its builder, and the matrix and vectors that they fill."""
        part = self._model.part
        scheme = kratos.ResidualBasedIncrementalUpdateStaticScheme()
        builder = kratos.ResidualBasedBlockBuilderAndSolver(kratos.SkylineLUFactorizationSolver())
        space = kratos.UblasSparseSpace()
        matrix, step = space.CreateEmptyMatrixPointer(), space.CreateEmptyVectorPointer()
        residual = space.CreateEmptyVectorPointer()
        scheme.Initialize(part)
        scheme.InitializeElements(part)
        builder.SetUpDofSet(scheme, part)
        builder.SetUpSystem(part)
        builder.ResizeAndInitializeVectors(scheme, matrix, step, residual, part)
        return scheme, builder, (matrix, step, residual)

    @cached_property
    def _equations(self) -> Integers:
        """(6 v,) Kratos' equation of each degree of freedom: u_x, u_y, u_z, theta_x, theta_y, theta_z of each node."""
        dofs = _components("DISPLACEMENT") + _components("ROTATION")
        return np.array([[node.GetDof(d).EquationId for d in dofs] for node in self._model.part.Nodes]).ravel()

    @cached_property
    def _pattern(self) -> csr_matrix:
        """Where Kratos keeps each entry of the stiffness, as a matrix in our order of the degrees of freedom."""
        matrix = self._system[2][0]
        columns, starts = np.asarray(matrix.index2_data()), np.asarray(matrix.index1_data())
        numbers = csr_matrix((np.arange(len(columns)), columns, starts), shape=(matrix.Size1(), matrix.Size2()))
        return numbers[self._equations][:, self._equations]

    def begin(self) -> None:
        """Begin a load step at the state that was kept last: at first, rest."""
        scheme, _, system = self._system
        scheme.InitializeSolutionStep(self._model.part, *system)

    def keep(self) -> None:
        """End a load step, and keep its state as the one that the next begins at."""
        scheme, _, system = self._system
        scheme.FinalizeSolutionStep(self._model.part, *system)

    def move(self, displacement: Array, rotation: Array) -> None:
        """Set displacements (v, 3) and rotations (v, 3).

        Kratos turns each node by the rotation vector's difference from the one that was set before, about axes fixed in
        space: the rotation vector is a sum of such turns and, where they are large, of no meaning by itself.
        """
        part = self._model.part
        _set(part, kratos.DISPLACEMENT, displacement)
        _set(part, kratos.ROTATION, rotation)
        kratos.VariableUtils().SetCurrentPositionsVector(
            part.Nodes, kratos.Vector((self.positions + displacement).ravel())
        )
        scheme, _, system = self._system
        scheme.FinalizeNonLinIteration(part, *system)

    def assemble(self) -> tuple[csr_matrix, Array]:
        """Return the tangent stiffness (6 v, 6 v) and the internal forces and moments (6 v,) at the state."""
        scheme, builder, system = self._system
        matrix, _, residual = system
        space = kratos.UblasSparseSpace()
        space.SetToZeroMatrix(matrix)
        space.SetToZeroVector(residual)
        builder.Build(scheme, self._model.part, matrix, residual)
        where = self._pattern
        entries = np.asarray(matrix.value_data())[where.data]
        stiffness = csr_matrix((entries, where.indices, where.indptr), shape=where.shape)
        return stiffness, -np.array(residual)[self._equations]


@dataclass(frozen=True)
class SmallStrains:
    """Strains of elements by themselves, each moved by its own displacements without a rigid turn.

    Kratos' own output of strains and energies assumes small displacements and rotations. Here each element has its own
    four nodes, so that it can get its displacements without its frame's motion.

    Attributes
    ----------
    corners
        (e, 4, 3) positions of each element's nodes at rest, m.
    """

    corners: Array
    material: Material

    @cached_property
    def _model(self) -> FreshModel:
        count = 4 * len(self.corners)
        model = _model(self.corners.reshape(-1, 3), np.arange(count).reshape(-1, 4), self.material)
        for element in model.part.Elements:
            element.SetValue(structural.MATERIAL_ORIENTATION_ANGLE, 0.0)  # strains are told in the element's own axes
            element.Initialize(model.part.ProcessInfo)
        return model

    @cached_property
    def frames(self) -> Array:
        """(e, 3, 3) axes of each element at rest, one a row: those of its strains."""
        axes = (kratos.LOCAL_AXIS_1, kratos.LOCAL_AXIS_2, kratos.LOCAL_AXIS_3)
        info = self._model.part.ProcessInfo
        return np.array(
            [[e.CalculateOnIntegrationPoints(a, info)[0] for a in axes] for e in self._model.part.Elements], dtype=float
        )

    def _move(self, displacement: Array, rotation: Array) -> None:
        _set(self._model.part, kratos.DISPLACEMENT, displacement)
        _set(self._model.part, kratos.ROTATION, rotation)

    def strains(self, displacement: Array, rotation: Array) -> tuple[Array, Array]:
        """Return strain and change of curvature (e, 4, 2, 2) at four points of each element, in its own axes.

        Displacements (e, 4, 3), m, and small rotations (e, 4, 3) are those of each element's nodes. Kratos sets strains
        below 1e-12 to zero. The displacements are therefore scaled up before the call.
        """
        largest = max(float(np.abs(displacement).max()), float(np.abs(rotation).max()))
        factor = 2.0 ** round(np.log2(MAGNIFIED / largest)) if largest > 0 else 1.0
        self._move(factor * displacement, factor * rotation)
        info = self._model.part.ProcessInfo
        found = [
            [e.CalculateOnIntegrationPoints(v, info) for e in self._model.part.Elements]
            for v in (structural.SHELL_STRAIN, structural.SHELL_CURVATURE)
        ]
        membrane, bending = (np.array(tensors, dtype=float)[..., :2, :2] / factor for tensors in found)
        return membrane, bending

    def energies(self, displacement: Array, rotation: Array) -> tuple[Array, Array]:
        """Return membrane and bending energy (e,) of each element, J; Kratos' own energy is twice that."""
        self._move(displacement, rotation)
        info = self._model.part.ProcessInfo
        found = [
            np.array([e.CalculateOnIntegrationPoints(v, info) for e in self._model.part.Elements]).sum(axis=1) / 2
            for v in (structural.SHELL_ELEMENT_MEMBRANE_ENERGY, structural.SHELL_ELEMENT_BENDING_ENERGY)
        ]
        return found[0], found[1]
