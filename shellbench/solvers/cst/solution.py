"""The answer of a triangle mesh: piecewise linear in space, and in time between its steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shellbench.errors import InputError
from shellbench.problem import FIELDS, NumberFormat, Step
from shellbench.problems.rounding import shortened
from shellbench.problems.shell.case import Case
from shellbench.solvers.cst.file import read, write
from shellbench.solvers.cst.mesh import TriangleMesh
from shellbench.solvers.cst.problem import Problem

Array = NDArray[np.float64]

SLACK = 1e-9  # of the last mark, by which a mark may lie beside it
RECENT = 8  # fields that are kept at hand


@dataclass(frozen=True)
class CstSolution:
    """A displacement field on a triangle mesh, at load factors or at times.

    Attributes
    ----------
    case, mesh
        What was solved, and on what.
    marks
        (k,) load factors, or times from 0 to the last one that was reached, s; increasing.
    frames
        (v, 3, k) displacements of the vertices at the marks, m.
    parameters
        Coordinates of vertices that were solved for.
    history, diagnostics, uncertainty, extrapolated
        See `shellbench.problem.Solution`.
    """

    case: Case
    mesh: TriangleMesh
    marks: Array
    frames: Array
    parameters: int
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)

    @property
    def storage_bytes(self) -> int:
        """Bytes of the displacements; the mesh follows from the settings, and marks weigh nothing beside them."""
        return self.frames.nbytes

    @cached_property
    def problem(self) -> Problem:
        """The case on the mesh, made anew where strains, energies or forces are asked for."""
        return Problem.of(self.case, self.mesh)

    def _span(self, at: float | None) -> tuple[int, int, float]:
        """Return the frames before and after a mark, and the weight of the second.

        Raises
        ------
        InputError
            If a motion did not reach it, or a static case was not solved at it.
        """
        last = float(self.marks[-1])
        mark = last if at is None else float(at)
        nearest = int(np.argmin(np.abs(self.marks - mark)))
        if abs(self.marks[nearest] - mark) <= SLACK * max(last, np.finfo(float).tiny):
            return nearest, nearest, 0.0
        if self.case.dynamics is None:
            known = ", ".join(f"{m:g}" for m in self.marks)
            raise InputError(f"{self.case.name}: solved at {known}, not at {mark:g}")
        if not 0 <= mark <= last:
            raise InputError(f"{self.case.name}: solved from 0 to {last:g} s, not at {mark:g} s")
        after = int(np.searchsorted(self.marks, mark))
        before, length = after - 1, float(self.marks[after] - self.marks[after - 1])
        return before, after, (mark - float(self.marks[before])) / length

    def _between(self, at: float | None, of: Callable[[int], Array]) -> Array:
        before, after, weight = self._span(at)
        return of(before) if weight == 0 else (1 - weight) * of(before) + weight * of(after)

    def vertices(self, at: float | None = None) -> Array:
        """Return the displacements (v, 3) of the vertices at a mark, or between two times."""
        return self._between(at, lambda k: np.asarray(self.frames[..., k]))

    def _rate(self, k: int) -> Array:
        """Return the velocities (v, 3) of the step that ended at frame k: backward Euler's own."""
        if k == 0:
            return np.zeros(self.frames.shape[:2])
        return np.asarray((self.frames[..., k] - self.frames[..., k - 1]) / (self.marks[k] - self.marks[k - 1]))

    def _interpolated(self, vertices: Array, points: ArrayLike) -> Array:
        xi = np.asarray(points, dtype=float)
        triangle, weights = self.mesh.locate(xi.reshape(-1, 2))
        values = np.einsum("na,nac->nc", weights, vertices[self.mesh.triangles[triangle]])
        return np.asarray(values.reshape(*xi.shape[:-1], 3))

    def displacement(
        self, points: ArrayLike, at: float | None = None, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3) in metres at points (..., 2)."""
        return self._interpolated(self.vertices(at), points)

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3) in m/s at points (..., 2): that of the step at its end, linear in between."""
        if self.case.dynamics is None:
            return np.zeros((*np.asarray(points).shape[:-1], 3))
        return self._interpolated(self._between(at, self._rate), points)

    @cached_property
    def _strains(self) -> Callable[[float | None], tuple[Array, Array]]:
        """Strain (t, 3) and change of the hinges' angles (h,), the latest few kept."""

        def strains(at: float | None) -> tuple[Array, Array]:
            u = self.vertices(at)
            return self.problem.elastic.strain(u), self.problem.elastic.folding(u)

        return lru_cache(maxsize=RECENT)(strains)

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `shellbench.problem.FIELDS` at points (..., 2): constant on each triangle.

        The membrane strain is the triangle's own; the bending strain and its energy are made of the hinges at its
        edges (see `shellbench.solvers.cst.hinges.Hinges.curvature`).
        """
        if name not in FIELDS:
            raise KeyError(name)
        xi = np.asarray(points, dtype=float)
        triangle, _ = self.mesh.locate(xi.reshape(-1, 2))
        strain, change = self._strains(at)
        membrane, hinges = self.problem.elastic.membrane, self.problem.elastic.hinges
        match name:
            case "membrane_strain":
                values = membrane.covariant(strain)
            case "bending_strain":
                values = membrane.covariant(hinges.curvature(change, membrane))
            case "membrane_energy_density":
                values = membrane.energy(strain) / membrane.areas
            case _:
                values = hinges.energy_by_triangle(change, membrane) / membrane.areas
        return np.asarray(values[triangle].reshape((*xi.shape[:-1], *values.shape[1:])))

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the membrane and the bending part of the strain energy, J."""
        return self.problem.elastic.energies(self.vertices(at))

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the shell.

        They are what its vertices need to be held and moved as they are: internal forces and inertia less loads.
        """
        names = [s.name for s in self.case.supports]
        if support not in names:
            raise InputError(f"{self.case.name}: no support is called '{support}'; known are {', '.join(names)}")
        forces = self.problem.supports.share(names.index(support)) * self._between(at, self._unbalanced)
        arms = self.problem.elastic.rest - np.asarray(centre, dtype=float)
        if not self.case.linear:
            arms = arms + self.vertices(at)
        return forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)

    def _unbalanced(self, k: int) -> Array:
        forces = self.problem.internal(self.frames[..., k]) - self.problem.loading.forces(float(self.marks[k]))
        if self.case.dynamics is None or k == 0:
            return forces
        gained = (self._rate(k) - self._rate(k - 1)) / (self.marks[k] - self.marks[k - 1])
        return np.asarray(forces + self.problem.loading.mass[:, None] * gained)

    def rounded(self, format: NumberFormat) -> tuple[CstSolution, int]:
        """Return the solution with displacements rounded to a format, and the bytes that they take."""
        short = shortened(self.frames, format)
        if short.numbers is self.frames:
            return self, self.storage_bytes
        return replace(self, frames=short.expanded()), short.nbytes

    def save(self, path: Path) -> Path:
        """Write an npz file without pickles; return its path, which ends in .npz."""
        words = {
            "case_name": self.case.name,
            "case": self.case.model_dump(mode="json", exclude_unset=True, exclude={"name"}),
            "cells": list(self.mesh.cells),
            "diagonal": self.mesh.diagonal,
            "parameters": self.parameters,
            "history": [asdict(step) for step in self.history],
            "diagnostics": dict(self.diagnostics),
        }
        return write(path, words, {"marks": self.marks, "frames": self.frames})

    @classmethod
    def load(cls, path: Path) -> CstSolution:
        """Read what `save` wrote; InputError if the file is missing, damaged, or none of this solver."""
        return read(path, cls._assembled)

    @classmethod
    def _assembled(cls, words: Mapping[str, Any], arrays: Mapping[str, Array]) -> CstSolution:
        case = Case.model_validate({**words["case"], "name": words["case_name"]})
        mesh = TriangleMesh(case.surface.domain, tuple(words["cells"]), words["diagonal"])
        marks, frames = arrays["marks"], arrays["frames"]
        if frames.shape != (mesh.vertex_count, 3, len(marks)) or not np.all(np.diff(marks) > 0):
            raise ValueError("frames do not fit the mesh and the marks")
        history = tuple(Step(**step) for step in words["history"])
        return cls(case, mesh, marks, frames, int(words["parameters"]), history, words["diagnostics"])
