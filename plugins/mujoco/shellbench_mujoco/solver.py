"""The solver `mujoco-flex`: cloth of the physics engine MuJoCo.

This module also has the reasons for which the solver declines cases.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator

from shellbench.problem import Capabilities, ProgressCallback, Settings, Solution
from shellbench.problems.obstacle import Box, Capsule, HalfSpace, Obstacle, Sphere
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import why_not_plain
from shellbench.problems.shell.question.loads import EdgeLoad, MomentLoad
from shellbench.problems.shell.solution import ShellSolver
from shellbench.protocol.schema import Finite
from shellbench_mujoco.engine import EngineSettings

if TYPE_CHECKING:
    from shellbench_mujoco.solution import FlexSolution


Integrator = Literal["Euler", "discrete", "RK4"]


MOST_CELLS = 1000  # along a coordinate: three million bodies on slide joints
FRAME_RATE = 240.0  # frames per second: four of a screen's


class FlexSettings(EngineSettings):
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

    @field_validator("cells")
    @classmethod
    def _cells_are_some(cls, cells: tuple[int, int]) -> tuple[int, int]:
        if not all(1 <= count <= MOST_CELLS for count in cells):
            raise ValueError(f"both must be from 1 to {MOST_CELLS}")
        return cells


class MujocoFlexSolver(ShellSolver):
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
        """Return the reason why the solver can't take this case, as one clause, or None if it can."""
        return reason(case)

    def answer(
        self, case: Case, settings: FlexSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> FlexSolution:
        """Follow a motion on one grid.

        Raises
        ------
        SolveFailure
            If the motion diverges; it carries the frames before.
        InputError
            If the settings do not fit the case.
        """
        from shellbench_mujoco import solving

        return solving.solve(case, settings, progress)

    def load(self, path: Path) -> FlexSolution:
        """Read a solution that `save` wrote; InputError in one sentence for other files."""
        from shellbench_mujoco.solution import FlexSolution

        return FlexSolution.load(path)


SAMPLES = 17  # points a side at which a surface is looked at
FLAT = 1e-9  # of its size: how far a flat surface may lie from its plane
INCOMPRESSIBLE = 0.5  # Poisson's ratio that the engine does not reach; its least one is 0


def reason(case: Case) -> str | None:
    """Return the reason why a case can't be taken, as one clause; None if it can."""
    if refusal := why_not_plain(case, frozenset({"contact"})):
        return refusal
    if case.dynamics is None:
        return "it is at rest, and this engine follows motions"
    if any(case.surface.domain.periodic) or not _is_flat(case):
        return "its surface is curved at rest, and the bending of this cloth is known for flat ones only"
    if any(support.motion is not None for support in case.supports):
        return "it moves its supports, and vertices of this cloth are held still or free"
    if any(support.holds_slope for support in case.supports):
        return "it holds slopes on edges, and this cloth has vertices only"
    if any(isinstance(load, EdgeLoad | MomentLoad) for load in case.loads):
        return "it has loads on edges, and this solver knows those on areas and at points"
    if case.following:
        return "its pressure follows the shell, where this solver's loads are dead"
    if not 0 <= case.isotropic.poissons_ratio < INCOMPRESSIBLE:
        return "its Poisson's ratio is negative, which the engine refuses"
    return next((words for obstacle in case.obstacles if (words := _why_no_geom(obstacle))), None)


def _why_no_geom(obstacle: Obstacle) -> str | None:
    """Return the reason why an obstacle can't be one of the engine's shapes, as one clause; None if it can."""
    if not isinstance(obstacle, Sphere | HalfSpace | Capsule | Box):
        return f"it has an obstacle of kind '{obstacle.kind}', and the engine's are planes, balls, capsules and boxes"
    if obstacle.friction:
        return "its obstacles have friction, and this solver's have none"
    if any(isinstance(coordinate, str) for coordinate in obstacle.centre):
        return "it has an obstacle whose place is a formula of time, and this solver's stand still"
    return None


def _is_flat(case: Case) -> bool:
    x = case.surface.position(case.surface.domain.grid(SAMPLES, SAMPLES)).reshape(-1, 3)
    sizes = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    return bool(sizes[2] <= FLAT * sizes[0])
