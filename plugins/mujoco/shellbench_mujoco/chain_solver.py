"""The solver `mujoco-chain`: a chain of hinges of the physics engine MuJoCo, for ropes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field

from shellbench.problem import Capabilities, ProgressCallback, Settings
from shellbench.problems.rope.case import RopeCase
from shellbench.problems.rope.planar import why_not_planar
from shellbench.problems.rope.solution import RopeMotion
from shellbench.problems.rope.solving import RopeSolver, halved, refined
from shellbench.protocol.schema import Finite
from shellbench_mujoco.engine import EngineSettings, quiet

ChainIntegrator = Literal["Euler", "RK4"]


class ChainSettings(EngineSettings):
    """Settings of `MujocoChainSolver`."""

    steps_per_second: Finite = Field(1000.0, gt=0, le=1e7, description="of the finest of three solves")
    integrator: ChainIntegrator = Field("RK4", description="the engine's: Euler (semi-implicit), RK4")


class MujocoChainSolver(RopeSolver):
    """A kinematic chain of MuJoCo: a body for each mass, a hinge for each link."""

    name: ClassVar[str] = "mujoco-chain"
    capabilities: ClassVar[Capabilities] = Capabilities(("rigid-links",), "planar chains: hinges of MuJoCo")
    settings_type: ClassVar[type[Settings]] = ChainSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = tuple({"steps_per_second": n} for n in (60.0, 120.0, 240.0))

    def declines(self, case: Any) -> str | None:
        """Return the reason why the solver can't take a problem, as one clause, or None if it can."""
        if reason := why_not_planar(case):
            return reason
        if any(isinstance(formula, str) for formula in case.rope.root):
            return "its root moves, and this chain hangs from the engine's world"
        if case.rope.damping:
            return "its links are damped, and the engine damps angles"
        return "it has wind, and the engine's air is another" if case.wind else None

    def answer(self, case: RopeCase, settings: Any, progress: ProgressCallback) -> RopeMotion:
        """Follow the motion with three steps in time."""
        from shellbench_mujoco import chain_solving

        def follow(rate: float, watch: Any) -> Any:
            return chain_solving.followed(case, settings.integrator, rate, watch)

        told = {"steps_per_second": settings.steps_per_second, "integrator": settings.integrator}
        with quiet():
            return refined(case, halved(settings.steps_per_second), follow, told, progress)
