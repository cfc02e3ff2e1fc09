"""Known values in a case file, from its author, and the names under which others know the case."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Self

from pydantic import Field, model_validator

from shellbench.protocol.schema import Finite, Flag, Model, Name, Positive

SHARPER = 3.0  # least tolerance in uncertainties of its known value; with less the value could not judge


class OtherName(Model):
    """A name under which others know a case.

    Attributes
    ----------
    name
        The author or the set of benchmarks, and the name or number there.
    locator
        Place of the case in that source, such as a section; how its numbers follow from those of the case.
    """

    name: Annotated[str, Field(min_length=1, max_length=100)]
    locator: Annotated[str, Field(max_length=300)] = ""

    @property
    def words(self) -> str:
        """The name and the place, for readers."""
        return f"{self.name}, {self.locator}" if self.locator else self.name


class Known(Model):
    """The known value of one quantity of a case.

    Attributes
    ----------
    quantity
        Name of the quantity.
    value
        In the quantity's unit.
    uncertainty
        Half width of an interval that surely contains the true value, in the same unit. 0 states an exact value: the
        calibration of the gate then counts the whole error against the solver.
    source
        Source of the value: a book and its page, a formula, a measurement, another program.
    tolerance
        The largest error that passes, relative to the value and below 1. It gates every solver that answers with
        default settings. Without it the value is shown and judges nothing.
    absolute
        True if the tolerance is in the quantity's unit instead.
    """

    quantity: Name
    value: Finite
    uncertainty: Annotated[Finite, Field(ge=0)] = 0.0
    source: Annotated[str, Field(min_length=1, max_length=300)]
    tolerance: Positive | None = None
    absolute: Flag = False

    @model_validator(mode="after")
    def _can_judge(self) -> Self:
        if self.tolerance is None:
            return self
        named = f"the known value of '{self.quantity}'"
        if not self.absolute and abs(self.value) <= self.uncertainty:
            raise ValueError(f"{named} may be zero, so that its tolerance needs `absolute = true`")
        if not self.absolute and self.tolerance >= 1:
            raise ValueError(f"{named} has the tolerance {self.tolerance:g}, but a relative one must be less than 1")
        least = SHARPER * self.uncertainty / (1 if self.absolute else abs(self.value))
        if self.tolerance < least:
            raise ValueError(
                f"{named} is uncertain by {self.uncertainty:g}, so that its tolerance must be at least {least:g}, not"
                f" {self.tolerance:g}"
            )
        return self


def check_known(known: Iterable[Known], quantities: Iterable[str]) -> None:
    """Raise ValueError if a known value has no quantity of the case, or if two have the same quantity."""
    names, seen = tuple(quantities), set()
    for one in known:
        if one.quantity not in names:
            raise ValueError(f"a known value is of '{one.quantity}', which is no quantity; they are {', '.join(names)}")
        if one.quantity in seen:
            raise ValueError(f"two known values are of '{one.quantity}'; one must judge it")
        seen.add(one.quantity)
