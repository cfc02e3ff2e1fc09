"""Kinds of problem by name, found through the entry-point group ``shellbench.problems``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from shellbench.bench.plugins.registry import SolverEntry, registered
from shellbench.errors import InputError
from shellbench.problem import Kind, Problem
from shellbench.protocol.picture import Portrait
from shellbench.protocol.schema import read_toml

GROUP = "shellbench.problems"
DEFAULT = "shell"


@cache  # cached, as `find_kind`: the installed packages do not change
def kind_entries() -> dict[str, SolverEntry]:
    """Return the entry points of the kinds, by name."""
    return registered(GROUP, "kind of problem")


def load_here() -> None:
    """Let this process load kinds of other packages; it must run their solvers and judge nothing."""
    _LOADED_HERE.append(True)


_LOADED_HERE: list[bool] = []


@cache
def find_kind(name: str) -> Kind:
    """Return a kind of problem; a stand-in (`shellbench.bench.plugins.foreign`) for one of another package.

    Raises
    ------
    InputError
        If there is none, or it can't be imported.
    """
    entries = kind_entries()
    if name not in entries:
        raise InputError(f"field 'kind': found {name!r}, but it must be {' or '.join(map(repr, entries))}")
    if not entries[name].own and not _LOADED_HERE:
        # The name is computed, because the stand-in of a kind measures nothing and must not be part of its digest.
        stand_in: Kind = import_module(f"{__package__}.foreign").kind(entries[name])
        return stand_in
    module, _, attribute = entries[name].target.partition(":")
    try:
        kind = getattr(import_module(module), attribute)
    except Exception as error:  # a plug-in's import can raise anything
        raise InputError(f"problems of kind '{name}' can't be used: {' '.join(str(error).split())}") from error
    if not isinstance(kind, Kind):
        raise InputError(f"problems of kind '{name}' can't be used: {entries[name].target} is no Kind")
    return kind


def kinds_of_theories(theories: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the kinds whose problems can ask for one of these theories; the default's if none can."""
    asked, entries = set(theories), kind_entries()
    ours = {theory for name, entry in entries.items() if entry.own for theory in find_kind(name).theories}
    # a kind of another package is loaded only for theories that no built-in kind has
    looked_into = [name for name, entry in entries.items() if entry.own or asked - ours]
    return tuple(name for name in looked_into if asked & set(find_kind(name).theories)) or (DEFAULT,)


def headline_of(name: str, unit: str) -> str:
    """Return the name of a kind's headline quantities in this unit; a general one if the kind is not installed."""
    try:
        kind = find_kind(name or DEFAULT)
        return kind.headlines.get(unit, kind.headline)
    except InputError:
        return Kind.headline


def kind_name(data: Mapping[str, Any]) -> str:
    """Return the name of the kind of a problem's data."""
    return str(data.get("kind", DEFAULT))


def kind_of(data: Mapping[str, Any]) -> Kind:
    """Return the kind of a problem's data."""
    return find_kind(kind_name(data))


def module_of(kind: str) -> str:
    """Return the module of a kind: its code determines the content of records."""
    entry = kind_entries().get(kind)
    return entry.module if entry else ""


def read_problem(path: Path) -> Problem:
    """Read and check a case file of any kind; InputError in one sentence."""
    data = read_toml(path)
    if "command" in data:
        raise InputError(f"{path}: describes a solver, not a case: give it after --solver")
    try:
        kind = kind_of(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return kind.problem.build(data, name=path.stem, where=str(path))


def problem_of(data: Mapping[str, Any]) -> Problem:
    """Rebuild a problem from `Problem.data`.

    Raises
    ------
    ValidationError
        If it is malformed.
    InputError
        If its kind is not installed.
    """
    return kind_of(data).problem.model_validate(data)


def portrait_of_named(case: Problem) -> Portrait:
    """Return the portrait of a problem."""
    return find_kind(case.kind).portrait(case)
