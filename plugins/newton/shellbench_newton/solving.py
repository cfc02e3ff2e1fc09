"""Steps of newton's solvers: motions, and cloth that comes to rest; their solution.

At rest, vertices weigh 1 kg/m^2 whatever the case says, and velocities are set to zero whenever the kinetic energy
falls (kinetic damping, Cundall 1976): mass and damping change the way to rest, and not the place.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import Arrays, ShellSolution, Words, state_number, time_reached
from shellbench_newton.cloth import Cloth, Kind
from shellbench_newton.solver import ClothSettings

Array = NDArray[np.float64]

SAFETY = 0.5  # of the longest stable step of the explicit rule
LOOK = 25  # steps between looks at the kinetic energy
AT_REST = 1e-4  # of the largest displacement: its change over a tenth of the steps done, below which a cloth is at rest
MOST_FRAMES_BYTES = 2**31


def usual_step(cloth: Cloth) -> float:
    """Return a step, s, that is stable by the largest row sums of triangles and hinges as springs."""
    material = cloth.material
    stretch = material.youngs_modulus * material.thickness / (1 - material.poissons_ratio**2)
    size = np.array([np.ptp(cloth.flat[:, k]) / cloth.cells[k] for k in (0, 1)])
    close = float(np.sum(1 / size**2))
    density = float(cloth.masses.sum() / cloth.areas.sum())
    highest = (4 * stretch * close + 16 * material.bending_stiffness * close**2) / density
    return SAFETY * 2 / float(np.sqrt(highest))


class Run:
    """A running cloth of newton.

    Parameters
    ----------
    cloth, kind
        The cloth, and newton's solver.
    iterations
        Of each step.
    """

    def __init__(self, cloth: Cloth, kind: Kind, iterations: int) -> None:
        """Build the model and the solver."""
        import newton
        import warp as wp

        self.cloth, self._wp, self._pad = cloth, wp, len(cloth.hinges[2])
        model = cloth.model(kind)
        solvers = newton.solvers
        if kind == "vbd":
            self.solver: Any = solvers.SolverVBD(model, iterations=iterations)
        elif kind == "xpbd":
            self.solver = solvers.SolverXPBD(model, iterations=iterations)
        elif kind == "style3d":
            config = solvers.SolverStyle3D.Config(iterations=iterations)
            self.solver = solvers.SolverStyle3D(model, config=config)
            self.solver.collision = None
        else:
            self.solver = solvers.SolverSemiImplicit(model, enable_tri_contact=False)
        self._states = model.state(), model.state()
        self._control = model.control()

    def put(self, places: Array, velocities: Array) -> None:
        """Set places (v, 3) and velocities (v, 3) of the vertices."""
        ghosts = self.cloth.hinges[2]
        self._states[0].particle_q.assign(np.concatenate([places, ghosts]).astype(np.float32))
        self._states[0].particle_qd.assign(np.concatenate([velocities, 0 * ghosts]).astype(np.float32))

    def load(self, forces: Array) -> None:
        """Set dead forces (v, 3), N."""
        padded = np.concatenate([forces, np.zeros((self._pad, 3))]).astype(np.float32)
        self._forces = self._wp.array(padded, dtype=self._wp.vec3, device="cpu")

    def step(self, length: float, count: int = 1) -> None:
        """Advance by steps of a length, s."""
        for _ in range(count):
            old, new = self._states
            self._wp.copy(old.particle_f, self._forces)  # the explicit rule adds its own to them
            self.solver.step(old, new, self._control, None, length)
            self._states = new, old

    @property
    def places(self) -> Array:
        """(v, 3) places of the vertices, m."""
        return np.asarray(self._states[0].particle_q.numpy()[: len(self.cloth.flat)], float)

    @property
    def velocities(self) -> Array:
        """(v, 3) velocities of the vertices, m/s."""
        return np.asarray(self._states[0].particle_qd.numpy()[: len(self.cloth.flat)], float)


def _motion(run: Run, step: float, frames: int, until: float) -> Iterator[tuple[float, Array, Array, bool]]:
    apart = until / frames
    for number in range(frames):
        run.load(run.cloth.deck((number + 0.5) * apart).forces[:, :3])
        run.step(step, round(apart / step))
        yield (number + 1) * apart, run.places, run.velocities, True


def _rest(run: Run, step: float, most: int) -> Iterator[tuple[float, Array, Array, bool]]:
    rest, masses = run.cloth.mesh.nodes, run.cloth.masses
    for mark in run.cloth.case.states:
        run.load(run.cloth.deck(mark).forces[:, :3])
        before, done, settled, told = 0.0, 0, False, (0, run.places)
        while done < most and not settled:
            run.step(step, LOOK)
            done += LOOK
            energy = float(masses @ np.sum(run.velocities**2, axis=1))
            if energy < before:
                run.put(run.places, np.zeros_like(rest))
                energy = 0.0
            before = energy
            if done >= 1.1 * told[0] + 20 * LOOK:
                places = run.places
                change, size = np.abs(places - told[1]).max(), np.abs(places - rest).max()
                settled, told = bool(change <= AT_REST * size), (done, places)
        yield mark, run.places, np.zeros_like(rest), settled


def solve(case: Case, kind: Kind, settings: ClothSettings, progress: ProgressCallback) -> ClothSolution:
    """Solve a case; see `shellbench_newton.solver.ClothSolver`."""
    import warp as wp

    wp.config.quiet = True
    began, cloth = time.perf_counter(), Cloth(case, settings.cells, settings.cut)
    step = settings.time_step or usual_step(cloth)
    run, rest = Run(cloth, kind, settings.iterations), cloth.mesh.nodes
    if case.dynamics is None:
        total, course = len(case.states), _rest(run, step, settings.steps)
        marks, moved, rates = [], [], []
    else:
        total = max(1, round(case.dynamics.until * settings.frame_rate))
        if 2 * (total + 1) * rest.nbytes > MOST_FRAMES_BYTES:
            raise InputError(f"field 'frame_rate': {total} frames of {len(rest)} vertices are too many to keep")
        apart = case.dynamics.until / total
        step = apart / max(1, int(np.ceil(apart / step - 1e-9)))  # a whole number of steps from frame to frame
        course = _motion(run, step, total, case.dynamics.until)
        marks, moved, rates = [0.0], [0 * rest], [0 * rest]
    history: list[Step] = []
    restless: list[float] = []
    free = 3 * int((~cloth.held).sum())

    def found() -> ClothSolution:
        words = {
            "cells": list(settings.cells),
            "cut": settings.cut,
            "time_step": step,
            "iterations": settings.iterations,
        }
        doubt = f"the cloth still moves at a load factor of {restless[0]:g}" if restless else None
        arrays = np.array(marks), np.stack(moved), np.stack(rates)
        return ClothSolution(cloth, *arrays, free, history=tuple(history), diagnostics=words, unsettled=doubt)

    for mark, places, velocities, settled in course:
        if not np.all(np.isfinite(places)) or np.abs(places).max() > 1e6:
            partial = found() if marks else None
            raise SolveFailure(f"the cloth diverges before {mark:.4g}, with steps of {step:.3g} s", partial=partial)
        marks, moved, rates = [*marks, mark], [*moved, places - rest], [*rates, velocities]
        restless += [] if settled else [mark]
        spent = time.perf_counter() - began
        history.append(Step(len(history), spent, 0.0, free, at=mark, phase="time" if case.dynamics else "path"))
        progress(Progress(len(history), total, f"{mark:.4g}"))
    return found()


@dataclass(frozen=True)
class ClothSolution(ShellSolution):
    """Places of the vertices, linear on triangles; between frames cubics in time.

    Attributes
    ----------
    cloth
        Case and mesh.
    marks
        (k,) times of the frames, s, or load factors.
    frames, rates
        (k, v, 3) displacements, m, and velocities, m/s.
    parameters
        Coordinates of vertices that are free to move.
    """

    formats: ClassVar[tuple[str | int, ...]] = ("newton cloth, format 1",)
    numbers: ClassVar[tuple[str, ...]] = ("frames", "rates")

    cloth: Cloth
    marks: Array
    frames: Array
    rates: Array
    parameters: int

    @property
    def case(self) -> Case:
        """The solved case."""
        return self.cloth.case

    def _vertices(self, at: float | None) -> tuple[Array, Array]:
        if self.case.dynamics is None:
            number = state_number(self.case, self.marks, at)
            return self.frames[number], self.rates[number]
        when = time_reached(self.case, float(self.marks[-1]), at)
        k = int(np.clip(np.searchsorted(self.marks, when) - 1, 0, len(self.marks) - 2))
        h = self.marks[k + 1] - self.marks[k]
        s = (when - self.marks[k]) / h
        ends = np.stack([*self.frames[k : k + 2], *(h * self.rates[k : k + 2])])
        place = [(1 - s) ** 2 * (1 + 2 * s), s * s * (3 - 2 * s), s * (1 - s) ** 2, s * s * (s - 1)]
        speed = np.array([6 * s * (s - 1), 6 * s * (1 - s), (1 - s) * (1 - 3 * s), s * (3 * s - 2)]) / h
        return np.tensordot(place, ends, axes=1), np.tensordot(speed, ends, axes=1)

    def displacement_at(self, xi: Array, at: float | None) -> Array:
        """Return the displacement (N, 3) at points (N, 2)."""
        return self.cloth.mesh.grid.mesh.interpolate(self._vertices(at)[0], xi)

    def velocity_at(self, xi: Array, at: float | None) -> Array:
        """Return the velocity (N, 3) at points (N, 2)."""
        return self.cloth.mesh.grid.mesh.interpolate(self._vertices(at)[1], xi)

    def field_at(self, name: str, xi: Array, at: float | None) -> Array:
        """Raise InputError: strains are not known."""
        raise InputError(f"{self.case.name}: this solution knows places of vertices only")

    def energies(self, at: float | None = None) -> tuple[float, float]:
        """Raise InputError: energies are not known."""
        raise InputError(f"{self.case.name}: this solution knows places of vertices only")

    def kept(self) -> tuple[Words, Arrays]:
        """Return the data of a file beside the case and the history."""
        words = {"cells": list(self.cloth.cells), "cut": self.cloth.cut}
        return words, {"marks": self.marks, "frames": self.frames, "rates": self.rates}

    @classmethod
    def restored(cls, case: Case, words: Words, arrays: Arrays) -> ClothSolution:
        """Make a solution from the content of a file; ValueError or KeyError if it is inconsistent."""
        cloth = Cloth(case, (int(words["cells"][0]), int(words["cells"][1])), words["cut"])
        if arrays["frames"].shape[1:] != cloth.mesh.nodes.shape or len(arrays["frames"]) != len(arrays["marks"]):
            raise ValueError("frames do not fit the mesh")
        return cls(cloth, arrays["marks"], arrays["frames"], arrays["rates"], int(words["parameters"]))
