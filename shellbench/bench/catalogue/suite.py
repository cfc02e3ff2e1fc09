"""Suites: cases that belong together, with the solvers, settings and seeds that run on them.

A line may sweep over the values of one setting. It then stands for one line for each value.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from shellbench.errors import InputError
from shellbench.problem import VARIANT, CaseName
from shellbench.protocol.schema import Flag, Model, Name, one_sentence, read_toml

Study = Name
"""Topic of a suite that is no comparison of solvers; a section of the report is about one."""

Seed = Annotated[int, Field(ge=0, le=2**31 - 1, strict=True)]


class SuiteRun(Model):
    """One line of a suite: a solver with its settings and seeds.

    Attributes
    ----------
    cases
        Names of its cases; all cases of the suite if empty.
    variants
        True if it includes the suite's variants.
    label
        Name in tables after the solver's name, such as "GELU".
    """

    solver: str
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)] = (0,)
    settings: dict[str, Any] = Field(default_factory=dict)
    cases: tuple[Name, ...] = ()
    variants: Flag = True
    label: str = ""

    def is_for(self, case: str) -> bool:
        """Return True if this run applies to a case or variant of the given name."""
        base, _, variant = case.partition(VARIANT)
        return (not self.cases or base in self.cases) and (self.variants or not variant)


class AskedVariants(Model):
    """Variants of a suite beside its cases: equivalent statements of the same questions.

    Attributes
    ----------
    suites
        Suites whose cases have the variants; the suite's own cases if empty.
    drawn
        Number of variants that are drawn for each case; all if it is left out.
    seed
        Seed of the draw.
    named
        Variants by name, such as ``scordelis_lo@oblique``; the suite then has no others.
    """

    named: tuple[CaseName, ...] = ()
    suites: tuple[Name, ...] = ()
    drawn: Annotated[int, Field(ge=1, strict=True)] | None = None
    seed: Seed = 0


class Suite(Model):
    """A named set of runs; each case names its suites itself.

    Attributes
    ----------
    order
        Names of cases in the order of tables and figures; the others follow by name.
    extends
        The suite of another package to which the runs, cases and remarks of this file are added.
    cases
        Cases of other packages that it asks; its own say so themselves.
    study
        Its study; its runs are shown in the section of that study, not in the tables of displacements.
    variants
        The variants that it asks; none if it is left out.
    remarks
        Remarks on its solvers or cases, sentences for the sections that show them.
    newton
        By case in motion: its series that the finding on Newton's law shows.
    rolled, turned
        Of an ablation of strain measures: the case that is bent into an arc, and the one that is turned unstrained.
    """

    name: Name
    title: str
    extends: Name | None = None
    cases: tuple[Name, ...] = ()
    study: Study | None = None
    variants: AskedVariants | None = None
    remarks: tuple[str, ...] = ()
    order: tuple[Name, ...] = ()
    newton: dict[Name, Name] = Field(default_factory=dict)
    rolled: Name | None = None
    turned: Name | None = None
    runs: Annotated[tuple[SuiteRun, ...], Field(min_length=1)]

    def runs_for(self, case: str) -> tuple[SuiteRun, ...]:
        """Return the lines that are for a case."""
        return tuple(run for run in self.runs if run.is_for(case))


def read_suite(path: Path) -> Suite:
    """Read a suite file; InputError in one sentence if it is malformed."""
    data = read_toml(path)
    try:
        if isinstance(data.get("runs"), list):
            data["runs"] = [line for number, run in enumerate(data["runs"]) for line in swept(run, f"runs.{number}")]
        data["name"] = path.stem
        return Suite.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{path}: {one_sentence(error, data)}") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def swept(run: Any, where: str) -> list[Any]:
    """Return one line for each value of a sweep, or the line itself.

    Raises
    ------
    ValueError
        If `sweep` is no table of one setting with a list of values.
    """
    if not isinstance(run, dict) or "sweep" not in run:
        return [run]
    rest = {key: value for key, value in run.items() if key != "sweep"}
    match run["sweep"], run.get("settings", {}), run.get("label", ""):
        case dict(sweep), dict(settings), str(label) if len(sweep) == 1 and settings.keys().isdisjoint(sweep):
            key, values = next(iter(sweep.items()))
            if isinstance(values, list) and values and all(values.count(value) == 1 for value in values):
                prefix = f"{label}, " if label else ""
                return [
                    {**rest, "settings": {**settings, key: value}, "label": f"{prefix}{key} {value_words(value)}"}
                    for value in values
                ]
    raise ValueError(
        f"{where}.sweep: found {run['sweep']!r}, but it must be one setting, not among the line's settings, with a list"
        " of different values"
    )


def value_words(value: Any) -> str:
    """Say a value of a setting as tables do: pairs as 8×8."""
    match value:
        case list() | tuple():
            return "×".join(map(value_words, value))
        case float():
            return f"{value:.4g}"
    return str(value)
