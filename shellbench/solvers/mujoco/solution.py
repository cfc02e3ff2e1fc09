"""The answer of a cloth: linear on triangles in space, Hermite's cubics between frames in time."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
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
from shellbench.solvers.mujoco.elasticity import Elasticity
from shellbench.solvers.mujoco.grid import Grid
from shellbench.solvers.mujoco.loading import Loading

Array = NDArray[np.float64]

SLACK = 1e-9  # of the last time, by which a time may lie beyond it
LATEST = 8  # states that are kept at hand
FORMAT = "mujoco-flex, format 1"
BROKEN = (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True)
class FlexSolution:
    """A motion of a cloth.

    Attributes
    ----------
    grid
        Case and vertices.
    until
        Time of the last frame that was reached, s; frames are equally spaced from 0 on.
    frames, rates
        (k, v, 3) displacements of the vertices, m, and their velocities, m/s.
    parameters
        Coordinates of vertices that are free to move.
    history, diagnostics, uncertainty, extrapolated
        See `shellbench.problem.Solution`.
    """

    grid: Grid
    until: float
    frames: Array
    rates: Array
    parameters: int
    history: tuple[Step, ...] = ()
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    extrapolated: Mapping[str, float] = field(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case it answers."""
        return self.grid.case

    @property
    def storage_bytes(self) -> int:
        """Bytes of the frames' displacements and velocities; the grid follows from the settings."""
        return self.frames.nbytes + self.rates.nbytes

    @cached_property
    def elasticity(self) -> Elasticity:
        """The cloth's elastic energy, made anew where strains, energies or forces are asked for."""
        return Elasticity(self.grid)

    def _place(self, at: float | None) -> tuple[int, float, float]:
        """Return the frame before a time, where between it and the next the time lies, 0 to 1, and their distance, s.

        Raises
        ------
        InputError
            If the motion did not reach that time.
        """
        time = self.until if at is None else float(at)
        if not -SLACK * self.until <= time <= (1 + SLACK) * self.until:
            raise InputError(f"{self.case.name}: the motion was followed from 0 to {self.until:g} s, not to {time:g} s")
        spaces = len(self.frames) - 1
        if spaces == 0:
            return 0, 0.0, 1.0
        place = min(max(time / self.until, 0.0), 1.0) * spaces
        before = min(int(place), spaces - 1)
        return before, place - before, self.until / spaces

    def vertices(self, at: float | None = None) -> Array:
        """Return the displacements (v, 3) of the vertices at a time."""
        k, s, h = self._place(at)
        if s == 0:
            return np.asarray(self.frames[k])
        weights = np.array([1 - s * s * (3 - 2 * s), s * s * (3 - 2 * s)]), h * s * (1 - s) * np.array([1 - s, -s])
        ends = self.frames[k : k + 2], self.rates[k : k + 2]
        return np.asarray(sum(np.tensordot(w, x, axes=1) for w, x in zip(weights, ends, strict=True)))

    def vertex_velocities(self, at: float | None = None) -> Array:
        """Return the velocities (v, 3) of the vertices at a time: the derivative of their displacements."""
        k, s, h = self._place(at)
        if s == 0:
            return np.asarray(self.rates[k])
        change = 6 * s * (1 - s) / h * (self.frames[k + 1] - self.frames[k])
        return np.asarray(change + (1 - s) * (1 - 3 * s) * self.rates[k] + s * (3 * s - 2) * self.rates[k + 1])

    def _between_vertices(self, values: Array, points: ArrayLike) -> Array:
        xi = np.asarray(points, dtype=float)
        triangle, weights = self.grid.locate(xi.reshape(-1, 2))
        found = np.einsum("na,nai->ni", weights, values[self.grid.triangles[triangle]])
        return np.asarray(found.reshape(*xi.shape[:-1], 3))

    def displacement(
        self, points: ArrayLike, at: float | None = None, parameters: Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3) in metres at points (..., 2)."""
        return self._between_vertices(self.vertices(at), points)

    def velocity(self, points: ArrayLike, at: float | None = None) -> Array:
        """Return the velocity (..., 3) in m/s at points (..., 2)."""
        return self._between_vertices(self.vertex_velocities(at), points)

    def evaluate(self, name: str, points: ArrayLike, at: float | None = None) -> Array:
        """Return one of `shellbench.problem.FIELDS` at points (..., 2): constant on each triangle."""
        if name not in FIELDS:
            raise KeyError(name)
        xi = np.asarray(points, dtype=float)
        triangle, _ = self.grid.locate(xi.reshape(-1, 2))
        values = self._fields(name, at)
        return np.asarray(values[triangle].reshape((*xi.shape[:-1], *values.shape[1:])))

    @cached_property
    def _fields(self) -> Any:
        """What `evaluate` returns, by name and time, of each triangle; the latest are kept."""

        def of_triangles(name: str, at: float | None) -> Array:
            positions, elasticity = self.grid.rest + self.vertices(at), self.elasticity
            match name:
                case "membrane_strain":
                    return elasticity.covariant(elasticity.strain(positions))
                case "bending_strain":
                    return elasticity.covariant(elasticity.curvature(positions))
                case "membrane_energy_density":
                    return elasticity.stretching(positions) / self.grid.areas
            return elasticity.bending(positions) / self.grid.areas

        return lru_cache(maxsize=LATEST)(of_triangles)

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Return the energy of stretching and of bending, J (see `shellbench.solvers.mujoco.elasticity`)."""
        return self.elasticity.energies(self.grid.rest + self.vertices(at))

    def reaction(
        self, support: str, centre: ArrayLike = (0.0, 0.0, 0.0), at: float | None = None
    ) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the cloth.

        It is what keeps its vertices at rest: their elastic forces less their loads. What damping adds, if a setting
        asks for any, is left out: the engine has no name for it.
        """
        names = [s.name for s in self.case.supports]
        if support not in names:
            raise InputError(f"{self.case.name}: no support is called '{support}'; known are {', '.join(names)}")
        every = [self.grid.held_by(number) for number in range(len(names))]
        share = every[names.index(support)] / np.maximum(np.sum(every, axis=0), 1)
        positions = self.grid.rest + self.vertices(at)
        loads = Loading(self.grid).forces(self.until if at is None else at)
        forces = share * (self.elasticity.forces(positions) - loads)
        return forces.sum(axis=0), np.cross(positions - np.asarray(centre, dtype=float), forces).sum(axis=0)

    def rounded(self, format: NumberFormat) -> tuple[FlexSolution, int]:
        """Return the motion with displacements and velocities rounded to a format, and the bytes that they take."""
        frames, rates = shortened(self.frames, format), shortened(self.rates, format)
        return replace(self, frames=frames.expanded(), rates=rates.expanded()), frames.nbytes + rates.nbytes

    def save(self, path: Path) -> Path:
        """Write an npz file without pickles; return its path, which ends in .npz."""
        target = path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
        words = {
            "format": FORMAT,
            "name": self.case.name,
            "case": self.case.model_dump(mode="json", exclude_unset=True, exclude={"name"}),
            "cells": list(self.grid.cells),
            "until": self.until,
            "parameters": self.parameters,
            "history": [asdict(step) for step in self.history],
            "diagnostics": dict(self.diagnostics),
        }
        np.savez(target, allow_pickle=False, words=np.asarray(json.dumps(words)), frames=self.frames, rates=self.rates)
        return target

    @classmethod
    def load(cls, path: Path) -> FlexSolution:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, damaged, or none of this solver.
        """
        try:
            with np.load(path, allow_pickle=False) as data:
                words, frames, rates = json.loads(str(data["words"])), data["frames"], data["rates"]
            if words["format"] != FORMAT:
                raise ValueError("of another format")
            case = Case.model_validate({**words["case"], "name": words["name"]})
            first, second = words["cells"]
            grid = Grid(case, (int(first), int(second)))
            if frames.shape != rates.shape or frames.shape[1:] != grid.rest.shape:
                raise ValueError("frames do not fit the grid")
            history = tuple(Step(**step) for step in words["history"])
            until, parameters = float(words["until"]), int(words["parameters"])
            return cls(grid, until, frames, rates, parameters, history, words["diagnostics"])
        except OSError as error:
            why = error.strerror or "damaged"
            raise InputError(f"{path}: can't be read as a solution of mujoco-flex ({why})") from None
        except BROKEN:
            raise InputError(f"{path}: is damaged, or not a solution of mujoco-flex") from None
