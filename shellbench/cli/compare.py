"""The command ``compare``, which compares runs of two times, or two solvers."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from shellbench.cli.options import (
    CASES,
    DEFAULT_STORE,
    SOLVERS,
    SolverOption,
    StoreOption,
    SuiteOption,
    WideOption,
    text_width,
    warn,
)

SIDE = "STORE|PACK|SOLVER|COMMIT"


class ComparisonFormat(StrEnum):
    """Format of a comparison."""

    text = "text"
    markdown = "markdown"
    json = "json"


def compare_command(
    a: Annotated[str, typer.Argument(metavar="A", help=f"What was: {SIDE}.", **SOLVERS)],
    b: Annotated[str, typer.Argument(metavar="B", help=f"What is: {SIDE}.", **SOLVERS)],
    case: Annotated[
        list[str] | None,
        typer.Option("--case", metavar="CASE|PATH.toml", help="Only this case; may be repeated.", **CASES),
    ] = None,
    suite: SuiteOption = None,
    solver: SolverOption = None,
    store: StoreOption = DEFAULT_STORE,
    format: Annotated[
        ComparisonFormat, typer.Option("--format", help="How to print it; Markdown is for a pull request.")
    ] = ComparisonFormat.text,
    threshold: Annotated[
        float,
        typer.Option(
            "--threshold",
            metavar="X",
            min=0.0,
            help="An error that grew by more than X is a loss: relative to the known value (0.01 is one per cent "
            "of it). The default is the tightest class of accuracy.",
        ),
    ] = 1e-4,
    seconds: Annotated[
        float | None,
        typer.Option("--seconds", metavar="RATIO", min=1.0, help="A run over RATIO times A's seconds is a loss, too."),
    ] = None,
    memory: Annotated[
        float | None,
        typer.Option("--memory", metavar="RATIO", min=1.0, help="A run over RATIO times A's memory is a loss, too."),
    ] = None,
    gone: Annotated[bool, typer.Option("--gone", help="A run that only A has is a loss, too.")] = False,
    every: Annotated[bool, typer.Option("--all", help="Print all values, not only headlines and differences.")] = False,
    wide: WideOption = False,
) -> None:
    """Compare two sides: values, errors, seconds, memory, and runs that only one of them has.

    A side is a folder of records, a pack (FILE.zip), a solver with runs in --store, or a commit that made runs there
    (its first digits, or a name for git, as HEAD~1). Solvers are compared with solvers, at default settings. All other
    sides are compared run by run, with any state of the code.

    Exit 1 if B has a loss: a run that ended worse (ok, not settled, failed), a frozen tolerance that it no longer
    passes, or an error that grew by more than --threshold. An error within three uncertainties of the known value
    counts as zero. Without a known value, a value can only change. Ratios of seconds and memory count only with
    --seconds and --memory, and only between equal machines. Exit 2 if nothing can be compared.

    Examples
    --------
        shellbench compare reports/before reports/runs

        shellbench compare fem ndf-ritz --suite obstacle_course

        shellbench compare main HEAD --format markdown --seconds 1.5
    """
    from shellbench.bench.judge.changes import Limits, as_json, compare_sides
    from shellbench.bench.judge.sides import Scope, read_sides
    from shellbench.bench.store.store import Store

    scope = Scope(tuple(case or ()), tuple(suite or ()), tuple(solver or ()))
    before, after = read_sides(a, b, Store(Path(store)), scope)
    found = compare_sides(before, after, Limits(threshold, seconds, memory))
    warn(found.notes)
    if format is ComparisonFormat.json:
        typer.echo(as_json(found))
    else:
        from shellbench.report.page import changes

        shown = (
            changes.as_markdown(found)
            if format is ComparisonFormat.markdown
            else changes.as_text(found, text_width(wide), every)
        )
        typer.echo(shown, nl=False)
    raise typer.Exit(0 if found.good(gone) else 1)
