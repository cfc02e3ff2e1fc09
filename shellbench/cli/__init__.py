"""The command line: ``shellbench list | run | table | gate | compare | ...``.

Exit codes: 0 success; 1 a gate or a run failed; 2 bad input or usage; 130 interrupted (the shell's own).
Every error is one sentence on standard error. Each command imports its modules when it is called, and none for
``--help``. `run`, `export` and `list` import solvers, and `gate` does so if a record is missing.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable
from inspect import cleandoc
from typing import Annotated, Any

import typer

from shellbench.cli.brought import Command, CommandsOfOthers
from shellbench.cli.compare import compare_command
from shellbench.cli.first import doctor, new_case, new_solver, quick
from shellbench.cli.judge import baseline_command, export, gate_command, report, table
from shellbench.cli.options import say
from shellbench.cli.passport import passport_command
from shellbench.cli.share import board, pack
from shellbench.cli.sheet import sheet
from shellbench.cli.solve import check_solver_command, list_command, run
from shellbench.cli.stated import judge_command
from shellbench.errors import InputError, Interrupted, ShellbenchError, without_middle

__all__ = ["app", "main"]

VERBOSE = "--verbose"
LONGEST_ARGUMENT = 4096  # characters: no path is longer
USAGE_ERROR: Any = typer.BadParameter.__base__  # that of all wrong options; typer does not export it

app = typer.Typer(
    name="shellbench",
    cls=CommandsOfOthers,
    help="Measure the accuracy and the cost of thin-shell solvers.\n\n"
    "Each case is declared once and solved by several solvers. Their answers are compared with known values.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from shellbench import __version__

        typer.echo(f"shellbench {__version__}")
        raise typer.Exit


def _unwrapped(text: str) -> str:
    """Return a docstring, each paragraph on one line: the help breaks lines where the terminal ends."""
    parts = cleandoc(text).replace("\n--------\n", ":\n\n").split("\n\n")
    return "\n\n".join(part if part.startswith(" ") else " ".join(part.split()) for part in parts)


@app.callback()
def shellbench(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    verbose: Annotated[
        bool, typer.Option(VERBOSE, help="Before COMMAND: print also where an error came from.")
    ] = False,
) -> None:
    """Read the options that all commands share."""


COMMANDS: dict[str, Callable[..., Any]] = {
    "quick": quick,
    "doctor": doctor,
    "list": list_command,
    "run": run,
    "table": table,
    "judge": judge_command,
    "gate": gate_command,
    "compare": compare_command,
    "baseline": baseline_command,
    "report": report,
    "export": export,
    "sheet": sheet,
    "pack": pack,
    "board": board,
    "check-solver": check_solver_command,
    "passport": passport_command,
    "new-case": new_case,
    "new-solver": new_solver,
}
for name, command in COMMANDS.items():
    app.command(name, cls=Command, help=_unwrapped(command.__doc__ or ""))(command)


def main() -> None:
    """Run the program; errors become one sentence and their exit code."""
    try:
        for number, argument in enumerate(sys.argv[1:], 1):
            if len(argument) > LONGEST_ARGUMENT:
                found = f"argument {number}, {without_middle(argument)!r}, has {len(argument)} characters"
                raise InputError(f"{found}; it may have at most {LONGEST_ARGUMENT}")
        code = app(prog_name="shellbench", standalone_mode=False)
        if code == Interrupted.exit_code:  # wherever Ctrl-C was caught, even while arguments are read
            say("interrupted")
        sys.exit(code)
    except USAGE_ERROR as error:
        from typer.rich_utils import rich_format_error

        error.message = _quoting_little(error.message)
        rich_format_error(error)
        sys.exit(InputError.exit_code)
    except ShellbenchError as error:
        if VERBOSE in sys.argv[1:2]:
            traceback.print_exc()
        say(_quoting_little(str(error)))
        sys.exit(error.exit_code)
    except OSError as error:
        if error.filename is None:
            raise
        say(f"{without_middle(os.fsdecode(error.filename))}: can't be used ({error.strerror})")
        sys.exit(InputError.exit_code)


def _quoting_little(sentence: str) -> str:
    """Return a sentence on one line, with long words shortened."""
    return " ".join(map(without_middle, sentence.split()))
