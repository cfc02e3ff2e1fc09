"""The cloth solvers of newton, and the reasons for which they decline cases."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field, field_validator

from shellbench.problem import Capabilities, ProgressCallback, Settings, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.deck.solver import OF_DISPLACEMENTS
from shellbench.problems.shell.declining import why_not_by_load
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.solution import ShellSolver
from shellbench.protocol.engine import engine_version, need
from shellbench.protocol.schema import Finite
from shellbench_newton.cloth import Cut, Kind

if TYPE_CHECKING:
    from shellbench_newton.solving import ClothSolution

DISTRIBUTIONS = ("newton", "warp-lang")
SAMPLES, FLAT = 9, 1e-9  # points a side at which a surface is looked at; how far it may lie from its plane, of its size

need("", DISTRIBUTIONS, "./plugins/newton")  # without them there is no solver to declare


def _installed() -> str:
    return ", ".join(str(engine_version(name)) for name in DISTRIBUTIONS)


class ClothSettings(Settings):
    """Settings of `ClothSolver`."""

    cells: tuple[int, int] = Field((20, 20), description="cells along xi1 and xi2, two triangles each")
    cut: Cut = Field("right", description="the cells' diagonals: right, left, alternating")
    time_step: Finite | None = Field(
        None,
        gt=0,
        description="longest step, s, in whole parts of a frame; None: half of the stable one of the explicit rule",
    )
    iterations: int = Field(10, ge=1, le=10_000, description="of each step; the explicit rule has none")
    frame_rate: Finite = Field(120.0, gt=0, description="of a motion: frames per second that are kept")
    steps: int = Field(40_000, ge=100, le=10_000_000, description="of a cloth at rest: most steps for each load")
    engine: str = Field(default_factory=_installed, description="names and versions of the engine; not to be chosen")

    @field_validator("engine")
    @classmethod
    def _engine_is_installed(cls, engine: str) -> str:
        if engine != _installed():
            raise ValueError(f"{_installed()} is installed, and no other can be asked for")
        return engine


class ClothSolver(ShellSolver):
    """Flat cloth in motion, or brought to rest; a subclass names the solver of newton."""

    kind: ClassVar[Kind]
    settings_type: ClassVar[type[Settings]] = ClothSettings
    reactions: ClassVar[bool] = False

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines a case, as one clause, or None if it takes it."""
        return super().declines(case) or reason(case)

    def declines_quantity(self, case: Case, quantity: Any) -> str | None:
        """Return the reason that it can't give a quantity of a case that it takes, as one clause, or None if it can."""
        if isinstance(quantity, OF_DISPLACEMENTS) or getattr(quantity, "kind", "") == "kinetic_energy":
            return None
        return "this solver knows places and velocities of vertices only"

    def answer(
        self, case: Case, settings: ClothSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> ClothSolution:
        """Follow a motion, or come to rest under each load.

        Raises
        ------
        SolveFailure
            If the vertices leave the range of numbers.
        InputError
            If the settings do not fit the case.
        """
        from shellbench_newton import solving

        return solving.solve(case, self.kind, settings, progress)

    def load(self, path: Path) -> ClothSolution:
        """Read a solution that `save` wrote; InputError in one sentence for other files."""
        from shellbench_newton.solving import ClothSolution

        return ClothSolution.load(path)


def _capabilities(words: str) -> Capabilities:
    return Capabilities(theories=("kirchhoff-love-nonlinear",), label=f"cloth of newton: {words}")


class VbdSolver(ClothSolver):
    """Vertex block descent."""

    name: ClassVar[str] = "newton-vbd"
    kind: ClassVar[Kind] = "vbd"
    capabilities: ClassVar[Capabilities] = _capabilities("triangles and hinges by vertex block descent")


class XpbdSolver(ClothSolver):
    """Position-based dynamics with compliance."""

    name: ClassVar[str] = "newton-xpbd"
    kind: ClassVar[Kind] = "xpbd"
    capabilities: ClassVar[Capabilities] = _capabilities("springs and hinges by position-based dynamics")


class Style3DSolver(ClothSolver):
    """Projective dynamics."""

    name: ClassVar[str] = "newton-style3d"
    kind: ClassVar[Kind] = "style3d"
    capabilities: ClassVar[Capabilities] = _capabilities("triangles and quadratic bending by projective dynamics")


class SemiImplicitSolver(ClothSolver):
    """Semi-implicit Euler."""

    name: ClassVar[str] = "newton-semi-implicit"
    kind: ClassVar[Kind] = "semi-implicit"
    capabilities: ClassVar[Capabilities] = _capabilities("triangles and hinges by semi-implicit Euler")


def reason(case: Case) -> str | None:
    """Return the reason why a case can't be taken, as one clause; None if it can."""
    x = case.surface.position(case.surface.domain.grid(SAMPLES, SAMPLES)).reshape(-1, 3)
    sizes = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    if any(case.surface.domain.periodic) or sizes[2] > FLAT * sizes[0] or case.surface.kind != "plane":
        return "its surface is no plane at rest, and this map to newton's numbers is for planes"
    for support in case.supports:
        if set(support.components) != {"x", "y", "z"} or support.symmetry is not None:
            return "its supports hold single directions, and newton holds a vertex whole or not at all"
        if support.motion is not None:
            return "it moves its supports, and vertices of this cloth are held still or free"
    if any(isinstance(load, MomentLoad) for load in case.loads) or case.following:
        return "its loads turn with the cloth or are moments, and this solver's are dead forces"
    if case.springs:
        return "it has springs, which this solver does not take"
    if case.dynamics is None:
        if case.remove_rigid_motions or not case.supports:
            return "nothing holds it, and this solver brings to rest only what is held"
        return why_not_by_load(case, ())
    return None
