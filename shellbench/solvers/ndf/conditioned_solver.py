"""The solver `ndf-conditioned`; the module `conditioned`, which solves, is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from shellbench.problem import Capabilities, ProgressCallback
from shellbench.problems.series.conditioned import ConditionedCase
from shellbench.problems.series.conditioned_answer import IN_MOTION, ConditionedSolver
from shellbench.solvers.ndf.linear.ritz_settings import ConditionedSettings
from shellbench.solvers.ndf.ritz_solver import RitzSolver

if TYPE_CHECKING:
    from shellbench.solvers.ndf.conditioned.conditioned import ConditionedField
    from shellbench.solvers.ndf.conditioned.conditioned_motion import ConditionedMotion


class ConditionedFieldSolver(ConditionedSolver):
    """One neural field for a range of materials; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = "ndf-conditioned"
    capabilities: ClassVar[Capabilities] = Capabilities(
        IN_MOTION,
        "neural field for all materials: random sine layer, output layers solved for at some and combined by energy, or"
        " interpolated in motion",
        devices=("cpu", "cuda"),
    )
    settings_type: ClassVar[type[ConditionedSettings]] = ConditionedSettings

    def refuses(self, case: ConditionedCase) -> str | None:
        """Return the reason that the field can't represent the shell, or None if it can."""
        if case.moving:
            from shellbench.solvers.ndf.conditioned.plane_motion import refusal

            return refusal(case)
        shell = case.shell_of(case.middle)
        if not shell.material.uniform or shell.springs:
            return "its modulus or thickness varies, or it rests on springs: its energy is not two stiffnesses alone"
        if any(support.motion is not None for support in shell.supports):
            return "a support is moved: the field answers for loads alone"
        return RitzSolver().refusal(shell)

    def answer(
        self, case: ConditionedCase, settings: ConditionedSettings, progress: ProgressCallback
    ) -> ConditionedField | ConditionedMotion:
        """Build the field; SolveFailure if it exploits its quadrature at a material, or a motion gets stuck."""
        if case.moving:
            from shellbench.solvers.ndf.conditioned import conditioned_motion

            return conditioned_motion.solve(case, settings, progress)
        from shellbench.solvers.ndf.conditioned.conditioned import solve

        return solve(case, settings, progress)

    def load(self, path: Path) -> ConditionedField | ConditionedMotion:
        """Read the file of an answer; InputError in one sentence if it is no such file."""
        from shellbench.solvers.ndf.conditioned.conditioned import ConditionedField
        from shellbench.solvers.ndf.conditioned.conditioned_motion import ConditionedMotion, is_motion

        return ConditionedMotion.load(path) if is_motion(path) else ConditionedField.load(path)
