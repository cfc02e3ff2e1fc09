"""The solver as shellbench sees it (the protocol `shellbench.problem.Solver`): a name, what it can do, and `answer`.

shellbench makes one by calling the class without arguments, reads its settings from ``--set plate-series.terms=8``,
and solves in a process of its own, so that a crash or a leak costs that run only. The base's `solve` validates the
settings and refuses what `declines` says, then calls `answer`.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field
from shellbench.errors import SolveFailure
from shellbench.problem import Capabilities, Progress, ProgressCallback, Settings, Solution, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.measure import measure_all
from shellbench.problems.shell.solver import ShellSolver

from plate_series import plate as series
from plate_series import reading
from plate_series.solution import PlateSolution

MOST_TERMS = 1000  # a direction: a million coefficients; round-off rules the answer long before


class PlateSettings(Settings):
    """Settings of `PlateSeriesSolver`: all that can change its answer, for they are part of a run's identity."""

    terms: int = Field(48, ge=1, le=MOST_TERMS, strict=True, description="odd harmonics along each side")


class PlateSeriesSolver(ShellSolver):
    """Rectangular, simply supported plates under uniform normal load."""

    name: ClassVar[str] = "plate-series"
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear",), label="double sine series (Navier), simply supported plates only"
    )
    settings_type: ClassVar[type[Settings]] = PlateSettings
    refinements: ClassVar[tuple[Mapping[str, Any], ...]] = ({"terms": 2}, {"terms": 4}, {"terms": 8})
    """Settings from coarse to fine (optional): `shellbench check-solver` measures a rate of convergence by them."""

    def declines(self, case: Case) -> str | None:
        """Return why the solver can't take this case, as one clause, or None if it can."""
        return reading.declines(case)

    def answer(
        self, case: Case, settings: PlateSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> PlateSolution:
        """Solve the case with half of the terms and with all; the difference is the estimate of the error.

        Parameters
        ----------
        settings
            What `settings_type` makes of what was asked for.
        start
            An earlier solution to go on from; the base refuses it unless `uses_start` is true.
        progress
            Is told how far the solve is.

        Raises
        ------
        SolveFailure
            If the answer is not finite.
        """
        began = time.perf_counter()
        plate = reading.plate_of(case)
        history: list[Step] = []
        for terms in sorted({max(1, settings.terms // 2), settings.terms}):
            coefficients = series.solve(plate, terms)
            if not np.all(np.isfinite(coefficients)):
                raise SolveFailure("the coefficients are not finite")
            solution = PlateSolution(case, coefficients)
            energy = solution.energies()[1]
            work = 2 * energy  # of the load, by Clapeyron's theorem: the potential energy is energy - work
            seconds = time.perf_counter() - began
            history.append(
                Step(len(history), seconds, energy - work, coefficients.size, quantities=measure_all(solution))
            )
            progress(Progress(len(history), 2, f"{terms} terms a direction"))
        before, last = history[0].quantities, history[-1].quantities
        return PlateSolution(
            case,
            coefficients,
            history=tuple(history),
            diagnostics={"terms": settings.terms},
            uncertainty={name: abs(last[name] - before[name]) for name in last} if len(history) > 1 else {},
        )

    def load(self, path: Path) -> PlateSolution:
        """Read a solution that `PlateSolution.save` wrote."""
        return PlateSolution.load(path)
