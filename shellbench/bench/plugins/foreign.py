"""Kinds of problem of other packages, as data for the judging process.

Quantities of their solutions are measured in the process of the solver. This module has names, units and digests.
Reports show the figures that exist for every kind of problem.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, PrivateAttr, ValidationError, create_model

from shellbench.bench.plugins.outside import outsider
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.errors import InputError, PluginError
from shellbench.problem import Kind, Problem, Quantity, Variant
from shellbench.protocol.sample import Sample
from shellbench.protocol.schema import one_sentence


class Described(BaseModel):
    """Facts that a kind states of itself; see `shellbench.bench.plugins.inside.AskedKind`."""

    model_config = ConfigDict(strict=True)

    theories: list[str]
    variants: dict[str, str]
    headline: str
    headlines: dict[str, str]
    samples: bool
    exam: list[str]
    quick: list[str]


class Told(BaseModel):
    """Data that describe a problem; see `shellbench.bench.plugins.inside.problem_facts`."""

    model_config = ConfigDict(strict=True)

    fields: dict[str, Any]
    quantities: list[dict[str, Any]]
    digest: str
    data: dict[str, Any]
    shown: dict[str, Any]
    states: list[float]
    marks: dict[str, str]


class Data(BaseModel):
    """Data of any form."""

    model_config = ConfigDict(extra="allow")


class ForeignQuantity(Quantity):
    """A quantity that another process measures."""

    kind: str = ""
    stated_mark: float | None = None
    stated_error: bool = False

    @property
    def is_an_error(self) -> bool:  # type: ignore[override] # of each quantity, for there is one class for all
        """True if its value is itself an error."""
        return self.stated_error

    @property
    def mark(self) -> float | None:
        """The mark of its state."""
        return self.stated_mark


class ForeignProblem(Problem):
    """A problem of a kind that is loaded in another process; each kind has its own class, with its theories."""

    entry: ClassVar[SolverEntry]

    quantities: tuple[ForeignQuantity, ...]
    _told: Told = PrivateAttr()

    @classmethod
    def build(cls, data: Mapping[str, Any], name: str, where: str) -> Self:
        """Make a problem of parsed data; see `shellbench.problem.Problem`."""
        told = outsider("kind", cls.entry).ask(Told, "build", dict(data), name, where)
        return cls._of(told, name, data, where)

    @classmethod
    def model_validate(cls, obj: Any, **_: Any) -> Self:
        """Make a problem again of its data."""
        data = dict(obj)
        told = outsider("kind", cls.entry).ask(Told, "rebuild", data)
        return cls._of(told, str(data.get("name", "")), data, f"problem of kind '{cls.entry.name}'")

    @classmethod
    def _of(cls, told: Told, name: str, data: Mapping[str, Any], where: str) -> Self:
        # Name and known values are taken from the file itself, because they judge.
        quantities = [
            one | {"stated_mark": one.pop("mark", None), "stated_error": one.pop("is_an_error", False)}
            for one in map(dict, told.quantities)
        ]
        own = {"name": name, "kind": cls.entry.name, "known": data.get("known", ()), "quantities": quantities}
        try:
            found = super().model_validate(told.fields | own)
        except ValidationError as error:
            raise PluginError(f"{where}: what its kind tells of it can't be used: {one_sentence(error)}") from None
        found._told = told
        return found

    @property
    def states(self) -> tuple[float, ...]:
        """Marks at which the answer is kept."""
        return tuple(self._told.states)

    def mark_words(self, mark: float) -> str:
        """Return the words for a mark."""
        return self._told.marks.get(repr(float(mark)), super().mark_words(mark))

    def digest(self) -> str:
        """Return the digest of the physics."""
        return self._told.digest

    def data(self) -> dict[str, Any]:
        """Return the problem as JSON data from which it can be rebuilt."""
        return self._told.data

    def shown(self) -> dict[str, Any]:
        """Return the data of the problem that readers see."""
        return self._told.shown


def kind(entry: SolverEntry) -> Kind:
    """Return the stand-in of a kind; PluginError in one sentence if it does not answer."""
    found = outsider("kind", entry).ask(Described, "describe")
    theory: Any = (Literal[tuple(found.theories)], ...) if found.theories else (str, ...)
    problem: type[ForeignProblem] = create_model(f"Problem_{entry.name}", __base__=ForeignProblem, theory=theory)
    problem.entry = entry
    return Kind(
        problem=problem,
        keep=lambda solution, case: None,
        variants={name: Variant(words, variant(entry, name)) for name, words in found.variants.items()},
        sample=sample if found.samples else None,
        headline=found.headline,
        headlines=found.headlines,
        exam=tuple(found.exam),
        quick=tuple(found.quick),
    )


def sample(solution: Any, resolution: int, at: float | None, title: str) -> Sample:
    """Refuse to sample a solution.

    Its own process samples it, see `shellbench.bench.plugins.outside.AskedSolver.sample`.
    """
    raise InputError(f"{title}: only a solver of another package answers this kind of problem")


def variant(entry: SolverEntry, name: str) -> Callable[[Problem], dict[str, Any]]:
    """Return the function that makes the data of a variant."""
    return partial(_variant, entry, name)


def _variant(entry: SolverEntry, name: str, case: Problem) -> dict[str, Any]:
    return outsider("kind", entry).ask(Data, "variant", {**case.data(), "name": case.name}, name).model_dump()
