"""The solver `ndf-published`; the module `published`, which trains, is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from shellbench.problem import Capabilities, ProgressCallback, Quantity, Solution
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import DerivativeQuantity, SupportQuantity
from shellbench.solvers.ndf.field_solver import FieldSolver
from shellbench.solvers.ndf.published.published_settings import NDF_PUBLISHED, PublishedSettings


class PublishedSolver(FieldSolver):
    """The paper's training; see `shellbench.problem.Solver`."""

    name: ClassVar[str] = NDF_PUBLISHED
    capabilities: ClassVar[Capabilities] = Capabilities(
        theories=("kirchhoff-love-linear", "kirchhoff-love-nonlinear"),
        label="neural field: the published training (SIREN, stratified samples, Adam)",
        devices=("cpu", "cuda"),
    )
    settings_type: ClassVar[type[PublishedSettings]] = PublishedSettings
    uses_start: ClassVar[bool] = True

    def declines(self, case: Case) -> str | None:
        """Return the reason that the published boundary functions can't hold this case, as one clause, or None."""
        from shellbench.solvers.ndf.published import published

        return published.why_not_held(case)

    def declines_quantity(self, case: Case, quantity: Quantity) -> str | None:
        """Return the reason that it can't give a quantity of a case that it takes, as one clause, or None if it can."""
        if case.dynamics is not None and isinstance(quantity, SupportQuantity) and len(case.supports) > 1:
            return f"it can't tell the reaction of support '{quantity.support}' from that of others"
        if isinstance(quantity, DerivativeQuantity):
            return "its weights were trained at one material: their derivative by another one is not in them"
        return super().declines_quantity(case, quantity)

    def load(self, path: Path) -> Solution:
        """Read a file of this recipe; InputError in one sentence if it is no such file."""
        from shellbench.solvers.ndf.published import published

        return published.load(path, self.name)

    def answer(
        self, case: Case, settings: PublishedSettings, start: Solution | Path | None, progress: ProgressCallback
    ) -> Solution:
        """Train a field.

        With a checkpoint as `start`, the training continues as if it had not been interrupted. With an earlier solution
        of this recipe, for this case or another one, it begins with that solution's weights. Without `start`, an
        interrupted training continues from its own file in the folder `settings.checkpoint`, which is removed when the
        training ends.

        Raises
        ------
        SolveFailure
            If the loss becomes non-finite, or the training has collapsed; the field of its last good state, or of its
            end, comes with it.
        InputError
            If the case can't be solved with these settings, or `start` does not fit them.
        """
        from shellbench.solvers.ndf.published import published

        return published.solve(case, settings, start, progress)
