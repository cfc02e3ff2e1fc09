"""The commands for existing runs: ``table``, ``gate``, ``baseline``, ``report`` and ``export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import typer

from shellbench.cli.options import (
    CASES,
    DEFAULT_BASELINE,
    DEFAULT_REPORT,
    DEFAULT_STORE,
    LARGEST_SEED,
    SOLVERS,
    BaselineOption,
    CasesArgument,
    Format,
    SeedOption,
    SolverOption,
    StoreOption,
    SuiteOption,
    WideOption,
    note,
    say,
    text_width,
    warn,
)
from shellbench.errors import InputError

FRAMES = 49  # default number of states of a series


def table(
    cases: CasesArgument = None,
    store: StoreOption = DEFAULT_STORE,
    format: Annotated[Format, typer.Option("--format", help="How to print it.")] = Format.text,
    suite: SuiteOption = None,
    solver: SolverOption = None,
    wide: WideOption = False,
) -> None:
    """Print the headline values, the known values, the errors and the cost of each answer.

    The table has all runs, each once; with --suite, all existing runs of this suite; with --solver, those of it.

    JSON is a list of objects, one for each case, solver, settings, seed and quantity; the other formats print the
    headline quantity of each case.
    """
    from shellbench.bench.judge import compare
    from shellbench.bench.judge.gate import check_filled
    from shellbench.bench.store.store import Store

    check_filled(Store(store))
    rows, notes = compare.rows_and_notes(Store(store), tuple(suite or ()), tuple(cases or ()))
    rows = [row for row in rows if not solver or row.solver in solver]
    warn(notes)
    if format is Format.json:
        typer.echo(compare.as_json(rows))
        return
    from shellbench.report.sections import tables

    if not rows:
        say(f"store {store} has no valid records of the requested cases; `shellbench run` makes them")
    shown = tables.render(rows, cast(Any, format.value), whole=bool(suite), width=text_width(wide))
    typer.echo(shown, nl=False)
    if rows and format in {Format.text, Format.markdown} and not suite and (more := compare.missing_runs(rows)):
        typer.echo(f"\n{more}")


def gate_command(
    cases: CasesArgument = None,
    store: StoreOption = DEFAULT_STORE,
    suite: SuiteOption = None,
    solver: SolverOption = None,
    seed: SeedOption = None,
    cost: Annotated[bool, typer.Option("--cost", help="Let the cost gate count as well.")] = False,
    regression: Annotated[bool, typer.Option("--regression", help="Let the regression gate count as well.")] = False,
    baseline: BaselineOption = DEFAULT_BASELINE,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Print the green rows too.")] = False,
) -> None:
    """Judge the records: exit 0 only if every gate passes.

    The gate judges all runs. A planned run that did not end is red. With --suite, every gated value of this suite is
    judged, and a gated row without a record is red. Cases, --solver and --seed restrict the judgement, and the output
    lists the restrictions. The exit code is 2 if nothing is judged.

    Accuracy compares each quantity with its known value, at the solver's frozen tolerance. The lock protects cases,
    known values and tolerances of the judged suites: changes that make the exam easier are red. Regression compares
    values with the baseline. Cost compares seconds, memory and parameters with the baseline, between runs on equal
    hardware. Regression and cost are reported, and count only with --regression and --cost.
    """
    from shellbench.bench.catalogue import catalog
    from shellbench.bench.judge import verdicts
    from shellbench.bench.judge.baseline import read_baseline
    from shellbench.bench.judge.expected import Scope
    from shellbench.bench.judge.gate import gate
    from shellbench.bench.store.store import Store

    scope = Scope(
        tuple(dict.fromkeys(suite or ())),
        tuple(dict.fromkeys(solver or ())),
        tuple(dict.fromkeys(seed or ())),
        tuple(dict.fromkeys(cases or ())),
    )
    if baseline == DEFAULT_BASELINE and not baseline.exists():  # outside of the repository
        baseline = catalog.shipped_baseline()
    verdict = gate(Store(store), read_baseline(baseline), scope)
    warn(verdict.warnings)
    typer.echo(verdicts.as_text(verdict, str(baseline), cost=cost, verbose=verbose, regression=regression))
    raise typer.Exit(0 if verdict.good(cost, regression) else 1)


def baseline_command(
    store: StoreOption = DEFAULT_STORE,
    suite: SuiteOption = None,
    solver: SolverOption = None,
    write: Annotated[
        bool, typer.Option("--write", help="Move the baseline; without it, only show the changes.")
    ] = False,
    baseline: BaselineOption = DEFAULT_BASELINE,
    like: Annotated[
        list[Path] | None,
        typer.Option("--like", metavar="DIR", help="Store of the same runs from another processor; may be repeated."),
    ] = None,
) -> None:
    """Show the differences of the records from the baseline, and with --write make them the new baseline.

    Only runs whose gated rows all pass can be stored. Entries outside of --suite and --solver stay unchanged.
    Differences from the values of --like widen the band of the regression gate.
    """
    from shellbench.bench.judge import baseline as baselines
    from shellbench.bench.judge import verdicts
    from shellbench.bench.judge.expected import Scope
    from shellbench.bench.judge.gate import move_baseline
    from shellbench.bench.store.store import Store

    scope = Scope(tuple(suite or ()), tuple(solver or ()))
    where, old = Store(store), baselines.read_baseline(baseline)
    warn(where.read().damaged)
    new = move_baseline(where, old, scope, tuple(map(Store, like or ())))
    typer.echo(verdicts.changes(old, new))
    if write:
        baselines.write_baseline(new, baseline)
        typer.echo(f"written to {baseline}: commit it with the reason")


def report(
    cases: CasesArgument = None,
    store: StoreOption = DEFAULT_STORE,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write.")] = DEFAULT_REPORT,
    suite: SuiteOption = None,
    for_print: Annotated[bool, typer.Option("--print/--no-print", help="Figures for print too, as PDF.")] = True,
    paper: Annotated[
        Path | None,
        typer.Option(
            "--paper", metavar="DIR", help="Write a folder for LaTeX instead: tables, PDF figures, a document."
        ),
    ] = None,
) -> None:
    """Write the report: tables in Markdown, CSV, LaTeX and HTML, figures, and a page that shows them.

    The report has all runs; with --suite, those of this suite. It needs only records: no solver has to be installed.
    """
    from shellbench.bench.judge import compare
    from shellbench.bench.judge.gate import check_filled, missing_rows
    from shellbench.bench.store.store import Store
    from shellbench.report.page import page

    check_filled(Store(store))
    rows, notes = compare.rows_and_notes(Store(store), tuple(suite or ()), tuple(cases or ()))
    warn(notes)
    rows += missing_rows(Store(store), rows, tuple(suite or ()), tuple(cases or ()))
    if not rows:
        raise InputError(f"store {store}: has no valid records of the requested cases")
    if paper is not None:
        if out != DEFAULT_REPORT:
            raise typer.BadParameter("name one folder: --out for the page, or --paper", param_hint="'--paper'")
        from shellbench.report.page.paper import write_paper

        typer.echo(f"written to {write_paper(Store(store), rows, paper, whole=bool(suite), say=note)}")
        return
    written = page.write_report(Store(store), rows, out, for_print=for_print, whole=bool(suite), say=note)
    typer.echo(f"written to {written}")


def export(
    case: Annotated[
        str, typer.Argument(metavar="CASE|PATH.toml", help="Name of a case, or path to one of your own.", **CASES)
    ],
    solver: Annotated[str, typer.Option("--solver", metavar="NAME", help="Whose solution.", **SOLVERS)],
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="FILE", help="File: .npz, .obj, .vtu; of a motion .pvd. .vtu, .pvd need the extra 'vtk'."
        ),
    ],
    resolution: Annotated[
        int, typer.Option("--resolution", metavar="N", min=2, max=5000, help="Points a side of the grid.")
    ] = 101,
    scale: Annotated[float, typer.Option("--scale", metavar="X", help="Factor of the displacement in .obj.")] = 1.0,
    at: Annotated[
        float | None, typer.Option("--at", metavar="T", help="Time (s) or kept state of a path; the last if not given.")
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option("--frames", metavar="N", min=2, max=1000, help="States of a motion to write; a path writes all."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", min=0, max=LARGEST_SEED, help="Which seed's solution.")
    ] = None,
    store: StoreOption = DEFAULT_STORE,
) -> None:
    """Write a stored solution, sampled at any resolution, for another program.

    The grid's points have displacement (m), strains (covariant components 11, 22, 12) and energy densities (J/m2). In
    .vtu the shell is undeformed, and viewers warp it by the displacement; .obj is the deformed shape.

    A motion, or the states of a path, is a series: .pvd lists numbered .vtu files with their times; with --frames the
    other formats become numbered files.

    Examples
    --------
        shellbench export scordelis_lo --solver fem --out roof.vtu --resolution 201

        shellbench export napkin_plane --solver fem --out napkin.obj --at 0.5

        shellbench export skirt --solver fem --out skirt.pvd --resolution 201 --frames 100
    """
    from shellbench.bench.store import export as exports
    from shellbench.bench.store import frames as series
    from shellbench.bench.store.store import Store

    many = frames is not None or out.suffix in series.SERIES
    if many and at is not None:
        raise InputError(f"--at {at:g}: {out} holds a series of states, so that one time does not apply")
    if out.suffix not in series.SERIES:
        exports.writer_of(out, series.SERIES)
    where = Store(store)
    stored = exports.stored_run(where, case, solver, seed, note)
    if not many:
        exports.export(exports.sample(where, stored, resolution, at), out, scale)
        typer.echo(f"written to {out}")
        return
    states = exports.samples(where, stored, resolution, exports.marks_of(stored, frames or FRAMES))
    count = series.export_series(states, out, scale)
    typer.echo(f"written to {out if out.suffix in series.SERIES else series.numbered_file(out, 0)}: {count} states")
