"""The command ``judge``, which compares results of any program with known values."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import typer

from shellbench.cli.options import CASES, Format, WideOption, note, say, text_width, warn


def judge_command(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="answers.csv, or nodal results (.vtu, .csv, .dat); a file for each mesh."),
    ],
    case: Annotated[
        str | None, typer.Option("--case", metavar="CASE", help="Case that nodal results answer.", **CASES)
    ] = None,
    units: Annotated[
        str | None, typer.Option("--units", metavar="UNITS", help="Units of nodal results: m-N-Pa, mm-N-MPa, ...")
    ] = None,
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="Name in tables.")] = "",
    program: Annotated[str, typer.Option("--program", metavar="TEXT", help="Program, with its version.")] = "",
    element: Annotated[str, typer.Option("--element", metavar="TEXT", help="Element.")] = "",
    theory: Annotated[
        str | None,
        typer.Option("--theory", metavar="NAME", help="Theory that judges, such as naghdi_soft; measured by default."),
    ] = None,
    size: Annotated[
        float | None, typer.Option("--class", metavar="X", min=0, help="Exit with 1 if a relative error exceeds this.")
    ] = None,
    store: Annotated[
        Path | None, typer.Option("--store", metavar="DIR", help="Keep the values there, marked as stated.")
    ] = None,
    format: Annotated[Format, typer.Option("--format", help="How to print it.")] = Format.text,
    wide: WideOption = False,
) -> None:
    """Compare values or nodal results of any program with known values, and tell which limit the program tends to.

    `shellbench sheet CASE` writes the answers.csv to fill in. Nodal results are a .vtu with displacements, a .csv of
    x, y, z, ux, uy, uz, or a .dat of CalculiX beside the sheet's .vtu. The mesh may be a symmetric part of the shell.

    With --store, the values on the finest mesh are kept as stated results. Tables show them as such, and no gate takes
    them. The exit code is 0 if everything was judged, 1 if --class is missed, 2 for bad input.

    Examples
    --------
        shellbench judge answers.csv --program "Abaqus 2024" --element S4R

        shellbench judge coarse.vtu fine.vtu finest.vtu --case scordelis_lo --units mm-N-MPa --class 1e-2
    """
    from shellbench.bench.stated.answers import read_sources
    from shellbench.bench.stated.judging import Author, judge_answers, store_records
    from shellbench.bench.store.store import Store
    from shellbench.report.sections.stated import table

    found = judge_answers(read_sources(files, case, units), Author(name, program, element), theory)
    warn(found.warnings)
    shown = table(found.judged, name or " ".join(filter(None, (program, element))))
    if format is Format.json:
        typer.echo(shown.data.to_json(orient="records", indent=1))
    else:
        typer.echo(shown.write(cast(Any, format.value), text_width(wide)), nl=False)
    if store is not None:
        store_records(found, Store(store))
        kept = ", ".join(record.case_name for record in found.records)
        note(f"kept in {store} as '{found.records[0].identity.solver}' for {kept}")
    missed = found.missed(size) if size is not None else []
    for one in missed:
        say(f"{one.rows[-1].case} {one.rows[-1].quantity} misses class {size:g}")
    raise typer.Exit(1 if missed else 0)
