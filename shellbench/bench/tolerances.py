"""Tolerances: the largest errors that a solver is allowed, by case and quantity.

What references/tolerances/<solver>.toml says is frozen: gates judge by it, and nothing else widens it. A plug-in may
have a file of the same kind beside its module, tolerances/<solver>.toml. That is its claim: it is shown, and no gate
takes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from shellbench.bench.registry import SolverEntry
from shellbench.bench.source import locate
from shellbench.errors import InputError
from shellbench.model import Model, Name, Positive, one_sentence, read_toml

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
        Why it is known to be exceeded. Such a row is an expected failure, and red once it passes.
    """

    relative: Annotated[Positive, Field(lt=1)] | None = None
    absolute: Positive | None = None
    open_finding: Annotated[str, Field(min_length=1)] | None = None

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
        """Whether it is in the quantity's unit."""
        return self.absolute is not None

    def __str__(self) -> str:
        return f"{self.largest:g} {'absolute' if self.is_absolute else 'relative'}"


Tolerances = dict[Name, dict[Name, Tolerance]]
"""By case and quantity."""

_READER = TypeAdapter(Tolerances)


def read_tolerances(path: Path) -> Tolerances:
    """Read a file of tolerances.

    Raises
    ------
    InputError
        In one sentence with the file and the field.
    """
    data = read_toml(path)
    try:
        return _READER.validate_python(data)
    except ValidationError as error:
        raise InputError(f"{path}: {one_sentence(error, data)}") from None


def claimed(entry: SolverEntry) -> Tolerances:
    """Return what a solver claims of itself; nothing if it has no such file. The solver is not imported."""
    module = locate(entry.module)
    path = module.parent / FOLDER / f"{entry.name}.toml" if module else None
    return read_tolerances(path) if path and path.is_file() else {}
