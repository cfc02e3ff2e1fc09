"""The answer of a mesh of Kratos' thin quadrilaterals, between its nodes and over the whole shell.

This module also has the displacements in an element's corotating frame, and Kratos' strains of them.

An element's frame has its third axis across both diagonals of the four nodes and is turned about it so that the
displacement gradient in the middle is symmetric, as Kratos' own corotating frame is (after Haugen 1994). Strains
and energies are Kratos' own, at its four integration points of each element.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shellbench.problem import NumberFormat
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words, shortened, state_number
from shellbench.problems.shell.symmetry.symmetry import Part, part_of, whole_of
from shellbench_kratos.thin_elements import DOFS, Elements, SmallStrains
from shellbench_kratos.thin_mesh import QuadMesh, bilinear, held_nodes
from shellbench_kratos.thin_static import ThinProblem

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

POINT = 1 / np.sqrt(3)  # place of the integration points on -1 to 1
CORNER_SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])  # of corners, and of integration points


def _middle_axes(corners: Array) -> Array:
    """Return (e, 3, 3) two middle lines, m, and the unit normal of each quadrilateral (e, 4, 3), as columns."""
    lines = np.einsum("ak,eac->eck", CORNER_SIGNS, corners) / 2
    normal = np.cross(lines[..., 0], lines[..., 1])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.concatenate([lines, normal[..., None]], axis=-1)


def rigid_turns(rest: Array, now: Array) -> Rotation:
    """Return the rotations (e,) that elements' frames make from corners (e, 4, 3) at rest to now."""
    left, _, right = np.linalg.svd(_middle_axes(now) @ np.linalg.inv(_middle_axes(rest)))
    return Rotation.from_matrix(left @ right)


def deformational(rest: Array, values: Array) -> tuple[Array, Array]:
    """Return displacements and rotations (e, 4, 3) of elements' nodes without the rigid motions of their frames.

    Parameters
    ----------
    rest
        (e, 4, 3) corners at rest, m.
    values
        (e, 4, 6) displacements, m, and rotation vectors of the corners.
    """
    arms, now = (x - x.mean(axis=1, keepdims=True) for x in (rest, rest + values[..., :3]))
    back = rigid_turns(arms, now).inv().as_matrix()
    turned = Rotation.from_matrix(np.repeat(back, 4, axis=0)) * Rotation.from_rotvec(values[..., 3:].reshape(-1, 3))
    return np.einsum("eij,eaj->eai", back, now) - arms, turned.as_rotvec().reshape(-1, 4, 3)


@dataclass(frozen=True)
class Deformation:
    """Strains of all elements at one state.

    Attributes
    ----------
    mesh
        Where the elements are.
    frames
        (e, 3, 3) axes of the elements at rest, one a row.
    membrane, bending
        (e, 4, 2, 2) strain, and change of curvature (1/m), at the integration points in those axes.
    """

    mesh: QuadMesh
    frames: Array
    membrane: Array
    bending: Array

    @cached_property
    def _shapes(self) -> Array:
        """(4, 4) coefficients of 1, s, t, st (from -1 to 1) by values at the integration points."""
        s, t = (POINT * CORNER_SIGNS).T
        return np.linalg.inv(np.stack([np.ones(4), s, t, s * t], axis=-1))

    def at(self, points: Array) -> tuple[Array, Array, Array]:
        """Return strain and change of curvature (n, 2, 2) at points (n, 2) of the part, and their axes (n, 3, 3).

        Within an element they are bilinear through the integration points; between elements they jump.
        """
        quad, places = self.mesh.locate(points)
        s, t = 2 * places.T - 1
        weights = np.stack([np.ones_like(s), s, t, s * t], axis=-1) @ self._shapes
        membrane, bending = (np.einsum("na,naij->nij", weights, e[quad]) for e in (self.membrane, self.bending))
        return membrane, bending, self.frames[quad]


@dataclass(frozen=True)
class Gauge:
    """Kratos' elements of a part, ready to be asked for strains."""

    problem: ThinProblem

    @cached_property
    def _rest(self) -> Array:
        return self.problem.positions[self.problem.mesh.quads]

    @cached_property
    def _elements(self) -> SmallStrains:
        return SmallStrains(self._rest, self.problem.part.case.isotropic)

    def measure(self, values: Array) -> Deformation:
        """Return the strains of displacements and rotation vectors (v, 6)."""
        membrane, bending = self._elements.strains(*self._small(values))
        return Deformation(self.problem.mesh, self._elements.frames, membrane, bending)

    def energies(self, values: Array) -> tuple[float, float]:
        """Return membrane and bending energy of the part, J, at displacements and rotation vectors (v, 6)."""
        membrane, bending = self._elements.energies(*self._small(values))
        return float(membrane.sum()), float(bending.sum())

    def _small(self, values: Array) -> tuple[Array, Array]:
        by_corner = values[self.problem.mesh.quads]
        if self.problem.part.case.linear:  # small rigid turns strain no element
            return by_corner[..., :3], by_corner[..., 3:]
        return deformational(self._rest, by_corner)


RECENT = 4  # states whose strains are kept at hand


def mesh_on(part: Part, cells: tuple[int, int]) -> QuadMesh:
    """Return the mesh of a part; a coordinate that closes on itself and that no plane of symmetry cuts stays closed."""
    return QuadMesh(part.lower, part.upper, part.case.surface.domain.periodic, cells)


@dataclass(frozen=True)
class ThinSolution(ShellSolution):
    """Displacements and rotations of nodes at load factors.

    Between nodes the displacement is bilinear in (xi1, xi2), so that it is continuous and has kinks at the elements'
    sides; the element itself has none between its nodes. Strains, and the energy densities that follow from them, are
    Kratos' own at four points of each element and bilinear through them: they jump from element to element.

    Attributes
    ----------
    problem
        The solved part of the case and its mesh, where Kratos computes strains, energies and forces.
    marks
        (k,) load factors, increasing.
    frames
        (v, 6, k) displacements of the nodes, m, and their rotation vectors, at the marks.
    parameters
        Degrees of freedom that were solved for.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("kratos-thin, format 1",)

    problem: ThinProblem
    marks: Array
    frames: Array
    parameters: int

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.problem.part.whole

    @property
    def part(self) -> Part:
        """The part of the shell that was solved."""
        return self.problem.part

    @property
    def mesh(self) -> QuadMesh:
        """The mesh on that part."""
        return self.problem.mesh

    @property
    def storage_bytes(self) -> int:
        """Bytes of the displacements; the mesh follows from the settings, and rotations are not counted."""
        return self.frames[:, :3].size * self.frames.itemsize

    @cached_property
    def _elements(self) -> Elements:
        """Elements that have kept no state but rest; those of a path remember where it led."""
        return Elements(self.problem.positions, self.mesh.quads, self.case.isotropic)

    @cached_property
    def _gauge(self) -> Gauge:
        return Gauge(self.problem)

    def _frame(self, at: float | None) -> int:
        """Return the number of a load factor's frame; InputError if it was not solved."""
        return state_number(self.case, self.marks, at)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        folded = self.part.fold(xi)
        quad, places = self.mesh.locate(folded.points)
        nodal = self.frames[:, :3, self._frame(at)][self.mesh.quads[quad]]
        return np.asarray(np.einsum("na,nac->nc", bilinear(places), nodal) * folded.signs)

    @cached_property
    def _deformation(self) -> Callable[[int], Deformation]:
        return lru_cache(maxsize=RECENT)(lambda k: self._gauge.measure(self.frames[..., k]))

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2).

        Kratos' strains are tensors in an element's plane; they are turned into covariant components with the base
        vectors of the true midsurface.
        """
        folded = self.part.fold(xi)
        membrane, bending, frames = self._deformation(self._frame(at)).at(folded.points)
        tensor = membrane if name.startswith("membrane") else bending
        if name.endswith("energy_density"):
            return self._density(name, tensor)
        x = self.case.surface.derivatives(folded.points, order=1)
        base = np.stack([x[1, 0], x[0, 1]], axis=1)
        in_plane = np.einsum("nac,nic->nai", base, frames[:, :2])
        covariant = np.einsum("nai,nij,nbj->nab", in_plane, tensor, in_plane)
        # a mirror turns one coordinate and one component, so that normals keep their side and only shear changes sign
        shear = covariant[:, 0, 1] * folded.turned.prod(axis=-1)
        return np.stack([covariant[:, 0, 0], covariant[:, 1, 1], shear], axis=-1)

    def _density(self, name: str, tensor: Array) -> Array:
        """Return the energy density (n,) of strains (n, 2, 2), J/m^2.

        D / 2 [(1 - nu) e : e + nu (tr e)^2], with B instead of D in bending (Kairanda et al. 2023, eqs. (17)-(19)).
        """
        material = self.case.isotropic
        nu = material.poissons_ratio
        stiffness = material.membrane_stiffness if name.startswith("membrane") else material.bending_stiffness
        trace = tensor[:, 0, 0] + tensor[:, 1, 1]
        return np.asarray(stiffness / 2 * ((1 - nu) * np.sum(tensor**2, axis=(1, 2)) + nu * trace**2))

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy of the whole shell, J: Kratos' own, summed."""
        membrane, bending = self._gauge.energies(self.frames[..., self._frame(at)])
        return self.part.copies * membrane, self.part.copies * bending

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        They keep its nodes in equilibrium: Kratos' internal forces and moments less the loads.
        """
        k = self._frame(at)
        missing, places = self._unbalanced(k), self.problem.positions
        if not self.case.linear:
            places = places + self.frames[:, :3, k]
        total, moment = np.zeros(3), np.zeros(3)
        for mirrors in self.part.images():
            supported, count = self.part.supported(mirrors), len(self.case.supports)
            held, turned = held_nodes(self.part.case, self.mesh, supported, count)
            share = held[number] / np.maximum(held.sum(axis=0), 1)  # supports that hold a node together bear it alike
            forces, couples, there = share * missing[:, :3], turned[number] * missing[:, 3:], places
            for mirror in mirrors:
                there = mirror.reflected_positions(there)
                forces, couples = forces * mirror.signs, -couples * mirror.signs  # a moment is an axial vector
            total += forces.sum(axis=0)
            moment += (np.cross(there - centre, forces) + couples).sum(axis=0)
        return total, moment

    def _unbalanced(self, k: int) -> Array:
        """Return the forces (v, 6), N and N m, that the nodes lack for equilibrium at a frame."""
        elements, values = self._elements, self.frames[..., k]
        elements.begin()
        if self.case.linear:
            elements.move(np.zeros_like(values[:, :3]), np.zeros_like(values[:, 3:]))
            internal = elements.assemble()[0] @ values.ravel()
        else:
            elements.move(values[:, :3], values[:, 3:])
            internal = elements.assemble()[1]
        return np.asarray(internal.reshape(-1, DOFS) - self.problem.loads.forces(float(self.marks[k])))

    def rounded(self, format: NumberFormat) -> tuple[ThinSolution, int]:
        """Return the solution with displacements rounded to a format, and the bytes that they take."""
        if format == "float64":
            return self, self.storage_bytes
        short = shortened(self.frames[:, :3], format)
        frames = np.concatenate([short.expanded(), self.frames[:, 3:]], axis=1)
        return replace(self, frames=frames), short.nbytes

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data of a file beside the case and the history."""
        words = {"cells": list(self.mesh.cells), "whole": not self.part.mirrors}
        return words, {"marks": self.marks, "frames": self.frames}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> ThinSolution:
        """Make a solution from the content of a file; ValueError or KeyError if it is inconsistent."""
        part = whole_of(case) if words["whole"] else part_of(case)
        mesh = mesh_on(part, (int(words["cells"][0]), int(words["cells"][1])))
        marks, frames = arrays["marks"], arrays["frames"]
        if frames.shape != (mesh.node_count, DOFS, len(marks)) or not np.all(np.diff(marks) > 0):
            raise ValueError("frames do not fit the mesh and the marks")
        return cls(ThinProblem(part, mesh), marks, frames, int(words["parameters"]))
