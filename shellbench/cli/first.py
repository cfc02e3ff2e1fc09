"""The commands of the first minute: ``quick``, ``doctor``, ``new-case`` and ``new-solver``."""

from __future__ import annotations

import textwrap
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from shellbench.cli.options import CASES, DEFAULT_STORE, StoreOption, WideOption, text_width, warn
from shellbench.cli.solve import carry_out

DOCTORED = ("square_plate", "fem")  # what `doctor` solves
UNBROKEN: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
NEXT = """\
What next:
  shellbench report             a page with all tables, figures and 3-D views
  shellbench list               what else there is; with a NAME, all about it
  shellbench new-case mine      a shell of your own, from a template
  shellbench new-solver mine    a solver of your own, from a template"""


def quick(store: StoreOption = DEFAULT_STORE, wide: WideOption = False) -> None:
    """Solve the suite `quick` by fem and ndf-ritz, and print the table and the verdict.

    `run --quick` makes the same runs, and `check-solver --quick` solves the same cases with another solver. Runs with
    a valid record are kept.
    """
    from shellbench.bench.judge import compare, verdicts
    from shellbench.bench.judge.expected import Scope
    from shellbench.bench.judge.gate import gate
    from shellbench.bench.run.local import LocalProcesses
    from shellbench.bench.run.plan import QUICK_SUITE, Request
    from shellbench.bench.store import environment
    from shellbench.bench.store.store import Store
    from shellbench.report.sections import tables

    began, where, width = time.monotonic(), Store(store), text_width(wide)
    suites = (QUICK_SUITE,)
    request = Request(suites=suites, threads=1)
    code = carry_out(request, where, LocalProcesses(environment.cores(), 1))
    rows, notes = compare.rows_and_notes(where, suites)
    warn(notes)
    typer.echo()
    typer.echo(tables.render(rows, "text", width=width))
    verdict = gate(where, None, Scope(suites))
    _echo(verdicts.in_short(verdict), width)
    typer.echo(f"{time.monotonic() - began:.0f} s; the records are in {store}\n\n{NEXT}")
    raise typer.Exit(code or (0 if verdict.good() else 1))


def doctor(store: StoreOption = DEFAULT_STORE) -> None:
    """Check this machine: versions, threads, BLAS, GPU, memory, disk, solvers, and a solve of one second.

    The answer of the solve is compared with its known value. A line begins with ok, note (it works, with a remark) or
    BAD. The exit code is 1 if something is BAD.
    """
    from shellbench.bench.judge.doctor import examine
    from shellbench.bench.store.store import Store

    bad, width = 0, text_width(wide=False)
    for line in examine(Store(store), *DOCTORED):
        _echo(str(line), width)
        bad += line.state == "BAD"
    typer.echo(f"{bad} BAD: `shellbench --verbose doctor` says more" if bad else "this machine is fit")
    raise typer.Exit(1 if bad else 0)


def _echo(text: str, width: int | None) -> None:
    """Print lines, broken between words where a width is given."""
    for line in text.splitlines():
        typer.echo(line if width is None else textwrap.fill(line, width, subsequent_indent=" " * 6, **UNBROKEN))


def new_case(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the case: letters, digits, _ and -.")],
    like: Annotated[
        str | None,
        typer.Option("--like", metavar="CASE", help="Begin with this case; see `shellbench list`.", **CASES),
    ] = None,
    mesh: Annotated[
        Path | None,
        typer.Option("--mesh", metavar="FILE", help="Surface: a mesh (.obj, .ply, .vtu) with texture coordinates."),
    ] = None,
) -> None:
    """Write a complete case into NAME.toml in this folder, for you to edit.

    Examples
    --------
        shellbench new-case my_shell && shellbench run my_shell.toml --quick

        shellbench new-case my_roof --like scordelis_lo

        shellbench new-case vault --mesh vault.obj
    """
    from shellbench.bench.catalogue.templates import write_case
    from shellbench.errors import InputError

    if like is not None and mesh is not None:
        raise InputError("--mesh and --like exclude each other: a case begins with one of them")
    path = write_case(name, like, Path(), mesh)
    typer.echo(f"{path} is written. What next:")
    typer.echo(f"  shellbench list {path}             what it asks")
    typer.echo(f"  shellbench run {path} --quick      solve it by fem and ndf-ritz")
    typer.echo(f"  shellbench table {path}            their answers, side by side")


def new_solver(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the solver: small letters, digits, - and _.")],
    command: Annotated[
        bool, typer.Option("--command", help="A solver that is a command in any language, instead of a package.")
    ] = False,
) -> None:
    """Write a package with a solver of your own into the folder NAME: a plate by a double sine series, ready to run.

    Replace its mechanics by yours and keep the rest. The README of the folder lists the files of both. With --command
    the folder has a file NAME.toml that describes a command, and a script around CalculiX that it calls.

    Examples
    --------
        shellbench new-solver mine

        shellbench new-solver --command mine && shellbench run scordelis_lo@naghdi_soft --solver mine/mine.toml
    """
    from shellbench.bench.catalogue.templates import write_command, write_solver

    if command:
        path = write_command(name, Path())
        typer.echo(f"{path} is written, and beside it the script that it calls. What next:")
        typer.echo(f"  shellbench run scordelis_lo@naghdi_soft --solver {path}   needs the program ccx (CalculiX)")
        typer.echo(f"  shellbench table --solver {path}                          its answer beside the known value")
        return
    folder = write_solver(name, Path())
    typer.echo(f"{folder}/ is written. What next:")
    typer.echo(f'  python -m pip install --editable "{folder}[test]"')
    typer.echo(f"  shellbench check-solver {folder.name} --quick      check it against the protocol, and grade it")
    typer.echo(f"  shellbench run square_plate --solver {folder.name}")
    typer.echo(f"  {folder}/README.md                          the purpose of each file")
