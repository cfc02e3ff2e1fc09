"""Quantities that a problem asks of every solution."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field

from shellbench.protocol.schema import Finite, Flag, Model, Name, Positive

FULL = 1.0  # the default mark of a value


class Quantity(Model):
    """A value that a problem asks of every solution.

    A kind of problem derives its quantities from this class; each has its unit, and its measurement.

    Attributes
    ----------
    name
        Unique in the case; known values refer to it.
    description
        Description in tables, without the unit.
    unit
        Unit of the value, for tables.
    primary
        True for the headline of the case: exactly one quantity is the headline.
    tolerance
        By solver, in a user's own case only. The tolerance of a headline widens the limit beyond which that solver has
        not settled. No gate judges by it: `[[known]].tolerance` is the tolerance of the gate.
    open_finding
        By solver, in a user's own case only; no gate uses it. Those of built-in cases are in references/tolerances/.
    absolute
        True if the known value is too near zero for relative errors, so that errors are given in the unit.
    at
        Mark of the state that it belongs to, such as a time in s or a load factor.
    factor
        Factor of the measured value before it is recorded: 0.001 for a displacement in a case in millimetres whose
        known values are in metres.
    is_an_error
        Class attribute: True if its value is itself an error. Solvers are then not compared with each other.
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

    def words(self, case: Any, known: Callable[[str], float | None]) -> str:
        """Return its description in tables; `known` gives known values of the case by name."""
        return self.description

    def measure(self, solution: Any) -> float:
        """Return its value, in SI units or the problem's own.

        Raises
        ------
        ValueError
            If it belongs to a state that the solution did not reach.
        """
        raise NotImplementedError
