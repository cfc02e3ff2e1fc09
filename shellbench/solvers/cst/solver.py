"""The solver `cst-hinge`: the discretisation of cloth simulators, applied to the suite's cases.

The module also lists the reasons for which the mesh of triangles and hinges declines a case.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from shellbench.problem import Capabilities, ProgressCallback, Settings, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import why_not_by_load, why_not_plain
from shellbench.problems.shell.question.conditions import Support
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.problems.shell.solution import ShellSolver
from shellbench.problems.shell.variants.slopes import by_differences
from shellbench.solvers.cst.settings import CstSettings

if TYPE_CHECKING:
    from shellbench.solvers.cst.solution import CstSolution


class CstSolver(ShellSolver):
    """Constant-strain triangles with hinges, on one mesh; motions by backward Euler, obstacles by a penalty."""

    name: ClassVar[str] = "cst-hinge"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"),
        label="constant-strain triangles with hinge bending (as cloth simulators)",
    )
    settings_type: ClassVar[type[Settings]] = CstSettings
    slopes: ClassVar[Literal["", "energies", "differences"]] = "differences"

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines this case, as one clause, or None if it takes it."""
        return why_declined(case)

    def answer(
        self, case: Case, settings: CstSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> CstSolution:
        """Solve a case on one mesh.

        Raises
        ------
        SolveFailure
            If a matrix is singular, loads are not in balance, or Newton's method fails; the states found before come
            with it.
        InputError
            If the mesh does not fit the case.
        """
        from shellbench.solvers.cst import solving

        found: CstSolution = by_differences(case, lambda of: solving.solve(of, settings, progress))
        return found

    def load(self, path: Path) -> CstSolution:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        from shellbench.solvers.cst.solution import CstSolution

        return CstSolution.load(path)


def _is_wall(support: Support) -> bool:
    """Return True if a support holds an edge and its slope at rest."""
    return support.clamped and set(support.components) == {"x", "y", "z"} and support.motion is None


def _why_no_modes(case: Case) -> str | None:
    """Return the reason that the mesh can't give the modes that a case asks for, as one clause, or None if it can."""
    if case.quantities[0].kind != "frequency":
        if case.surface.kind != "plane":
            return "it finds buckling loads of plates only, which do not bend before"
        return "it finds buckling loads of shells that are held only" if case.remove_rigid_motions else None
    if case.loads or any(support.motion is not None for support in case.supports):
        return "it finds frequencies about rest only"
    if case.remove_rigid_motions:
        return "it finds frequencies of shells that are held only"
    return None


def why_declined(case: Case) -> str | None:
    """Return the reason that the solver declines a case, as one clause; None if it takes it."""
    if refusal := why_not_plain(case, frozenset({"modes", "contact", "orthotropic"})):
        return refusal
    if case.obstacles and case.dynamics is None:
        return "it touches obstacles at rest, and this mesh meets them in motion only"
    if any(obstacle.friction for obstacle in case.obstacles):
        return "its obstacles have friction, and those of this mesh have none"
    if case.modal and (refusal := _why_no_modes(case)):
        return refusal
    if case.prescribed:
        return "it moves the whole surface as prescribed, and leaves nothing to solve for"
    if any(support.holds_slope and not _is_wall(support) for support in case.supports):
        return "it holds slopes on edges that move, where this mesh has no hinges"
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return "it has moments on edges, where this mesh has no hinges"
    if case.following:
        return "its pressure follows the shell, where the loads of this mesh are dead"
    if case.dynamics is None and not case.linear:
        return why_not_by_load(case, case.remove_rigid_motions)
    return None
