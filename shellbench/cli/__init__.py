"""The command line: ``shellbench list | run | table | gate | baseline | report | export | check-solver``.

Exit codes: 0 good; 1 a gate fell short or a run failed; 2 bad input or usage; 130 interrupted (the shell's own).
Every error is one sentence on standard error. Each command imports what it needs when it is called: nothing for
``--help``. Solvers are imported by `run`, `export` and `list`, and by `gate` where a record is missing.
"""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from shellbench.cli.compare import compare_command
from shellbench.cli.judge import baseline_command, export, gate_command, report, table
from shellbench.cli.options import INTERRUPTED, say
from shellbench.cli.solve import check_solver_command, list_command, run
from shellbench.errors import ShellbenchError

__all__ = ["INTERRUPTED", "app", "main"]

app = typer.Typer(
    name="shellbench",
    help="How right is this thin-shell solver, and what does it cost?\n\n"
    "Cases are declared once, solved by every solver that is asked for, and the answers held against known values.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from shellbench import __version__

        typer.echo(f"shellbench {__version__}")
        raise typer.Exit


@app.callback()
def shellbench(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Take what is common to all commands."""


app.command("list")(list_command)
app.command()(run)
app.command()(table)
app.command("gate")(gate_command)
app.command("compare")(compare_command)
app.command("baseline")(baseline_command)
app.command()(report)
app.command()(export)
app.command("check-solver")(check_solver_command)


def main() -> None:
    """Run the program; errors become one sentence and their exit code."""
    try:
        app()
    except ShellbenchError as error:
        say(" ".join(str(error).split()))
        sys.exit(error.exit_code)
