"""Problems for solvers. A kind of problem derives its own from this one."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from pydantic import Field, ValidationError, model_validator

from shellbench.errors import InputError
from shellbench.protocol.known_value import Known, OtherName, check_known
from shellbench.protocol.notebook import case_html
from shellbench.protocol.quantity import FULL, Quantity
from shellbench.protocol.schema import LONGEST_TITLE, Model, Name, check_sizes, one_sentence, read_toml

VARIANT = "@"  # between a case's name and its variant's
CaseName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*(@[a-z_]+)?$", max_length=80)]


class Problem(Model):
    """A question for solvers.

    A kind of problem derives its own from this class, with the fields of its file; `quantities` is one of them.

    Attributes
    ----------
    name
        Stem of the file; records and known values refer to it. A file does not give it.
    kind
        Kind of problem: the name of its entry point.
    title
        One line, for tables and figures.
    description
        The question and its source, in prose.
    also_known_as
        Names under which others know the case.
    suites
        Suites that the case belongs to; a case of your own needs none.
    units
        Units of the file: SI unless it says otherwise (text for tables; nothing is converted).
    theory
        Theory of the answer: known values of another theory do not judge it.
    known
        Known values of its quantities, in a user's own case only: those of built-in cases are in references/.
    """

    not_physics: ClassVar[frozenset[str]] = frozenset(
        {"name", "title", "description", "also_known_as", "suites", "units", "known"}
    )
    not_physics_of_a_quantity: ClassVar[frozenset[str]] = frozenset(
        {"description", "unit", "primary", "tolerance", "absolute", "open_finding"}
    )

    name: CaseName
    kind: str
    title: str = Field(max_length=LONGEST_TITLE)
    description: str = ""
    also_known_as: tuple[OtherName, ...] = ()
    units: str = "SI"
    suites: tuple[Name, ...] = ()
    theory: str
    known: tuple[Known, ...] = ()

    if TYPE_CHECKING:

        @property
        def quantities(self) -> Sequence[Quantity]:
            """The quantities that the problem asks for."""
            ...

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read and check a file.

        Raises
        ------
        InputError
            In one sentence with the file, the field, its value and the allowed values.
        """
        return cls.build(read_toml(path), name=path.stem, where=str(path))

    @classmethod
    def build(cls, data: Mapping[str, Any], name: str, where: str) -> Self:
        """Make a problem of parsed data; `where` stands at the start of error messages."""
        if "name" in data:
            raise InputError(f"{where}: field 'name' is not known here; a case is named by its file")
        if VARIANT in name:
            raise InputError(f"{where}: a case's name can't contain '{VARIANT}', which stands before a variant's")
        whole = {**data, "name": name}
        try:
            check_sizes(whole)
            return cls.model_validate(whole)
        except ValidationError as error:
            raise InputError(f"{where}: {one_sentence(error, whole)}") from None
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    @property
    def base(self) -> str:
        """Name of the case as declared: its own, unless it is a variant."""
        return self.name.partition(VARIANT)[0]

    @property
    def primary(self) -> Quantity:
        """The headline quantity."""
        return next(q for q in self.quantities if q.primary)

    @property
    def states(self) -> tuple[float, ...]:
        """Marks at which the answer is kept, increasing."""
        return tuple(sorted({q.at for q in self.quantities if q.mark is not None}))

    def quantity(self, name: str) -> Quantity:
        """Return the quantity of this name; KeyError if there is none."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity
        raise KeyError(name)

    def mark_words(self, mark: float) -> str:
        """Return the words for a mark, such as "t = 0.25"."""
        return f"t = {mark:.4g}"

    def telling_mark(self, quantity: Quantity) -> str:
        """Return the words for a quantity's mark; empty if all values belong to the full load."""
        mark = quantity.mark
        asked = {other.mark for other in self.quantities} - {None}
        return "" if mark is None or asked == {FULL} else self.mark_words(mark)

    def physics(self) -> dict[str, Any]:
        """Return all data on which an answer depends: no tolerances, suites or prose."""
        data = self.model_dump(mode="json", exclude=set(self.not_physics))
        for quantity in data["quantities"]:
            for name in self.not_physics_of_a_quantity:
                quantity.pop(name, None)
            if quantity["factor"] == 1.0:  # for the digests of cases that were recorded before factors existed
                del quantity["factor"]
        return data

    def digest(self) -> str:
        """Return the hexadecimal SHA-256 of the physics."""
        text = json.dumps(self.physics(), sort_keys=True, allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()

    def without(self, names: Collection[str]) -> Self:
        """Return the same question without some of its quantities, which must not include the headline."""
        data = self.data()
        for part, key in (("quantities", "name"), ("known", "quantity")):
            if part in data:
                data[part] = [one for one in data[part] if one[key] not in names]
        return type(self).model_validate(data)

    def asked_as_well(self) -> Self | None:
        """Return the same question with equivalent data; None if its data are exact.

        The difference of the answers is the data's part of the uncertainty, for instance of a surface that was fitted
        to points.
        """
        return None

    @property
    def remark(self) -> str:
        """A remark on every answer to it, as a clause; may be empty."""
        return ""

    def drifts(self, solution: Any) -> Mapping[str, float]:
        """Return the drifts of values without a limit under refinement of a solver, by quantity, before its factor.

        They are added to the uncertainties that a solver states. An answer has not settled if a drift exceeds a
        hundredth of its value.
        """
        return {}

    @property
    def undecided(self) -> str | None:
        """Return the reason why no solution counts as settled, as a clause about undecidable data, or None."""
        return None

    def check_state(self, at: float) -> None:
        """Raise InputError if solutions have no state at this mark."""

    def data(self) -> dict[str, Any]:
        """Return the problem as JSON data from which it can be rebuilt."""
        return self.model_dump(mode="json", exclude_unset=True)

    def shown(self) -> dict[str, Any]:
        """Return the data of the problem that readers see."""
        return self.data()

    def _repr_html_(self) -> str:
        """Return the HTML that notebooks show."""
        return case_html(self)

    @model_validator(mode="after")
    def _one_quantity_is_primary(self) -> Self:
        names = [quantity.name for quantity in self.quantities]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two of them are called '{name}': quantity names must differ")
        if sum(q.primary for q in self.quantities) != 1:
            raise ValueError("exactly one quantity must be primary")
        check_known(self.known, names)
        return self
