"""Known values, each with its theory, its source and its uncertainty.

Tolerances: the largest errors that a solver is allowed, by case and quantity.

The tolerances in references/tolerances/<solver>.toml are frozen: gates judge by them, and nothing widens them. A
plug-in may have a file of the same kind beside its module, tolerances/<solver>.toml. These tolerances are its claim:
they are shown, and no gate uses them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from shellbench.errors import InputError
from shellbench.problem import CaseName, Problem, Quantity
from shellbench.protocol.schema import Finite, Model, Name, Positive, one_sentence, read_toml

KnownTheory = Annotated[str, Field(pattern=r"^[a-z]+(-[a-z]+)*$")]
Read = TypeVar("Read")
Role = Literal["judge", "origin", "literature", "published"]
"""judge: decides; origin: an independent second derivation of it; literature: the figure usually quoted;
published: what a paper reports of its own solver."""


class KnownValue(Model):
    """One value of one quantity of a case.

    Attributes
    ----------
    value, uncertainty
        In the quantity's own unit; the uncertainty is the half width of an interval that surely contains the true
        value, null if unknown.
    origin
        Origin of the value (a series, an engine, a measurement), in a few words.
    source
        Key in references/bibliography.bib.
    locator
        Place in the source: table, equation, page.
    label
        What a table calls it, such as "GELU" for an ablation.
    """

    quantity: Name
    role: Role
    value: Finite
    uncertainty: Annotated[Finite, Field(ge=0)] | None = None
    theory: KnownTheory
    origin: str
    source: str
    locator: str = ""
    label: str = ""
    note: str = ""


class KnownCurve(Model):
    """A tabulated load-displacement curve of one quantity of a case.

    Attributes
    ----------
    loads, values
        Load factors and the quantity in its own unit, in the order of the path; as many of one as of the other.
    label
        What a figure calls it; the source if empty.
    """

    quantity: Name
    role: Literal["origin", "literature", "published"] = "literature"
    theory: KnownTheory
    origin: str
    source: str
    locator: str = ""
    label: str = ""
    note: str = ""
    loads: tuple[Finite, ...] = Field(min_length=1)
    values: tuple[Finite, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _pairs(self) -> KnownCurve:
        if len(self.loads) != len(self.values):
            raise ValueError(f"the curve of {self.quantity} has {len(self.loads)} loads but {len(self.values)} values")
        return self


class KnownValues(Model):
    """All known values and tabulated curves of a case."""

    values: tuple[KnownValue, ...] = ()
    curves: tuple[KnownCurve, ...] = ()

    def judge(self, quantity: str, theory: str) -> KnownValue | None:
        """Return the value that judges a quantity in a theory, if there is one."""
        for value in self.values:
            if value.role == "judge" and value.quantity == quantity and value.theory == theory:
                return value
        return None

    def of(self, quantity: str, *roles: Role) -> tuple[KnownValue, ...]:
        """Return the values of a quantity that have one of the roles."""
        return tuple(v for v in self.values if v.quantity == quantity and v.role in roles)

    @model_validator(mode="after")
    def _one_judge_each(self) -> KnownValues:
        judges = [(v.quantity, v.theory) for v in self.values if v.role == "judge"]
        for quantity, theory in judges:
            if judges.count((quantity, theory)) > 1:
                raise ValueError(f"two values judge {quantity} under {theory}; one must")
        return self


def read_known_values(path: Path) -> KnownValues:
    """Read a file of known values.

    Raises
    ------
    InputError
        In one sentence with the file and the field.
    """
    return _read(path, KnownValues.model_validate)


def _read(path: Path, make: Callable[[Any], Read]) -> Read:
    data = read_toml(path)
    try:
        return make(data)
    except ValidationError as error:
        raise InputError(f"{path}: {one_sentence(error, data)}") from None


FOLDER = "tolerances"


class Tolerance(Model):
    """The largest admissible error of one quantity.

    Attributes
    ----------
    relative
        Relative to the known value; below 1, or the answer zero would pass. A number alone in the file is this.
    absolute
        Instead, in the quantity's unit.
    open_finding
        Reason why it is known to be exceeded. Such a row is an expected failure, and red once it passes.
    variants
        If it is known to be exceeded in some variants of the case only: the reason by variant.
    """

    relative: Annotated[Positive, Field(lt=1)] | None = None
    absolute: Positive | None = None
    open_finding: Annotated[str, Field(min_length=1)] | None = None
    variants: dict[Name, Annotated[str, Field(min_length=1)]] | None = None

    @model_validator(mode="before")
    @classmethod
    def _a_number_is_relative(cls, data: Any) -> Any:
        return data if isinstance(data, Mapping) else {"relative": data}

    @model_validator(mode="after")
    def _is_one_number(self) -> Self:
        if (self.relative is None) == (self.absolute is None):
            raise ValueError("it must have one of `relative` and `absolute`")
        return self

    @property
    def largest(self) -> float:
        """The largest admissible error, relative or in the quantity's unit."""
        found = self.relative if self.absolute is None else self.absolute
        assert found is not None
        return found

    @property
    def is_absolute(self) -> bool:
        """True if the tolerance is in the quantity's unit."""
        return self.absolute is not None

    def of_variant(self, name: str) -> Self:
        """Return the tolerance for a variant; an empty name means the case as declared."""
        found = (self.variants or {}).get(name, self.open_finding)
        return self.model_copy(update={"open_finding": found, "variants": None})

    def __str__(self) -> str:
        return f"{self.largest:g} {'absolute' if self.is_absolute else 'relative'}"


Tolerances = dict[CaseName, dict[Name, Tolerance]]
"""By case and quantity."""

_READER = TypeAdapter(Tolerances)


def read_tolerances(path: Path) -> Tolerances:
    """Read a file of tolerances.

    Raises
    ------
    InputError
        In one sentence with the file and the field.
    """
    return _read(path, _READER.validate_python)


def allowed_by_file(case: Problem, quantity: Quantity) -> Tolerance | None:
    """Return the tolerance that a user's case file sets on a quantity for every solver; None if it sets none."""
    for one in case.known:
        if one.quantity == quantity.name and one.tolerance is not None:
            return Tolerance.model_validate({"absolute" if one.absolute else "relative": one.tolerance})
    return None
