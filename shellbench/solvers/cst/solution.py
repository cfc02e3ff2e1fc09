"""The answer of a triangle mesh: piecewise linear in space, and in time between its steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch, touch_at_vertices
from shellbench.problems.shell.solution import SLACK, Arrays, ShellSolution, Words, state_number, time_reached
from shellbench.solvers.cst.mesh import TriangleMesh
from shellbench.solvers.cst.problem import TriangleProblem

Array = NDArray[np.float64]

RECENT = 8  # fields that are kept at hand


@dataclass(frozen=True)
class CstSolution(ShellSolution):
    """A displacement field on a triangle mesh, at load factors or at times.

    Attributes
    ----------
    case, mesh
        The case that was solved, and its mesh.
    marks
        (k,) load factors, or times from 0 to the last one that was reached, s; increasing.
    frames
        (v, 3, k) displacements of the vertices at the marks, m. They alone count as storage: the mesh follows from the
        settings, and marks are few.
    parameters
        Coordinates of vertices that were solved for.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("cst-hinge, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("frames",)

    case: Case
    mesh: TriangleMesh
    marks: Array
    frames: Array
    parameters: int

    @cached_property
    def problem(self) -> TriangleProblem:
        """The case on the mesh, made again when strains, energies or forces are needed."""
        return TriangleProblem.from_case(self.case, self.mesh)

    def _frames_around(self, at: float | None) -> tuple[int, int, float]:
        """Return the frames before and after a mark, and the weight of the second; InputError for a wrong mark."""
        if self.case.dynamics is None:
            number = state_number(self.case, self.marks, at)
            return number, number, 0.0
        last = float(self.marks[-1])
        mark = time_reached(self.case, last, at)
        nearest = int(np.argmin(np.abs(self.marks - mark)))
        if abs(self.marks[nearest] - mark) <= SLACK * last:
            return nearest, nearest, 0.0
        after = int(np.searchsorted(self.marks, mark))
        before, length = after - 1, float(self.marks[after] - self.marks[after - 1])
        return before, after, (mark - float(self.marks[before])) / length

    def _in_time(self, at: float | None, of: Callable[[int], Array]) -> Array:
        before, after, weight = self._frames_around(at)
        return of(before) if weight == 0 else (1 - weight) * of(before) + weight * of(after)

    def vertices(self, at: float | None = None) -> Array:
        """Return the displacements (v, 3) of the vertices at a mark, or between two times."""
        return self._in_time(at, lambda k: np.asarray(self.frames[..., k]))

    def _velocities_of_step(self, k: int) -> Array:
        """Return the velocities (v, 3) of the step that ended at frame k: backward Euler's own."""
        if k == 0:
            return np.zeros(self.frames.shape[:2])
        return np.asarray((self.frames[..., k] - self.frames[..., k - 1]) / (self.marks[k] - self.marks[k - 1]))

    def _in_space(self, vertices: Array, xi: Array) -> Array:
        triangle, weights = self.mesh.locate(xi)
        return np.asarray(np.einsum("na,nac->nc", weights, vertices[self.mesh.triangles[triangle]]))

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self._in_space(self.vertices(at), xi)

    def velocity_at(self, xi: Array, at: float | None) -> Array:
        """Return the velocity (N, 3) at points (N, 2): that of the step at its end, linear in between."""
        if self.case.dynamics is None:
            return super().velocity_at(xi, at)
        return self._in_space(self._in_time(at, self._velocities_of_step), xi)

    @cached_property
    def _strains(self) -> Callable[[float | None], tuple[Array, Array]]:
        """Strain (t, 3) and change of the hinges' angles (h,), the latest few kept."""

        def strains(at: float | None) -> tuple[Array, Array]:
            u = self.vertices(at)
            return self.problem.elastic.strain(u), self.problem.elastic.hinge_changes(u)

        return lru_cache(maxsize=RECENT)(strains)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2): constant on each triangle.

        The membrane strain is the triangle's own; the bending strain and its energy come from the hinges at its edges
        (see `shellbench.solvers.cst.elements.Hinges.curvature`).
        """
        triangle, _ = self.mesh.locate(xi)
        strain, change = self._strains(at)
        membrane, hinges = self.problem.elastic.membrane, self.problem.elastic.hinges
        match name:
            case "membrane_strain":
                values = membrane.covariant_strain(strain)
            case "bending_strain":
                values = membrane.covariant_strain(hinges.curvature(change, membrane))
            case "membrane_energy_density":
                values = membrane.energy(strain) / membrane.areas
            case _:
                values = hinges.energy_by_triangle(change, membrane) / membrane.areas
        return np.asarray(values[triangle])

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy, J."""
        return self.problem.elastic.energies(self.vertices(at))

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        They hold and move its vertices as prescribed: internal forces and inertia less loads.
        """
        forces = self.problem.supports.share_of_forces(number) * self._in_time(at, self._support_forces)
        arms = self.problem.elastic.rest - centre
        if not self.case.linear:
            arms = arms + self.vertices(at)
        return forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)

    def touch(self, at: float | None = None) -> Touch:
        """Return the contact forces of obstacles on the vertices."""
        return touch_at_vertices(self.case, self.mesh.points, self.mesh.steps, self._in_time(at, self._contact_forces))

    def _contact_forces(self, k: int) -> Array:
        u, dt = self.frames[..., k], float(self.marks[1] - self.marks[0]) if len(self.marks) > 1 else 1.0
        pressing = self.problem.obstacles_at(float(self.marks[k]), dt)
        return pressing.forces(u) if pressing else np.zeros_like(u)

    def _support_forces(self, k: int) -> Array:
        forces = self.problem.internal_forces(self.frames[..., k]) - self.problem.loading.forces(float(self.marks[k]))
        if self.case.obstacles:
            forces = forces - self._contact_forces(k)
        if self.case.dynamics is None or k == 0:
            return forces
        gained = (self._velocities_of_step(k) - self._velocities_of_step(k - 1)) / (self.marks[k] - self.marks[k - 1])
        return np.asarray(forces + self.problem.loading.mass[:, None] * gained)

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data that a file holds beside the case and the history."""
        words = {"cells": list(self.mesh.cells), "diagonal": self.mesh.diagonal}
        return words, {"marks": self.marks, "frames": self.frames}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> CstSolution:
        """Make a solution from the data of a file; ValueError or KeyError if they are inconsistent."""
        mesh = TriangleMesh(case.surface.domain, tuple(words["cells"]), words["diagonal"])
        marks, frames = arrays["marks"], arrays["frames"]
        if frames.shape != (mesh.vertex_count, 3, len(marks)) or not np.all(np.diff(marks) > 0):
            raise ValueError("frames do not fit the mesh and the marks")
        return cls(case, mesh, marks, frames, int(words["parameters"]))
