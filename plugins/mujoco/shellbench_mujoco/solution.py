"""The answer of a cloth: linear on triangles in space, Hermite's cubics between frames in time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.question.contact import Touch, touch_at_vertices
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words, time_reached
from shellbench_mujoco.elasticity import Elasticity
from shellbench_mujoco.grid import Grid, Loading

Array = NDArray[np.float64]

LATEST = 8  # states that are kept at hand


@dataclass(frozen=True)
class FlexSolution(ShellSolution):
    """A motion of a cloth.

    Attributes
    ----------
    grid
        Case and vertices.
    until
        Time of the last frame that was reached, s; frames are equally spaced from 0 on.
    frames, rates
        (k, v, 3) displacements of the vertices, m, and their velocities, m/s; the grid follows from the settings.
    parameters
        Coordinates of vertices that are free to move.
    pressing
        (k, v, 3) forces of obstacles on the vertices, N; None where there are none.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("mujoco-flex, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("frames", "rates")

    grid: Grid
    until: float
    frames: Array
    rates: Array
    parameters: int
    pressing: Array | None = None

    @property
    def case(self) -> Case:
        """The solved case."""
        return self.grid.case

    @cached_property
    def elasticity(self) -> Elasticity:
        """The cloth's elastic energy, for strains, energies and forces."""
        return Elasticity(self.grid)

    def _place(self, at: float | None) -> tuple[int, float, float]:
        """Return the frame before a time, the place between it and the next, 0 to 1, and their distance, s."""
        time = time_reached(self.case, self.until, at)
        spaces = len(self.frames) - 1
        if spaces == 0:
            return 0, 0.0, 1.0
        place = time / self.until * spaces
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

    def vertex_velocities(self, at: float | None) -> Array:
        """Return the velocities (v, 3) of the vertices at a time: the derivative of their displacements."""
        k, s, h = self._place(at)
        if s == 0:
            return np.asarray(self.rates[k])
        change = 6 * s * (1 - s) / h * (self.frames[k + 1] - self.frames[k])
        return np.asarray(change + (1 - s) * (1 - 3 * s) * self.rates[k] + s * (3 * s - 2) * self.rates[k + 1])

    def _between_vertices(self, values: Array, xi: Array) -> Array:
        triangle, weights = self.grid.locate(xi)
        return np.asarray(np.einsum("na,nai->ni", weights, values[self.grid.triangles[triangle]]))

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self._between_vertices(self.vertices(at), xi)

    def velocity_at(self, xi: Array, at: float | None) -> Array:
        """Return the velocity (N, 3) at points (N, 2)."""
        return self._between_vertices(self.vertex_velocities(at), xi)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Return strains (N, 3) or energy densities (N,) at points (N, 2): constant on each triangle."""
        triangle, _ = self.grid.locate(xi)
        return np.asarray(self._fields(name, at)[triangle])

    @cached_property
    def _fields(self) -> Any:
        """Values of `evaluate` by name and time, for each triangle; the latest are cached."""

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
        """Return the energy of stretching and of bending, J (see `shellbench_mujoco.elasticity`)."""
        return self.elasticity.energies(self.grid.rest + self.vertices(at))

    def _pressing(self, at: float | None) -> Array:
        k, s, _ = self._place(at)
        if self.pressing is None:
            return np.zeros_like(self.grid.rest)
        return np.asarray((1 - s) * self.pressing[k] + s * self.pressing[k + (s > 0)])

    def touch(self, at: float | None = None) -> Touch:
        """Return the forces of obstacles on free vertices: the engine's own forces, linear between frames."""
        steps = np.asarray(self.case.surface.domain.size) / self.grid.cells
        return touch_at_vertices(self.case, self.grid.points, steps, self._pressing(at))

    def reaction_at(self, number: int, centre: Array, at: float | None) -> tuple[Array, Array]:
        """Return force (3,) in N and moment (3,) about `centre` in N m that a support exerts on the cloth.

        It keeps its vertices at rest: their elastic forces less their loads. No obstacle presses on them, because the
        engine presses free vertices only. Forces of damping are left out, because the engine does not give them.
        """
        every = [self.grid.held_by(other) for other in range(len(self.case.supports))]
        share = every[number] / np.maximum(np.sum(every, axis=0), 1)
        positions = self.grid.rest + self.vertices(at)
        loads = Loading(self.grid).forces(self.until if at is None else at)
        forces = share * (self.elasticity.forces(positions) - loads)
        return forces.sum(axis=0), np.cross(positions - centre, forces).sum(axis=0)

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data of a file beside the case and the history."""
        words = {"cells": list(self.grid.cells), "until": self.until}
        pressing = {} if self.pressing is None else {"pressing": self.pressing}
        return words, {"frames": self.frames, "rates": self.rates, **pressing}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> FlexSolution:
        """Make a solution from the content of a file; ValueError or KeyError if it is inconsistent."""
        first, second = words["cells"]
        grid = Grid(case, (int(first), int(second)))
        frames, rates = arrays["frames"], arrays["rates"]
        if frames.shape != rates.shape or frames.shape[1:] != grid.rest.shape:
            raise ValueError("frames do not fit the grid")
        until, parameters = float(words["until"]), int(words["parameters"])
        return cls(grid, until, frames, rates, parameters, arrays.get("pressing"))
