"""What an element's corotating frame leaves of its displacements, and the strains that Kratos finds there.

An element's frame has its third axis across both diagonals of the four nodes and is turned about it so that the
displacement gradient in the middle is symmetric, as Kratos' own corotating frame is (after Haugen 1994). Strains
and energies are Kratos' own, at its four integration points of each element.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shellbench.solvers.kratos.thin_elements import SmallStrains
from shellbench.solvers.kratos.thin_mesh import QuadMesh
from shellbench.solvers.kratos.thin_static import Problem

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

    problem: Problem

    @cached_property
    def _rest(self) -> Array:
        return self.problem.positions[self.problem.mesh.quads]

    @cached_property
    def _elements(self) -> SmallStrains:
        return SmallStrains(self._rest, self.problem.part.case.material)

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
