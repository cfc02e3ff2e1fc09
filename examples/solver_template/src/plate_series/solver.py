"""The solver for shellbench (the protocol `shellbench.problem.Solver`): a name, its capabilities, and `answer`.

shellbench makes one by calling the class without arguments, reads its settings from ``--set plate-series.terms=8``,
and solves in a process of its own, so that a crash or a leak costs that run only. The base's `solve` validates the
settings, refuses cases by `declines`, then calls `answer`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field
from shellbench.problem import Capabilities, ProgressCallback, Settings, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import DerivativeQuantity
from shellbench.problems.shell.records.history import settled
from shellbench.problems.shell.solution import ShellSolver

from plate_series import plate as series
from plate_series import reading
from plate_series.solution import PlateSolution

MOST_TERMS = 1000  # a direction: a million coefficients; round-off rules the answer long before


class PlateSettings(Settings):
    """Settings of `PlateSeriesSolver`: everything that can change its answer, as they are part of a run's identity."""

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
        """Return the reason why the solver can't take this case, as one clause, or None if it can."""
        return reading.declines(case)

    def declines_quantity(self, case: Case, quantity: Any) -> str | None:
        """Return the reason why it can't give a quantity, as one clause, or None if it can."""
        if not isinstance(quantity, DerivativeQuantity):
            return super().declines_quantity(case, quantity)
        of = case.quantity(quantity.derivative_of)
        if of.kind not in ("displacement", "strain_energy", "bending_energy"):
            return f"it gives no derivatives of a quantity of kind '{of.kind}'"
        known = ("material.youngs_modulus", "material.thickness", "material.poissons_ratio", "loads.1")
        single = len(case.loads) == 1 and quantity.with_respect_to in known
        return None if single else f"it gives derivatives of plates under one load, by {', '.join(known)}"

    def answer(
        self, case: Case, settings: PlateSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> PlateSolution:
        """Solve the case with half of the terms and with all; the difference is the error estimate.

        `settings` are of `settings_type`. The base class refuses `start` unless `uses_start` is true. `progress`
        receives the state of the solve.
        """
        plate = reading.plate_of(case)
        counts = sorted({max(1, settings.terms // 2), settings.terms})
        solutions = (PlateSolution(case, series.solve(plate, terms)) for terms in counts)
        # By Clapeyron's theorem the load does twice the strain energy as work, so that the potential energy is minus it.
        return settled(((solution, -sum(solution.energies())) for solution in solutions), len(counts), progress)

    def load(self, path: Path) -> PlateSolution:
        """Read a solution that `PlateSolution.save` wrote."""
        return PlateSolution.load(path)
