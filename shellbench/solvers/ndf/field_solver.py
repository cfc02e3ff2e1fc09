"""Solvers whose answer is a field with boundary factors, and the quantities that such a field can't give."""

from __future__ import annotations

from shellbench.problem import Quantity
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.solution import ShellSolver


class FieldSolver(ShellSolver):
    """A solver of shells whose answer is a field; see `ShellSolver`."""

    def declines_quantity(self, case: Case, quantity: Quantity) -> str | None:
        """Return the reason that it can't give a quantity of a case that it takes, as one clause, or None if it can."""
        from shellbench.solvers.ndf.linear.declines import why_not_given

        return super().declines_quantity(case, quantity) or why_not_given(case, quantity)
