"""Suites: which solvers, settings and seeds run on the cases that belong together."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from shellbench.conditions import Name
from shellbench.errors import InputError
from shellbench.model import Model, one_sentence, read_toml

Seed = Annotated[int, Field(ge=0, le=2**31 - 1, strict=True)]


class SuiteRun(Model):
    """One line of a suite: a solver with its settings and seeds.

    Attributes
    ----------
    cases
        Names of the cases it is for; all cases of the suite if empty.
    label
        What tables call it beside the solver's name, such as "GELU".
    """

    solver: str
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)] = (0,)
    settings: dict[str, Any] = Field(default_factory=dict)
    cases: tuple[Name, ...] = ()
    label: str = ""


class Suite(Model):
    """A named set of runs; the cases say themselves to which suites they belong.

    Attributes
    ----------
    order
        Names of cases in the order of tables and figures; the others follow by name.
    """

    name: Name
    title: str
    order: tuple[Name, ...] = ()
    runs: Annotated[tuple[SuiteRun, ...], Field(min_length=1)]


def read_suite(path: Path) -> Suite:
    """Read a suite file; InputError in one sentence if it is malformed."""
    try:
        return Suite.model_validate({**read_toml(path), "name": path.stem})
    except ValidationError as error:
        raise InputError(f"{path}: {one_sentence(error)}") from None
