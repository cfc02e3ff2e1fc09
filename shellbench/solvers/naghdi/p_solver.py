"""The solver `p-naghdi`: elements of high degree in Naghdi's theory, which state their uncertainty."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from shellbench.errors import InputError
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.declining import Beyond
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.question.conditions import RIGID_MOTIONS
from shellbench.problems.shell.question.loads import MomentLoad, PointLoad
from shellbench.problems.shell.question.places import Edge
from shellbench.problems.shell.solution import ShellSolver
from shellbench.solvers.naghdi.supports import held_fields

if TYPE_CHECKING:
    from shellbench.problems.shell.symmetry.symmetry import Part
    from shellbench.solvers.naghdi.equilibrium import Equilibrium
    from shellbench.solvers.naghdi.p_solution import GridSolution


ROUNDING = 1e-10  # of a value: by the free hyperboloid of 1e-4, with room


class GridSettings(Settings):
    """Settings of `p-naghdi`."""

    degree: int = Field(5, ge=2, le=16, description="of the first solve")
    last_degree: int = Field(11, ge=3, le=16, description="at most")
    smallest: float = Field(0.003, gt=0, description="cell, at edges, in thicknesses")
    ratio: float = Field(3.0, gt=1, description="of distances of successive cells from an edge")
    settle: float = Field(1e-9, ge=0, lt=1, description="relative change of all quantities below which degrees suffice")


class PNaghdiSolver(ShellSolver):
    """Tensor grids of hierarchical polynomials, exact geometry; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = "p-naghdi"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("naghdi-linear",), label="p-version elements of five fields, exact geometry"
    )
    settings_type: ClassVar[type[Settings]] = GridSettings
    takes: ClassVar[frozenset[Beyond]] = frozenset({"transverse shear", "kinks"})
    reactions: ClassVar[bool] = False

    def declines(self, case: Case) -> str | None:
        """Return the reason that the solver declines this case, as one clause, or None if it takes it."""
        return super().declines(case) or _beyond(case)

    def answer(
        self, case: Case, settings: GridSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> GridSolution:
        """Raise the degree until all quantities settle; twice the last change is the stated uncertainty.

        Raises
        ------
        SolveFailure
            If a linear solve fails.
        """
        from shellbench.problems.shell.symmetry.symmetry import part_of
        from shellbench.solvers.naghdi.equilibrium import Equilibrium
        from shellbench.solvers.naghdi.grid import Grid, graded_ends

        begin, part = time.perf_counter(), part_of(case)
        first, second = (graded_ends(part, axis, settings.smallest, settings.ratio) for axis in (0, 1))
        history: list[Step] = []
        for degree in range(settings.degree, max(settings.degree, settings.last_degree) + 1, 2):
            shell = Equilibrium.of(part.case, Grid((first, second), degree, part.case.surface.domain.periodic))
            found = _solution(case, part, shell)
            values = measure_all(found)
            spent, energy = time.perf_counter() - begin, sum(found.energies())
            history.append(Step(len(history), spent, -energy, found.parameters, quantities=values))
            progress(Progress(len(history), None, f"degree {degree}, energy {energy:.10g} J"))
            uncertainty = _changes(history)
            if uncertainty and all(2 * settings.settle * abs(values[q]) >= u for q, u in uncertainty.items()):
                break
        diagnostics = {"degree": found.degree, "cells": list(shell.grid.cells), "copies": part.copies}
        return replace(found, history=tuple(history), uncertainty=uncertainty, diagnostics=diagnostics)

    def load(self, path: Path) -> GridSolution:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        from shellbench.solvers.naghdi.p_solution import GridSolution

        return GridSolution.load(path)


def _solution(case: Case, part: Part, shell: Equilibrium) -> GridSolution:
    """Solve on one grid; subtract the rigid motions that the case removes."""
    from shellbench.problems.shell.posed.rigid import rigid_modes
    from shellbench.solvers.naghdi.grid import gauss
    from shellbench.solvers.naghdi.p_solution import GridSolution

    coefficients = shell.solve(part.case.remove_rigid_motions)
    membrane, bending, shear = (part.copies * energy for energy in shell.energies(coefficients))
    rigid = np.zeros(len(RIGID_MOTIONS))
    if removed := [RIGID_MOTIONS.index(name) for name in part.case.remove_rigid_motions]:
        count = shell.areas.shape[-1]
        first, second = (gauss(ends, count)[0] for ends in shell.grid.ends)
        xi = np.stack(np.broadcast_arrays(first[:, None, :, None], second[None, :, None, :]), axis=-1)
        modes = rigid_modes(case.surface, xi)[0, 0][..., removed]
        gram = np.einsum("abpq,abpqci,abpqcj->ij", shell.areas, modes, modes, optimize=True)
        moved = shell.jets(coefficients)[..., 0, :3]
        rigid[removed] = np.linalg.solve(
            gram, np.einsum("abpq,abpqci,abpqc->i", shell.areas, modes, moved, optimize=True)
        )
    first, second = shell.grid.ends
    return GridSolution(case, shell.grid.degree, first, second, coefficients, rigid, membrane, bending + shear)


def _changes(history: list[Step]) -> Mapping[str, float]:
    """Return twice the last change of each quantity, at least its rounding; empty before there is one."""
    if len(history) < 2:
        return {}
    before, after = (step.quantities for step in history[-2:])
    return {name: max(2 * abs(value - before[name]), ROUNDING * abs(value)) for name, value in after.items()}


def _beyond(case: Case) -> str | None:
    """Return the first property of a case that these elements do not have, as one clause; None if there is none."""
    if any(isinstance(load, MomentLoad | PointLoad) for load in case.loads):
        return "it has moments or forces at points, and this solver takes loads spread over the area or edges"
    if any(not isinstance(place, Edge) for _, place in case.supported_places()):
        return "it holds points or the whole surface, and this solver holds edges"
    if any(support.motion is not None for support in case.supports):
        return "its supports move, and this solver holds them at rest"
    try:
        held_fields(case)
    except InputError:
        return "a support is on an edge of skew coordinates, and this solver holds normals along coordinate lines"
    return None
