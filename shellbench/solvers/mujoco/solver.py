"""The solver `mujoco-flex`: cloth of the physics engine MuJoCo, put to the questions of the suite."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, field_validator
from threadpoolctl import ThreadpoolController

from shellbench.engine import engine_version
from shellbench.errors import InputError, SolveFailure
from shellbench.model import Finite
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.solvers.mujoco import declines
from shellbench.solvers.mujoco.cloth import Cloth, Integrator
from shellbench.solvers.mujoco.elasticity import Elasticity
from shellbench.solvers.mujoco.grid import Grid
from shellbench.solvers.mujoco.library import DISTRIBUTION
from shellbench.solvers.mujoco.loading import Loading
from shellbench.solvers.mujoco.march import Frame, Pace, march, usual_step
from shellbench.solvers.mujoco.solution import FlexSolution

MOST_CELLS = 1000  # along a coordinate: three million bodies on slide joints
MOST_BYTES = 2**31  # of frames that are kept in memory
GAIN = 2.0  # times the most work that loads have done: energy that only a diverging motion has
NEGLIGIBLE = 1e-12  # strain whose energy may be rounding: relative to D times the area
FRAME_RATE = 240.0  # frames per second: four of a screen's


def _installed() -> str:
    return str(engine_version(DISTRIBUTION))


class FlexSettings(Settings):
    """Settings of `MujocoFlexSolver`."""

    cells: tuple[int, int] = Field((40, 40), description="cells along xi1 and xi2, two triangles each")
    time_step: Finite | None = Field(
        None, gt=0, description="longest step in time, s; None: a quarter of the longest stable one of leapfrog at rest"
    )
    integrator: Integrator = Field("Euler", description="the engine's: Euler (semi-implicit), discrete (implicit), RK4")
    staggered: bool = Field(
        True, description="of Euler: velocities are those half a step before positions, as the leapfrog rule has them"
    )
    damping: Finite = Field(0.0, ge=0, description="Rayleigh's damping, s, times the stiffness")
    frame_rate: Finite = Field(FRAME_RATE, gt=0, description="frames per second that are kept")
    engine: str = Field(default_factory=_installed, description="name and version of the engine; not to be chosen")

    @field_validator("cells")
    @classmethod
    def _cells_are_some(cls, cells: tuple[int, int]) -> tuple[int, int]:
        if not all(1 <= count <= MOST_CELLS for count in cells):
            raise ValueError(f"both must be from 1 to {MOST_CELLS}")
        return cells

    @field_validator("engine")
    @classmethod
    def _engine_is_installed(cls, engine: str) -> str:
        if engine != _installed():
            raise ValueError(f"{_installed()} is installed, and no other can be asked for")
        return engine


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
            tuple(self.history),
            figures,
        )

    @property
    def partial(self) -> FlexSolution | None:
        """What can be kept of a motion that failed."""
        return self.solution() if len(self.frames) > 1 else None


class MujocoFlexSolver:
    """A two-dimensional flex of MuJoCo, a vertex a body, on one grid."""

    name: ClassVar[str] = "mujoco-flex"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-nonlinear",),
        label="cloth of MuJoCo: linear triangles, hinges, lumped masses (motions only)",
    )
    settings_type: ClassVar[type[Settings]] = FlexSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = (
        {"cells": (10, 10)},
        {"cells": (20, 20)},
        {"cells": (40, 40)},
    )

    def declines(self, case: Case) -> str | None:
        """Return why the solver can't take this case, as one clause, or None if it can."""
        return declines.reason(case)

    def solve(
        self,
        case: Case,
        settings: Any,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> FlexSolution:
        """Follow a motion on one grid; an earlier solution `start` is not used.

        Raises
        ------
        SolveFailure
            If the motion diverges; the frames before come with it.
        InputError
            If the settings do not fit the case.
        """
        chosen = settings if isinstance(settings, FlexSettings) else FlexSettings.model_validate(settings or {})
        refusal = self.declines(case)
        if refusal:
            raise InputError(f"{self.name} can't take {case.name}: {refusal}")
        with ThreadpoolController().select(internal_api="openblas").limit(limits=1):  # the matrices are small
            return _follow(case, chosen, progress or (lambda _: None))

    def load(self, path: Path) -> FlexSolution:
        """Read a solution that `save` wrote; InputError in one sentence if it is none."""
        return FlexSolution.load(path)


def _follow(case: Case, settings: FlexSettings, tell: ProgressCallback) -> FlexSolution:
    assert case.dynamics is not None
    began = time.perf_counter()
    grid = Grid(case, settings.cells)
    loading = Loading(grid)
    wanted = settings.time_step or usual_step(Elasticity(grid), loading, settings.damping)
    pace = Pace.of(case.dynamics.until, settings.frame_rate, wanted)
    size = 2 * (pace.frames + 1) * grid.rest.nbytes
    if size > MOST_BYTES:
        raise InputError(
            f"field 'frame_rate': {pace.frames} frames on this grid take {size / 1e9:.1f} GB, choose fewer"
        )
    staggered = settings.staggered and settings.integrator == "Euler"
    figures = {"cells": list(settings.cells), "integrator": settings.integrator, "staggered": staggered}
    course = _Course(grid, pace, tell, figures, began)
    cloth = Cloth.of(grid, loading, settings.integrator, pace.time_step, settings.damping)
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
