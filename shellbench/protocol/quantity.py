"""Quantities: what a problem asks of every solution."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from shellbench.protocol.schema import Finite, Flag, Model, Name, Positive

FULL = 1.0  # the mark of a figure of which nothing else is said


class Quantity(Model):
    """A figure that a problem asks of every solution.

    A kind of problem derives its quantities from this class; each says its unit, and how it is measured.

    Attributes
    ----------
    name
        Unique in the case; known values refer to it.
    description
        What a table says, without the unit.
    unit
        Unit of the value, for tables.
    primary
        Whether it is the headline of the case: exactly one is.
    tolerance, open_finding
        By solver, in a user's own case only, and judged by no gate: what our cases allow is frozen in
        references/tolerances/, and so are their open findings.
    absolute
        Whether an error relative to the known value would say nothing, so that it is given in the unit.
    at
        Mark of the state that it belongs to, such as a time in s or a load factor.
    factor
        What its measured value is multiplied by before it is recorded: 0.001 of a displacement in a case in
        millimetres whose known values are in metres.
    is_an_error
        Of a class: its value is an error already. Solvers are not held against each other over it.
    """

    is_an_error: ClassVar[bool] = False

    name: Name
    description: str = ""
    unit: str = "m"
    primary: Flag = False
    at: Finite = FULL
    factor: Positive = 1.0
    tolerance: dict[str, Positive] = Field(default_factory=dict)
    absolute: Flag = False
    open_finding: dict[str, str] = Field(default_factory=dict)

    if TYPE_CHECKING:

        @property
        def kind(self) -> str:
            """Name of the kind in case files."""
            ...

    @property
    def mark(self) -> float | None:
        """The mark of its state; None where the solution itself marks the state."""
        return self.at

    def measure(self, solution: Any) -> float:
        """Return its value, in SI units or the problem's own.

        Raises
        ------
        ValueError
            If it belongs to a state that the solution did not reach.
        """
        raise NotImplementedError
