"""The command line: ``shellbench list | run | table | gate | baseline | report | export | check-solver``.

Exit codes: 0 good; 1 a gate fell short or a run failed; 2 bad input or usage; 130 interrupted (the shell's own).
Every error is one sentence on standard error. Each command imports what it needs when it is called: nothing for
``--help``. Solvers are imported by `run`, `export` and `list`, and by `gate` where a record is missing.
"""

from __future__ import annotations

import contextlib
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from shellbench.errors import InputError, ShellbenchError

if TYPE_CHECKING:
    from shellbench.bench.execute import Executor, Outcome
    from shellbench.bench.plan import Plan

INTERRUPTED = 130  # what shells say of a program that Ctrl-C has ended
LARGEST_SEED = 2**31 - 1
DEFAULT_STORE = Path("reports/runs")
DEFAULT_REPORT = Path("reports/latest")
DEFAULT_BASELINE = Path("reports/baseline.json")


class Device(StrEnum):
    """Where to run."""

    cpu = "cpu"
    cuda = "cuda"


class Format(StrEnum):
    """How to print a table."""

    text = "text"
    markdown = "markdown"
    latex = "latex"
    csv = "csv"
    json = "json"


StoreOption = Annotated[Path, typer.Option("--store", metavar="DIR", help="Folder of the records.")]
SuiteOption = Annotated[
    list[str] | None, typer.Option("--suite", metavar="NAME", help="Suite; may be repeated. See `shellbench list`.")
]
SolverOption = Annotated[
    list[str] | None, typer.Option("--solver", metavar="NAME", help="Solver; may be repeated. See `shellbench list`.")
]
SeedOption = Annotated[
    list[int] | None,
    typer.Option("--seed", metavar="N", min=0, max=LARGEST_SEED, help="Seed of the random numbers; may be repeated."),
]
CasesArgument = Annotated[
    list[str] | None, typer.Argument(metavar="[CASE|PATH.toml]...", help="Only these cases, of all that were run.")
]
BaselineOption = Annotated[
    Path, typer.Option("--baseline", metavar="FILE", help="What the regression and cost gates remember.")
]

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


@app.command("list")
def list_command(
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
) -> None:
    """List the cases, the suites and the solvers, with what each needs."""
    from shellbench.bench import listing

    typer.echo(listing.as_json() if json else listing.as_text())


@app.command()
def run(
    cases: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE|PATH.toml]...", help="Names of cases, or paths to case files of your own."),
    ] = None,
    suite: SuiteOption = None,
    solver: SolverOption = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="SOLVER.KEY=VALUE",
            help="A setting of a solver, its value in TOML (2, 1e-6, true, [1, 2], text); may be repeated.",
        ),
    ] = None,
    seed: SeedOption = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "-j",
            metavar="N",
            min=1,
            max=1024,
            help="Runs at a time. Default: as many as fit on the cores; with --scheduler, on those of all workers.",
        ),
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option("--threads", metavar="N", min=1, max=1024, help="Threads of each run. Default: two."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            metavar="ADDRESS",
            help="Run on this Dask cluster: address (tcp://host:8786) or scheduler file. Default: on this machine.",
        ),
    ] = None,
    device: Annotated[Device, typer.Option("--device", help="Where to run solvers that offer it.")] = Device.cpu,
    store: StoreOption = DEFAULT_STORE,
    force: Annotated[bool, typer.Option("--force", help="Run again what has a record already.")] = False,
    timeout: Annotated[
        float | None, typer.Option("--timeout", metavar="S", help="Stop a run, that run only, after so many seconds.")
    ] = None,
) -> None:
    """Solve cases and keep the answers as records.

    Name cases, suites or both. A suite runs the solvers, settings and seeds that it declares; --solver narrows it
    to those, --seed and --set replace what it declares. A case without a suite runs as its first suite declares,
    a case of your own with every solver of the obstacle course.

    What has a record already is kept, so a run that was interrupted goes on where it stopped; failed runs are
    tried again. `run` does not judge the answers: `gate` does.

    The exit code is 1 if a run failed, or if a solver says of its answer that it has not settled: that answer is
    recorded with its value and uncertainty, and no gate passes it.

    Examples
    --------
        shellbench run --suite obstacle_course

        shellbench run scordelis_lo --solver fem --solver ndf-ritz --seed 0 --seed 1

        shellbench run my_shell.toml --solver fem --set fem.tolerance=1e-7
    """
    from rich.console import Console

    from shellbench.bench.display import display
    from shellbench.bench.execute import execute
    from shellbench.bench.identity import parse_setting
    from shellbench.bench.plan import Request, make_plan
    from shellbench.bench.store import Store

    if timeout is not None and not 0 < timeout < float("inf"):
        raise typer.BadParameter("must be a positive number of seconds", param_hint="'--timeout'")
    given: dict[str, dict[str, Any]] = {}
    for text in settings or ():
        name, key, value = parse_setting(text)
        given.setdefault(name, {})[key] = value
    request = Request(
        cases=tuple(cases or ()),
        suites=tuple(suite or ()),
        solvers=tuple(solver or ()),
        settings=given,
        seeds=tuple(dict.fromkeys(seed or ())),
        device=device.value,
        threads=threads,
    )
    where = Store(store)
    contents = where.read()
    _warn(contents.damaged)
    outcomes: list[Outcome] = []
    try:
        with contextlib.closing(_executor(scheduler, jobs, threads, timeout)) as executor:
            plan = make_plan(request, contents, force, executor.expect)
            _warn(plan.notes)
            for declined in plan.declined:
                _say(f"{declined.case} {declined.solver}: not applicable: {declined.reason}")
            with display(Console(), len(plan.tasks)) as observer:
                outcomes = execute(plan.tasks, where, observer, executor)
    except KeyboardInterrupt:
        _say("interrupted: what had ended is kept, and the same command goes on from there")
        raise typer.Exit(INTERRUPTED) from None
    raise typer.Exit(_summary(plan, outcomes))


def _executor(scheduler: str | None, jobs: int | None, threads: int | None, timeout: float | None) -> Executor:
    if scheduler is not None:
        from shellbench.bench.cluster import DaskCluster

        return DaskCluster(scheduler, jobs, threads, timeout, _say)
    from shellbench.bench import environment
    from shellbench.bench.local import LocalProcesses

    each = threads or environment.threads()
    return LocalProcesses(jobs or max(1, environment.cores() // each), each, timeout)


def _summary(plan: Plan, outcomes: list[Outcome]) -> int:
    """Print how the runs ended, and return the exit code."""
    from shellbench.bench.display import run_name
    from shellbench.bench.record import NOT_SETTLED

    refused = [outcome for outcome in outcomes if outcome.record is None]
    bad = [outcome.record for outcome in outcomes if outcome.record and outcome.record.status != "ok"]
    for outcome in refused:
        _say(f"{run_name(outcome.task)}: refused: {outcome.refused}")
    for record in (*bad, *plan.unsettled):
        _say(f"{run_name(record)}: {record.status}: {record.reason}")
    moving = sum(record.status == NOT_SETTLED for record in bad)
    kept = f"kept from before{f' ({len(plan.unsettled)} of them {NOT_SETTLED})' if plan.unsettled else ''}"
    counts = [
        (len(outcomes) - len(bad) - len(refused), "solved"),
        (moving, NOT_SETTLED),
        (len(bad) - moving, "failed"),
        (len(refused), "refused"),
        (len(plan.kept), kept),
        (len(plan.declined), "not applicable"),
    ]
    typer.echo(", ".join(f"{count} {what}" for count, what in counts if count) or "nothing to run")
    return 2 if refused else 1 if bad or plan.unsettled else 0


@app.command()
def table(
    cases: CasesArgument = None,
    store: StoreOption = DEFAULT_STORE,
    format: Annotated[Format, typer.Option("--format", help="How to print it.")] = Format.text,
    suite: SuiteOption = None,
) -> None:
    """Print the displacements, the known values beside them, the errors and what each answer cost.

    Shown is what was run, each run once; with --suite, all of its runs that there are.

    JSON is a list of objects, one for each case, solver, settings, seed and quantity; the other formats print the
    headline quantity of each case.
    """
    from shellbench.bench import compare
    from shellbench.bench.gate import check_filled
    from shellbench.bench.store import Store

    check_filled(Store(store))
    rows, notes = compare.rows_and_notes(Store(store), tuple(suite or ()), tuple(cases or ()))
    _warn(notes)
    if format is Format.json:
        typer.echo(compare.as_json(rows))
        return
    from shellbench.report import tables

    if not rows:
        _say(f"store {store} has no records that count of what was asked for: make some by `shellbench run`")
    typer.echo(tables.render(rows, cast(Any, format.value), store=Store(store), whole=bool(suite)), nl=False)
    if rows and format in {Format.text, Format.markdown} and not suite and (more := compare.beyond(rows)):
        typer.echo(f"\n{more}")


@app.command("gate")
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
    """Judge the records: exit 0 only if every gate holds.

    Judged is what was run; what was planned and did not end is red. With --suite, all that it gates is judged, and a
    gated row without a record is red. Cases, --solver and --seed narrow what is judged, and it says so. If nothing
    is judged, the exit code is 2.

    Accuracy holds each quantity against its known value at the tolerance frozen for the solver. The lock holds cases,
    known values and tolerances: what makes the exam easier is red. Regression holds a figure against the baseline.
    Cost compares seconds, memory and parameters with the baseline's, between runs on like hardware. The latter two
    are reported, and count only if asked for.
    """
    from shellbench.bench import verdicts
    from shellbench.bench.baseline import read_baseline
    from shellbench.bench.expected import Scope
    from shellbench.bench.gate import gate
    from shellbench.bench.store import Store

    scope = Scope(
        tuple(dict.fromkeys(suite or ())),
        tuple(dict.fromkeys(solver or ())),
        tuple(dict.fromkeys(seed or ())),
        tuple(dict.fromkeys(cases or ())),
    )
    verdict = gate(Store(store), read_baseline(baseline), scope)
    _warn(verdict.warnings)
    typer.echo(verdicts.as_text(verdict, str(baseline), cost=cost, verbose=verbose, regression=regression))
    raise typer.Exit(0 if verdict.good(cost, regression) else 1)


@app.command("baseline")
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
    """Show how the records differ from the baseline, and with --write make them the new one.

    Only runs whose gated rows all hold can be remembered. Runs outside of --suite and --solver stay as they were.
    What values differ by from those of --like widens what the regression gate allows.
    """
    from shellbench.bench import baseline as baselines
    from shellbench.bench import verdicts
    from shellbench.bench.expected import Scope
    from shellbench.bench.gate import move_baseline
    from shellbench.bench.store import Store

    scope = Scope(tuple(suite or ()), tuple(solver or ()))
    where, old = Store(store), baselines.read_baseline(baseline)
    _warn(where.read().damaged)
    new = move_baseline(where, old, scope, tuple(map(Store, like or ())))
    typer.echo(verdicts.changes(old, new))
    if write:
        baselines.write_baseline(new, baseline)
        typer.echo(f"written to {baseline}: commit it with the reason")


@app.command()
def report(
    cases: CasesArgument = None,
    store: StoreOption = DEFAULT_STORE,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to write.")] = DEFAULT_REPORT,
    suite: SuiteOption = None,
    for_print: Annotated[bool, typer.Option("--print/--no-print", help="Figures for print too, as PDF.")] = True,
    paper: Annotated[
        Path | None,
        typer.Option(
            "--paper",
            metavar="DIR",
            help="Instead of the page write this folder for LaTeX: a booktabs file for each table, figures as PDF, "
            "bibliography, and a document that shows them all.",
        ),
    ] = None,
) -> None:
    """Write the report: tables in Markdown, CSV, LaTeX and HTML, figures, and a page that shows them.

    It is about what was run; with --suite, about that suite. Records are all it needs: no solver has to be installed.
    """
    from shellbench.bench import compare
    from shellbench.bench.gate import check_filled, missing_rows
    from shellbench.bench.store import Store
    from shellbench.report import page

    check_filled(Store(store))
    rows, notes = compare.rows_and_notes(Store(store), tuple(suite or ()), tuple(cases or ()))
    _warn(notes)
    rows += missing_rows(Store(store), rows, tuple(suite or ()), tuple(cases or ()))
    if not rows:
        raise InputError(f"store {store}: holds no records that count of what was asked for")
    if paper is not None:
        if out != DEFAULT_REPORT:
            raise typer.BadParameter("name one folder: --out for the page, or --paper", param_hint="'--paper'")
        from shellbench.report.paper import write_paper

        typer.echo(f"written to {write_paper(Store(store), rows, paper, whole=bool(suite), say=_note)}")
        return
    written = page.write_report(Store(store), rows, out, for_print=for_print, whole=bool(suite), say=_note)
    typer.echo(f"written to {written}")


@app.command()
def export(
    case: Annotated[str, typer.Argument(metavar="CASE|PATH.toml", help="Name of a case, or path to one of your own.")],
    solver: Annotated[str, typer.Option("--solver", metavar="NAME", help="Whose solution.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="File to write: .npz (arrays), .obj (deformed shape) or .vtu.")
    ],
    resolution: Annotated[
        int, typer.Option("--resolution", metavar="N", min=2, max=5000, help="Points a side of the grid.")
    ] = 101,
    scale: Annotated[float, typer.Option("--scale", metavar="X", help="Factor of the displacement in .obj.")] = 1.0,
    at: Annotated[
        float | None, typer.Option("--at", metavar="T", help="Time (s) or kept state of a path; the last if not given.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", metavar="N", min=0, max=LARGEST_SEED, help="Which seed's solution.")
    ] = None,
    store: StoreOption = DEFAULT_STORE,
) -> None:
    """Write a stored solution, sampled as finely as you like, for another program.

    The grid's points have displacement (m), strains (covariant components 11, 22, 12) and energy densities (J/m2). In
    .vtu the shell is undeformed, and viewers warp it by the displacement; .obj is the deformed shape.

    Examples
    --------
        shellbench export scordelis_lo --solver fem --out roof.vtu --resolution 201

        shellbench export napkin_plane --solver fem --out napkin.obj --at 0.5
    """
    from shellbench.bench import export as exports
    from shellbench.bench.store import Store

    exports.writer_of(out)
    where = Store(store)
    stored = exports.stored_run(where, case, solver, seed, _note)
    sampled = exports.sample(where, stored, resolution, at)
    exports.export(sampled, out, scale)
    typer.echo(f"written to {out}")


@app.command("check-solver")
def check_solver_command(
    solver: Annotated[str, typer.Argument(metavar="NAME", help="Solver to check; see `shellbench list`.")],
    cases: Annotated[
        list[str] | None,
        typer.Option("--case", metavar="CASE|PATH.toml", help="Case to solve; may be repeated. Default: a cheap one."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SOLVER.KEY=VALUE", help="A setting of the solver; may be repeated."),
    ] = None,
    refine: Annotated[
        str | None,
        typer.Option(
            "--refine", metavar="KEY=V;V;V", help="Values of a setting from coarse to fine, to measure a rate by."
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
    timeout: Annotated[
        float, typer.Option("--timeout", metavar="S", min=1, help="Seconds that the solver has for one answer.")
    ] = 600.0,
) -> None:
    """Check that a solver keeps the protocol: one line a check, exit 1 if one fails.

    Asked are, among others, continuous answers, determinism, units, rigid motions, a rate of convergence, energies,
    and honest counts of parameters and bytes. A solver that crashes or hangs fails the check in which it does.

    Examples
    --------
        shellbench check-solver fem

        shellbench check-solver mine --case scordelis_lo --refine "cells=[8, 8];[16, 16];[32, 32]"
    """
    from shellbench.testing.suite import check_solver

    code = check_solver(solver, cases or (), settings or (), refine=refine, seconds=timeout, as_json=json)
    raise typer.Exit(code)


def _say(sentence: str) -> None:
    """Write one line to standard error."""
    typer.echo(f"shellbench: {sentence}", err=True)


def _note(sentence: str) -> None:
    _say(f"note: {sentence}")


def _warn(sentences: tuple[str, ...]) -> None:
    for sentence in sentences:
        _note(sentence)


def main() -> None:
    """Run the program; errors become one sentence and their exit code."""
    try:
        app()
    except ShellbenchError as error:
        _say(" ".join(str(error).split()))
        sys.exit(error.exit_code)
