"""The solver `pinn-naghdi`: a network for the five fields of Naghdi's shell, trained by its energy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from shellbench.problem import Capabilities, ProgressCallback, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import Beyond
from shellbench.problems.shell.question.loads import AreaLoad, GravityLoad, PressureLoad
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.solution import ShellSolver
from shellbench.solvers.naghdi.settings import NaghdiSettings

if TYPE_CHECKING:
    from shellbench.solvers.naghdi.solution import NaghdiSolution

LOADS = AreaLoad, GravityLoad, PressureLoad


class NaghdiSolver(ShellSolver):
    """Bastek & Kochmann's recipe; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = "pinn-naghdi"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("naghdi-linear",), label="network of five fields, Naghdi's energy, L-BFGS (Bastek & Kochmann)"
    )
    settings_type: ClassVar[type[NaghdiSettings]] = NaghdiSettings
    takes: ClassVar[frozenset[Beyond]] = frozenset({"transverse shear"})
    reactions: ClassVar[bool] = False

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines this case, as one clause, or None if it takes it."""
        return super().declines(case) or _beyond(case)

    def answer(
        self, case: Case, settings: NaghdiSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> NaghdiSolution:
        """Train a field; an interrupted training continues from its own file in the folder `settings.checkpoint`.

        Raises
        ------
        SolveFailure
            If the training ends above rest, or its loss is not finite.
        InputError
            If a support can't be held by the network, or a checkpoint is damaged.
        """
        from shellbench.solvers.naghdi import training

        return training.solve(case, settings, progress)

    def load(self, path: Path) -> NaghdiSolution:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        from shellbench.solvers.naghdi.solution import NaghdiSolution

        return NaghdiSolution.load(path)


def _beyond(case: Case) -> str | None:
    """Return the first property of a case that the network can't represent, as one clause; None if there is none."""
    if any(case.surface.domain.periodic):
        return "its surface closes on itself, and the network is not periodic"
    if not all(isinstance(load, LOADS) for load in case.loads):
        return "it has loads on edges or points, and this solver takes those spread over the area"
    if any(not isinstance(place, Edge) for _, place in case.supported_places()):
        return "it holds points or the whole surface, and this network holds edges"
    if any(support.motion is not None for support in case.supports):
        return "its supports move, and this network holds them at rest"
    if any(name.startswith("rotation") for name in case.remove_rigid_motions):
        return "it removes rotations, and this solver removes translations only"
    return None
