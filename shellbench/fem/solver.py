"""The solver `fem`: refine until every quantity is converged, and say how sure it is."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, PositiveInt

from shellbench.case import Case
from shellbench.errors import InputError, SolveFailure
from shellbench.fem import equilibrium
from shellbench.fem.grading import graded_mesh, singular_points
from shellbench.fem.linear_solve import Method
from shellbench.fem.refinement import Cells, Level, balanced_share, first_level, level_cells, levels
from shellbench.fem.solution import FemSolution
from shellbench.measure import measure_all
from shellbench.solution import Capabilities, Progress, ProgressCallback, Settings, Solution, Step

SMOOTH_TOLERANCE = 6e-7  # of a case whose loads and supports are spread out: the element converges fast
SINGULAR_TOLERANCE = 2.5e-5  # of a case with forces at points: deflections under a load need many cells


class FemSettings(Settings):
    """Settings of `fem`.

    Attributes
    ----------
    tolerance
        Relative uncertainty at which every quantity of the case counts as converged. None: 6e-7, or 2.5e-5 where a
        force acts at a point.
    max_unknowns
        No mesh with more degrees of freedom is tried.
    cells
        One fixed mesh: along each coordinate the cells from a graded point to the end of its influence, which is
        half the way to the next one, or half of the side. None: refine.
    grading
        Exponent of the mesh lines' distances from a graded point: 1 is uniform, and 3 spoils the conditioning.
    quadrature_order
        Degree to which the Gauss rule of a cell is exact.
    direct_solver
        "dissection" is our own, "superlu" SciPy's, "pardiso" needs pypardiso; "auto" is "dissection".
    """

    tolerance: float | None = Field(None, gt=0, lt=1)
    max_unknowns: int = Field(120_000, ge=100)
    cells: tuple[PositiveInt, PositiveInt] | None = None
    grading: float = Field(2.0, ge=1, le=3)
    quadrature_order: int = Field(7, ge=5, le=19)
    direct_solver: Method = "auto"


class FemSolver:
    """Bogner-Fox-Schmit finite elements on a tensor mesh with the exact geometry."""

    name: ClassVar[str] = "fem"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear",), label="C1 finite elements (BFS), exact geometry"
    )
    settings_type: ClassVar[type[Settings]] = FemSettings

    def declines(self, case: Case) -> str | None:
        """Return why the solver can't take this case, or None."""
        if case.theory not in self.capabilities.theories:
            return f"it does not solve the theory {case.theory}"
        return None

    def solve(
        self,
        case: Case,
        settings: Any,
        start: Solution | Path | None = None,
        progress: ProgressCallback | None = None,
    ) -> FemSolution:
        """Solve a case on ever finer meshes until all its quantities are converged.

        A linear solve gains nothing from an earlier solution, so `start` is not used.

        Raises
        ------
        SolveFailure
            If a linear solve fails or the loads are not in balance; the finest mesh's answer so far comes with it.
        InputError
            If the case's theory is another one, supports contradict each other, or a direct solver is not installed.
        """
        chosen = settings if isinstance(settings, FemSettings) else FemSettings.model_validate(settings or {})
        refusal = self.declines(case)
        if refusal:
            raise InputError(f"fem can't take {case.name}: {refusal}")
        began = time.perf_counter()
        states = tuple(sorted({quantity.at for quantity in case.quantities}))

        def on_mesh(cells: Cells) -> equilibrium.Equilibrium:
            mesh = graded_mesh(case, cells, chosen.grading)
            return equilibrium.solve(case, mesh, states, chosen.quadrature_order, chosen.direct_solver)

        tolerance = chosen.tolerance or (SINGULAR_TOLERANCE if singular_points(case) else SMOOTH_TOLERANCE)
        steps: list[Step] = []
        differences: list[dict[str, Any]] = []
        solution: FemSolution | None = None
        try:
            for level in levels(case, _meshes(case, chosen, on_mesh), on_mesh, measure_all):
                seconds = time.perf_counter() - began
                found = level.equilibrium
                unknowns, cells = found.solution.parameters, list(found.solution.mesh.cells)
                steps.append(
                    Step(len(steps), seconds, found.potential_energy, unknowns, states[-1], None, level.quantities)
                )
                if level.difference is not None:
                    differences.append({"cells": cells, "largest_difference": level.difference})
                converged = level.error <= tolerance
                solution = _finished(level, tuple(steps), differences, tolerance, chosen)
                if progress:
                    progress(Progress(len(steps), None, f"{cells[0]} x {cells[1]} cells, error {level.error:.1e}"))
                if converged or 2 * unknowns > chosen.max_unknowns:
                    break
        except SolveFailure as failure:
            raise SolveFailure(str(failure), partial=solution) from None
        except MemoryError:
            raise SolveFailure("the next mesh does not fit into memory", partial=solution) from None
        except np.linalg.LinAlgError:
            raise SolveFailure("the surface's metric is singular at a quadrature point", partial=solution) from None
        assert solution is not None  # there is always a first mesh
        return solution

    def load(self, path: Path) -> FemSolution:
        """Read a solution that `FemSolution.save` wrote."""
        return FemSolution.load(path)


def _meshes(case: Case, settings: FemSettings, on_mesh: Callable[[Cells], equilibrium.Equilibrium]) -> Iterator[Cells]:
    """Yield the cells of the meshes to solve on; the first one takes the trials that share them out."""
    if settings.cells:
        yield settings.cells
        return
    first = first_level(lambda cells: graded_mesh(case, cells, settings.grading).node_count)
    share = balanced_share(on_mesh, first - 1)
    for level in itertools.count(first):
        yield level_cells(level, share)


def _finished(
    level: Level,
    steps: tuple[Step, ...],
    differences: list[dict[str, Any]],
    tolerance: float,
    settings: FemSettings,
) -> FemSolution:
    found = level.equilibrium
    known = {name: e for name, e in level.estimates.items() if len(steps) > 1}
    return replace(
        found.solution,
        history=steps,
        uncertainty={name: e.uncertainty for name, e in known.items()},
        extrapolated={name: e.extrapolated for name, e in known.items()},
        diagnostics={
            "converged": level.error <= tolerance,
            "tolerance": tolerance,
            "relative_uncertainty": level.error if known else None,
            "cells": list(found.solution.mesh.cells),
            "rates": {name: e.rate for name, e in known.items() if e.rate is not None},
            "residual": found.residual,
            "last_correction": found.correction,
            "direct_solver": "dissection" if settings.direct_solver == "auto" else settings.direct_solver,
            "mesh_differences": list(differences),
        },
    )
