"""Shared parts of commands: options, exit codes, and messages on standard error."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

LEAST_WIDTH = 60  # smallest width of a table, in characters
LARGEST_SEED = 2**31 - 1
DEFAULT_STORE = Path("reports/runs")
DEFAULT_REPORT = Path("reports/latest")
DEFAULT_BASELINE = Path("reports/baseline.json")


class Device(StrEnum):
    """Where to run."""

    cpu = "cpu"
    cuda = "cuda"


class Format(StrEnum):
    """Format of a table."""

    text = "text"
    markdown = "markdown"
    latex = "latex"
    csv = "csv"
    json = "json"


def _complete_cases(incomplete: str) -> list[str]:
    from shellbench.bench.catalogue import catalog

    return [name for name in catalog.case_names() if name.startswith(incomplete)]


def _complete_suites(incomplete: str) -> list[str]:
    from shellbench.bench.catalogue import catalog

    return [name for name in catalog.suite_names() if name.startswith(incomplete)]


def _complete_solvers(incomplete: str) -> list[str]:
    from shellbench.bench.plugins.registry import solver_entries

    return [name for name in solver_entries() if name.startswith(incomplete)]


def _complete_names(incomplete: str) -> list[str]:
    return [*_complete_cases(incomplete), *_complete_suites(incomplete), *_complete_solvers(incomplete)]


def _named_solvers(value: Any) -> Any:
    """Return names of solvers, with a path to a file of one replaced by its name."""
    from shellbench.bench.plugins.registry import name_of

    return name_of(value) if isinstance(value, str) else value and list(map(name_of, value))


# Completions for the tabulator key (`shellbench --install-completion`).
CASES, SUITES, NAMES = ({"autocompletion": one} for one in (_complete_cases, _complete_suites, _complete_names))
SOLVERS: dict[str, Any] = {"autocompletion": _complete_solvers, "callback": _named_solvers}
StoreOption = Annotated[Path, typer.Option("--store", metavar="DIR", help="Folder of the records.")]
SuiteOption = Annotated[
    list[str] | None,
    typer.Option("--suite", metavar="NAME", help="Suite; may be repeated. See `shellbench list`.", **SUITES),
]
SolverOption = Annotated[
    list[str] | None,
    typer.Option(
        "--solver",
        metavar="NAME|PATH.toml",
        help="Solver, or the file of one that is a command; may be repeated. See `shellbench list`.",
        **SOLVERS,
    ),
]
SettingOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="SOLVER.KEY=VALUE",
        help="A setting of a solver, its value in TOML (2, 1e-6, true, [1, 2], text); may be repeated.",
    ),
]
SeedOption = Annotated[
    list[int] | None,
    typer.Option("--seed", metavar="N", min=0, max=LARGEST_SEED, help="Seed of the random numbers; may be repeated."),
]
CasesArgument = Annotated[
    list[str] | None,
    typer.Argument(metavar="CASE|PATH.toml", help="Only these cases, of all that were run.", **CASES),
]
BaselineOption = Annotated[
    Path, typer.Option("--baseline", metavar="FILE", help="Baseline of --regression and --cost.")
]
WideOption = Annotated[bool, typer.Option("--wide", help="Show all columns, even if they do not fit the terminal.")]


def text_width(wide: bool) -> int | None:
    """Return the width of a table: that of the terminal; None, for any width, without a terminal."""
    if wide or not (sys.stdout.isatty() or os.environ.get("COLUMNS")):
        return None
    return max(LEAST_WIDTH, shutil.get_terminal_size().columns)


def say(sentence: str) -> None:
    """Write one line to standard error."""
    typer.echo(f"shellbench: {sentence}", err=True)


def note(sentence: str) -> None:
    """Write a note to standard error."""
    say(f"note: {sentence}")


def warn(sentences: tuple[str, ...]) -> None:
    """Write notes, one line each."""
    for sentence in sentences:
        note(sentence)


def settings_of(texts: Sequence[str] | None) -> dict[str, dict[str, Any]]:
    """Return settings by solver from the values of `--set`; InputError if one is malformed."""
    from shellbench.bench.plugins.settings import parse_setting

    given: dict[str, dict[str, Any]] = {}
    for text in texts or ():
        name, key, value = parse_setting(text)
        given.setdefault(name, {})[key] = value
    return given
