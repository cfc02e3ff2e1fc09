"""Supports as prescribed displacements of vertices, and the rigid motions that no support holds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.conditions import RIGID_MOTIONS, Support
from shellbench.problems.shell.places import Edge, Place, Point, Whole
from shellbench.problems.shell.rigid import rigid_modes
from shellbench.solvers.cst.mesh import TriangleMesh

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

CONTRADICTION = 1e-9  # of the surface's size: how far two supports may move one vertex apart


@dataclass(frozen=True)
class Supports:
    """Which displacements are prescribed.

    Attributes
    ----------
    holds
        (supports, v, 3) whether a support prescribes a displacement.
    """

    case: Case
    mesh: TriangleMesh
    holds: NDArray[np.bool_]

    @classmethod
    def from_case(cls, case: Case, mesh: TriangleMesh) -> Supports:
        """Find the held vertices.

        Raises
        ------
        InputError
            If a point that is held lies on no vertex.
        """
        holds = np.zeros((len(case.supports), mesh.vertex_count, 3), dtype=bool)
        for support, place in case.supported_places():
            vertices = vertices_of(place, mesh)
            for component in support.held:
                holds[case.supports.index(support), vertices, "xyz".index(component)] = True
        return cls(case, mesh, holds)

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """(v, 3) whether anything prescribes a displacement."""
        return np.asarray(self.holds.any(axis=0))

    def share(self, number: int) -> Array:
        """Return the share (v, 3) of a support in the forces: those that hold a vertex together bear it alike."""
        return np.asarray(self.holds[number] / np.maximum(self.holds.sum(axis=0), 1))

    @cached_property
    def free(self) -> Integers:
        """Unknowns 3 v + component that nothing prescribes."""
        return np.flatnonzero(~self.held.ravel())

    @cached_property
    def moving(self) -> bool:
        """Whether any support moves."""
        return any(support.motion is not None for support in self.case.supports)

    def prescribe(self, displacement: Array, t: float) -> Array:
        """Return the displacement (v, 3) with what supports prescribe at a time or load factor.

        Raises
        ------
        InputError
            If two supports move a vertex that they share to different places.
        """
        result = np.where(self.held, 0.0, displacement)
        set_by = np.where(self.held, np.nan, 0.0)
        size = np.ptp(self.case.surface.position(self.mesh.domain.grid(3, 3)).reshape(-1, 3), axis=0).max()
        for support, place in self.case.supported_places():
            vertices = vertices_of(place, self.mesh)
            moved = self._motion(support, place, vertices, t)
            for component in support.held:
                c = "xyz".index(component)
                if np.nanmax(np.abs(set_by[vertices, c] - moved[:, c]), initial=0.0) > CONTRADICTION * size:
                    raise InputError(
                        f"{self.case.name}: two supports move a vertex on '{place.name}' to different places"
                    )
                result[vertices, c] = set_by[vertices, c] = moved[:, c]
        return result

    def _motion(self, support: Support, place: Place, vertices: Integers, t: float) -> Array:
        if support.motion is None:
            return np.zeros((len(vertices), 3))
        return self.case.motion(support, place, self.mesh.points[vertices], t)[0, 0]


def vertices_of(place: Place, mesh: TriangleMesh) -> Integers:
    """Return the vertices on a place; InputError if a point lies on none."""
    match place:
        case Edge():
            return mesh.edge_vertices(place)
        case Whole():
            return np.arange(mesh.vertex_count)
        case Point(name=name, xi=xi):
            vertex = mesh.vertex_at(xi)
            if vertex is None:
                n1, n2 = mesh.cells
                raise InputError(f"the support at '{name}' lies on no vertex of {n1} x {n2} cells; choose other cells")
            return np.array([vertex])


@dataclass(frozen=True)
class Loose:
    """Rigid motions that nothing holds: pinned while a case is solved, then taken away in the mean over the area.

    Attributes
    ----------
    motions
        (3 v, k) their displacements of the vertices.
    pins
        (k,) unknowns that are held at zero: those that resist the motions best.
    """

    motions: Array
    pins: Integers

    @classmethod
    def from_case(cls, case: Case, supports: Supports) -> Loose:
        """Choose the pins among the free unknowns."""
        names = [RIGID_MOTIONS.index(name) for name in case.remove_rigid_motions]
        modes = rigid_modes(case.surface, supports.mesh.points)[0, 0].reshape(-1, len(RIGID_MOTIONS))[:, names]
        if not names:
            return cls(modes, np.zeros(0, dtype=np.int64))
        _, _, order = qr(modes[supports.free].T, mode="economic", pivoting=True)
        return cls(modes, supports.free[np.sort(order[: len(names)])])

    def removed(self, displacement: Array, areas: Array) -> Array:
        """Return the displacement (v, 3) without its mean part along the motions, vertices weighed by areas (v,)."""
        weighted = self.motions * np.repeat(areas, 3)[:, None]
        part = np.linalg.solve(weighted.T @ self.motions, weighted.T @ displacement.ravel())
        return np.asarray(displacement - (self.motions @ part).reshape(-1, 3))
