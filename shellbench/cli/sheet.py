"""The command for a person with another program: ``sheet``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shellbench.cli.options import CASES, SuiteOption, warn

DEFAULT_SHEET = Path("reports/sheet")


def sheet(
    cases: Annotated[
        list[str] | None,
        typer.Argument(metavar="CASE|PATH.toml", help="Cases, variants and files of your own.", **CASES),
    ] = None,
    suite: SuiteOption = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write.")] = DEFAULT_SHEET,
    cells: Annotated[
        list[int] | None,
        typer.Option(
            "--cells",
            metavar="N",
            min=1,
            max=1024,
            help="Cells across a mesh; may be repeated. Default: three meshes, each with half the cell size.",
        ),
    ] = None,
    units: Annotated[
        str, typer.Option("--units", metavar="U", help="Units, such as m-N-Pa, mm-N-MPa or mm-kN-GPa.")
    ] = "m-N-Pa",
    element: Annotated[
        list[str] | None,
        typer.Option("--element", metavar="NAME", help="S3, S4, S4R, S6 or S8R; may be repeated. Default: S4 and S8R."),
    ] = None,
    whole: Annotated[
        bool, typer.Option("--whole", help="Mesh the whole shell, not the part between planes of symmetry.")
    ] = False,
) -> None:
    """Write cases for a program that shellbench does not know: the question in words, and meshes in its format.

    Each case has a folder with problem.md, a sketch, and meshes of several sizes with supports and loads: .inp (Abaqus,
    CalculiX), .bdf (Nastran, MYSTRAN), .msh (Gmsh), .vtu, and nodal loads as .csv. Answers go into answers.csv; one
    that has been filled in is never overwritten. Shells at rest have sheets. Cases of a suite that have none are noted.

    Examples
    --------
        shellbench sheet scordelis_lo --units mm-N-MPa --out roof

        shellbench sheet square_plate scordelis_lo@naghdi_soft --cells 8 --cells 16 --element S4
    """
    from shellbench.bench.sheet import sheets_of, write_sheets
    from shellbench.protocol.sheet import Request
    from shellbench.report.figures.sketch import draw_sketch

    request = Request(units, tuple(cells or ()), tuple(element or ("S4", "S8R")), whole)
    sheets, notes = sheets_of(tuple(cases or ()), tuple(suite or ()), request)
    warn(notes)
    answers = write_sheets(sheets, out, draw_sketch)
    for one in sheets:
        typer.echo(f"{out / one.name}/: problem.md, sketch.svg and {len(one.files)} files of meshes")
    typer.echo(f"{answers}: {sum(len(one.answers) for one in sheets)} values to fill in. What next:")
    typer.echo(f"  shellbench judge {answers}      compare them with known values")
