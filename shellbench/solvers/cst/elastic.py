"""The elastic shell: triangles and hinges together, and springs, as sums over vertices."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from shellbench.problems.shell.case import Case
from shellbench.solvers.cst.hinges import Hinges
from shellbench.solvers.cst.membrane import Membrane
from shellbench.solvers.cst.mesh import TriangleMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Elastic:
    """Membrane and bending of a mesh; strains linearised or not.

    Attributes
    ----------
    rest
        (v, 3) positions of the vertices at rest.
    """

    rest: Array
    membrane: Membrane
    hinges: Hinges
    linear: bool

    @classmethod
    def from_case(cls, case: Case, mesh: TriangleMesh) -> Elastic:
        """Put a mesh on a case's midsurface."""
        rest = case.surface.position(mesh.domain.wrap(mesh.points))
        membrane = Membrane.from_mesh(mesh, rest, case.material)
        return cls(rest, membrane, Hinges.from_mesh(mesh, rest, membrane, case.material), case.linear)

    def strain(self, displacement: Array) -> Array:
        """Return the membrane strain (t, 3) of vertex displacements (v, 3)."""
        if self.linear:
            return self.membrane.linear_strain(displacement)
        return self.membrane.strain(self.rest + displacement)

    def folding(self, displacement: Array) -> Array:
        """Return the change (h,) of the hinges' angles, radians."""
        if self.linear:
            return self.hinges.linear_change(displacement)
        return self.hinges.change(self.rest + displacement)

    def energies(self, displacement: Array) -> tuple[float, float]:
        """Return the membrane and the bending energy, J."""
        membrane = self.membrane.energy(self.strain(displacement)).sum()
        return float(membrane), float(self.hinges.energy(self.folding(displacement)).sum())

    def gradient(self, displacement: Array) -> Array:
        """Return the derivative (v, 3) of the energy by the vertices: the forces that hold them so, N."""
        if self.linear:
            stress = self.strain(displacement) @ self.membrane.elasticity * self.membrane.areas[:, None]
            stretching = np.einsum("tsk,ts->tk", self.membrane.rest_operator, stress)
            moment = 2 * self.hinges.stiffness * self.folding(displacement)
            bending = moment[:, None] * self.hinges.rest_gradient
        else:
            positions = self.rest + displacement
            stretching, bending = self.membrane.gradient(positions), self.hinges.gradient(positions)
        total = np.zeros_like(self.rest)
        np.add.at(total, self.membrane.triangles, stretching.reshape(-1, 3, 3))
        np.add.at(total, self.hinges.vertices, bending.reshape(-1, 4, 3))
        return total

    def tangent_values(self, displacement: Array, definite: bool = False) -> Array:
        """Return the entries of all elements' second derivatives, in the order that `entries` names their places.

        In linear theory they are those at rest, whatever the displacement.
        """
        positions = self.rest if self.linear else self.rest + displacement
        blocks = self.membrane.hessian(positions, definite), self.hinges.hessian(positions, definite)
        return np.concatenate([block.ravel() for block in blocks])

    @cached_property
    def entries(self) -> tuple[Integers, Integers]:
        """Rows and columns of `tangent_values` among the unknowns 3 v + component."""
        rows, columns = [], []
        for vertices in (self.membrane.triangles, self.hinges.vertices):
            unknowns = (3 * vertices[:, :, None] + np.arange(3)).reshape(len(vertices), -1)
            full = (*unknowns.shape, unknowns.shape[1])
            rows.append(np.broadcast_to(unknowns[:, :, None], full).ravel())
            columns.append(np.broadcast_to(unknowns[:, None, :], full).ravel())
        return np.concatenate(rows), np.concatenate(columns)


@dataclass(frozen=True)
class Pattern:
    """Where the elements' entries go in the sparse matrix of the free unknowns.

    Attributes
    ----------
    free
        (n,) unknowns 3 v + component that the matrix is made of.
    kept
        Which entries lie in it.
    slots
        (k,) places of these among the matrix' values.
    diagonal
        (n,) places of the diagonal there.
    indices, starts
        Of scipy's compressed columns.
    """

    free: Integers
    kept: Integers
    slots: Integers
    diagonal: Integers
    indices: Integers
    starts: Integers

    @classmethod
    def from_elastic(cls, elastic: Elastic, free: Integers) -> Pattern:
        """Find the pattern of the matrix of free unknowns."""
        number = np.full(elastic.rest.size, -1)
        number[free] = np.arange(len(free))
        rows, columns = (number[index] for index in elastic.entries)
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))
        own = np.arange(len(free))
        keys = np.concatenate([columns[kept] * len(free) + rows[kept], own * len(free) + own])
        places, slots = np.unique(keys, return_inverse=True)
        starts = np.searchsorted(places, np.arange(len(free) + 1) * len(free))
        slots = slots.ravel()
        return cls(free, kept, slots[: len(kept)], slots[len(kept) :], places % len(free), starts)

    def matrix(self, values: Array, diagonal: Array) -> csc_array:
        """Return the matrix (n, n) of the elements' values, with a diagonal (n,) added."""
        data = np.zeros(len(self.indices)) + np.bincount(self.slots, values[self.kept], len(self.indices))
        np.add.at(data, self.diagonal, diagonal)
        return csc_array((data, self.indices, self.starts), shape=(len(self.free), len(self.free)))
