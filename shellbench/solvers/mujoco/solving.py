"""Following a motion of MuJoCo's cloth on one grid, frame by frame."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.solvers.mujoco.cloth import Cloth
from shellbench.solvers.mujoco.elasticity import Elasticity
from shellbench.solvers.mujoco.grid import Grid
from shellbench.solvers.mujoco.loading import Loading
from shellbench.solvers.mujoco.march import Frame, Pace, march, usual_step
from shellbench.solvers.mujoco.solution import FlexSolution
from shellbench.solvers.mujoco.solver import FlexSettings

MOST_BYTES = 2**31  # of frames that are kept in memory
GAIN = 2.0  # times the most work that loads have done: energy that only a diverging motion has
NEGLIGIBLE = 1e-12  # strain whose energy may be rounding: relative to D times the area


@dataclass
class _Course:
    """What is known of a motion so far."""

    grid: Grid
    pace: Pace
    tell: ProgressCallback
    figures: Mapping[str, Any]
    began: float = field(default_factory=time.perf_counter)
    frames: list[Frame] = field(default_factory=list)
    history: list[Step] = field(default_factory=list)
    most_work: float = 0.0

    def __post_init__(self) -> None:
        self.elasticity, self.loading = Elasticity(self.grid), Loading(self.grid)
        self.unknowns = int((~self.grid.held).sum())
        material = self.grid.case.material
        self.negligible = NEGLIGIBLE * material.membrane_stiffness * float(self.grid.areas.sum())

    def keep(self, frame: Frame) -> bool:
        """Keep a frame; False if it has more energy than anything has put into it."""
        u, v = frame.displacement, frame.velocity
        kinetic = float(np.sum(self.loading.masses[:, None] * v**2)) / 2
        stored = kinetic + sum(self.elasticity.energies(self.grid.rest + u))
        stored += float(np.sum(self.loading.springs * u**2)) / 2
        self.most_work = max(self.most_work, abs(frame.work))
        if not stored <= GAIN * self.most_work + self.negligible:
            return False
        seconds = time.perf_counter() - self.began
        self.frames.append(frame)
        step = Step(len(self.frames) - 1, seconds, stored - frame.work, self.unknowns, at=frame.at, phase="time")
        if frame.at > 0:
            self.history.append(step)
            self.tell(Progress(len(self.frames) - 1, self.pace.frames, f"{frame.at:.4g} s"))
        return True

    def solution(self) -> FlexSolution:
        """Return the motion as far as it was followed."""
        energies = [step.energy for step in self.history]
        figures = {
            **self.figures,
            "time_step": self.pace.time_step,
            "steps": (len(self.frames) - 1) * self.pace.steps,
            "energy_drift": max(energies, key=abs, default=0.0),
        }
        return FlexSolution(
            self.grid,
            self.frames[-1].at,
            np.stack([frame.displacement for frame in self.frames]),
            np.stack([frame.velocity for frame in self.frames]),
            self.unknowns,
            history=tuple(self.history),
            diagnostics=figures,
        )

    @property
    def partial(self) -> FlexSolution | None:
        """What can be kept of a motion that failed."""
        return self.solution() if len(self.frames) > 1 else None


def solve(case: Case, settings: FlexSettings, progress: ProgressCallback) -> FlexSolution:
    """Follow a motion; see `shellbench.solvers.mujoco.solver.MujocoFlexSolver`."""
    with ThreadpoolController().select(internal_api="openblas").limit(limits=1):  # the matrices are small
        return _follow(case, settings, progress)


def _follow(case: Case, settings: FlexSettings, tell: ProgressCallback) -> FlexSolution:
    assert case.dynamics is not None
    began = time.perf_counter()
    grid = Grid(case, settings.cells)
    loading = Loading(grid)
    wanted = settings.time_step or usual_step(Elasticity(grid), loading, settings.damping)
    pace = Pace.from_rates(case.dynamics.until, settings.frame_rate, wanted)
    size = 2 * (pace.frames + 1) * grid.rest.nbytes
    if size > MOST_BYTES:
        raise InputError(
            f"field 'frame_rate': {pace.frames} frames on this grid take {size / 1e9:.1f} GB, choose fewer"
        )
    staggered = settings.staggered and settings.integrator == "Euler"
    figures = {"cells": list(settings.cells), "integrator": settings.integrator, "staggered": staggered}
    course = _Course(grid, pace, tell, figures, began)
    cloth = Cloth.from_grid(grid, loading, settings.integrator, pace.time_step, settings.damping)
    for frame in march(cloth, loading, settings.integrator, staggered, pace):
        if not course.keep(frame):
            break
    if len(course.frames) <= pace.frames:
        reached = course.frames[-1].at if course.frames else 0.0
        raise SolveFailure(
            f"the motion diverges after {reached:.4g} s: steps of {pace.time_step:.3g} s are too long for the"
            f" integrator {settings.integrator}",
            partial=course.partial,
        )
    return course.solution()
