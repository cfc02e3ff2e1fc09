"""The commands that use solvers: ``list``, ``run`` and ``check-solver``."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from shellbench.cli.options import (
    CASES,
    DEFAULT_STORE,
    NAMES,
    SOLVERS,
    Device,
    SeedOption,
    SettingOption,
    SolverOption,
    StoreOption,
    SuiteOption,
    WideOption,
    say,
    settings_of,
    text_width,
    warn,
)
from shellbench.errors import InputError, Interrupted, PluginError

if TYPE_CHECKING:
    from shellbench.bench.run.execute import Executor, Outcome
    from shellbench.bench.run.plan import Plan, Request
    from shellbench.bench.store.store import Store


EXECUTORS = "shellbench.executors"  # entry points of packages that make runs elsewhere
QUICK_SOLVERS = ("fem", "ndf-ritz")  # the solver of each kind that takes seconds


def list_command(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME|PATH.toml",
            help="A case, a variant such as CASE@oblique, a suite, a solver, or words.",
            **NAMES,
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
    every: Annotated[bool, typer.Option("--all", help="Print a line for each case instead.")] = False,
    wide: WideOption = False,
) -> None:
    """List suites and solvers by kind of problem; with a name, describe this one.

    A case is described by its question, its known values, and the tolerance of each solver; a suite by its cases and
    runs; a solver by its settings, the cases that it declines, and its tolerances. Other words find cases by their
    titles, and by the names that others use.

    Examples
    --------
        shellbench list scordelis_lo

        shellbench list nafems

        shellbench list scordelis_lo@oblique --json
    """
    from shellbench.bench.catalogue import listing

    with plugins_are_input():
        if name is None:
            text = listing.all_cases if every else listing.overview
            typer.echo(listing.as_json() if json else text(text_width(wide)))
            return
        from shellbench.bench.catalogue import about

        typer.echo(about.as_json(name) if json else about.as_text(name))


@contextlib.contextmanager
def plugins_are_input() -> Iterator[None]:
    """Turn the error of a plug-in that does not answer into bad input, because these commands are about plug-ins."""
    try:
        yield
    except PluginError as error:
        raise InputError(str(error)) from error


def run(
    cases: Annotated[
        list[str] | None,
        typer.Argument(metavar="CASE|PATH.toml", help="Names of cases, or paths to case files of your own.", **CASES),
    ] = None,
    suite: SuiteOption = None,
    solver: SolverOption = None,
    settings: SettingOption = None,
    seed: SeedOption = None,
    start: Annotated[
        str | None,
        typer.Option(
            "--start", metavar="RUN_ID", help="Continue from this earlier run of the solver; its case may be edited."
        ),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Run fem and ndf-ritz, or --solver, with one seed; without cases, the suite `quick`."
        ),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", metavar="N", min=1, max=1024, help="Runs at a time. Default: as the cores allow."),
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option("--threads", metavar="N", min=1, max=1024, help="Threads of each run. Default: two."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler", metavar="ADDRESS", help="Dask cluster to run on: tcp://host:8786 or a scheduler file."
        ),
    ] = None,
    device: Annotated[Device, typer.Option("--device", help="Where to run solvers that offer it.")] = Device.cpu,
    store: StoreOption = DEFAULT_STORE,
    force: Annotated[bool, typer.Option("--force", help="Run again what has a record already.")] = False,
    timeout: Annotated[
        float | None,
        typer.Option("--timeout", metavar="S", help="Stop a run after S seconds of processor time."),
    ] = None,
    verbose: Annotated[
        bool,
        typer.Option("--verbose", "-v", help="Print each step in a pipe, too, and the output of failed runs."),
    ] = False,
) -> None:
    """Solve cases and keep the answers as records.

    Name cases, suites or both. A suite runs its declared solvers, settings and seeds; --solver restricts it to these
    solvers, --seed and --set replace its seeds and settings. A case named without --suite runs as its first suite
    declares; a case of your own runs with every solver of the obstacle course.

    Runs with a valid record are kept, so an interrupted command continues where it stopped. Failed runs are tried
    again. `run` does not judge the answers: `gate` does.

    The exit code is 1 if a run failed, or if a solver states that its answer has not settled. Such an answer is
    recorded with its value and uncertainty, and no gate passes it.

    Examples
    --------
        shellbench run --suite obstacle_course

        shellbench run --quick

        shellbench run scordelis_lo --solver fem --solver ndf-ritz --seed 0 --seed 1

        shellbench run my_shell.toml --solver fem --set fem.tolerance=1e-7

        shellbench run my_shell_thicker.toml --start my_shell-ndf-s0-20260101T120000-0a1b2c3d
    """
    from shellbench.bench.run.plan import QUICK_SUITE, Request
    from shellbench.bench.store.earlier import find_earlier
    from shellbench.bench.store.store import Store

    if timeout is not None and not 0 < timeout < float("inf"):
        raise typer.BadParameter("must be a positive number of seconds", param_hint="'--timeout'")
    where = Store(store)
    earlier = None if start is None else find_earlier(start, where, where.read())
    named = tuple(cases or ())
    request = Request(
        cases=named,
        suites=tuple(suite or ()) if named or suite or not quick else (QUICK_SUITE,),
        solvers=tuple(solver or ((earlier.solver,) if earlier else ())),
        settings=settings_of(settings),
        seeds=tuple(dict.fromkeys(seed or ())),
        device=device.value,
        threads=threads,
        quick=QUICK_SOLVERS if quick else (),
        start=earlier,
    )
    executor = _executor(scheduler, jobs, threads, timeout)
    raise typer.Exit(carry_out(request, where, executor, force=force, verbose=verbose))


def carry_out(request: Request, where: Store, executor: Executor, *, force: bool = False, verbose: bool = False) -> int:
    """Plan and make the runs, and print the result; return the exit code."""
    from rich.console import Console

    from shellbench.bench.run.display import display
    from shellbench.bench.run.execute import execute
    from shellbench.bench.run.plan import make_plan

    contents = where.read()
    warn(contents.damaged)
    outcomes: list[Outcome] = []
    try:
        with contextlib.closing(executor):
            plan = make_plan(request, contents, force, executor.expect)
            warn(plan.notes)
            for declined in plan.declined:
                say(f"{declined.case} {declined.solver}: not applicable: {declined.reason}")
            with display(Console(), len(plan.tasks), verbose) as observer:
                outcomes = execute(plan.tasks, where, observer, executor, None if force else plan.seen, say)
    except KeyboardInterrupt:
        raise Interrupted("interrupted: what had ended is kept, and the same command goes on from there") from None
    code = _summary(plan, outcomes)
    if verbose:
        _print_logs(where, outcomes)
    return code


def _print_logs(where: Store, outcomes: list[Outcome]) -> None:
    """Print the output of runs that did not end well."""
    from shellbench.bench.run.display import run_name
    from shellbench.bench.store.store import LOG

    for outcome in outcomes:
        record = outcome.record
        log = where.file(f"{record.run_id}.{LOG}") if record and record.status != "ok" else None
        if record and log:
            say(f"{run_name(record)} wrote, in {log}:")
            typer.echo(log.read_text(encoding="utf-8", errors="replace").rstrip(), err=True)


def _executor(scheduler: str | None, jobs: int | None, threads: int | None, timeout: float | None) -> Executor:
    if scheduler is not None:
        from shellbench.bench.plugins.registry import load, registered

        found = registered(EXECUTORS, "executor").get("dask")
        if found is None:
            raise InputError("--scheduler needs the plug-in for Dask: python -m pip install ./plugins/dask in a clone")
        executor: Executor = load(found, "executor", lambda make: make(scheduler, jobs, threads, timeout, say))
        return executor
    from shellbench.bench.run.local import LocalProcesses
    from shellbench.bench.store import environment

    each = threads or environment.threads()
    return LocalProcesses(jobs or max(1, environment.cores() // each), each, timeout)


def _summary(plan: Plan, outcomes: list[Outcome]) -> int:
    """Print the results of the runs, and return the exit code."""
    from shellbench.bench.run.display import run_name
    from shellbench.bench.store.record import NOT_SETTLED

    refused = [outcome for outcome in outcomes if outcome.record is None]
    bad = [outcome.record for outcome in outcomes if outcome.record and outcome.record.status != "ok"]
    for outcome in refused:
        say(f"{run_name(outcome.task)}: refused: {outcome.refused}")
    for record in (*bad, *plan.unsettled):
        say(f"{run_name(record)}: {record.status}: {record.reason}")
    taken = sum(outcome.taken and outcome.record not in bad for outcome in outcomes)
    moving = sum(record.status == NOT_SETTLED for record in bad)
    kept = f"kept from before{f' ({len(plan.unsettled)} of them {NOT_SETTLED})' if plan.unsettled else ''}"
    counts = [
        (len(outcomes) - len(bad) - len(refused) - taken, "solved"),
        (taken, "taken from another command"),
        (moving, NOT_SETTLED),
        (len(bad) - moving, "failed"),
        (len(refused), "refused"),
        (len(plan.kept), kept),
        (len(plan.declined), "not applicable"),
    ]
    typer.echo(", ".join(f"{count} {what}" for count, what in counts if count) or "nothing to run")
    return 2 if refused else 1 if bad or plan.unsettled else 0


def check_solver_command(
    solver: Annotated[
        str, typer.Argument(metavar="NAME|PATH.toml", help="Solver to check; see `shellbench list`.", **SOLVERS)
    ],
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
            "--refine", metavar="KEY=V;V;V", help="Values of a setting from coarse to fine, to measure a rate."
        ),
    ] = None,
    quick: Annotated[
        bool,
        typer.Option("--quick", help="Grade by the suite `quick`, which takes a minute; ropes by `rope`."),
    ] = False,
    suite: Annotated[
        list[str] | None,
        typer.Option("--suite", metavar="NAME", help="Suite to grade by; may be repeated. Default: all short ones."),
    ] = None,
    checks_only: Annotated[
        bool, typer.Option("--checks-only", help="Make the checks, and no grade: the gate asks no more.")
    ] = False,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", metavar="N", min=1, max=1024, help="Runs at a time, one thread each.")
    ] = None,
    store: StoreOption = DEFAULT_STORE,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")] = False,
    timeout: Annotated[
        float,
        typer.Option("--timeout", metavar="S", min=1, help="Stop an answer after S seconds of processor time."),
    ] = 600.0,
) -> None:
    """Check that a solver keeps the protocol, one line a check, and grade it.

    The checks include continuous answers, determinism, units, rigid motions, a rate of convergence, energies, and
    correct counts of parameters and bytes. A solver's theories determine its kind of problem: a shell or a rope. A
    solver that crashes or hangs fails the current check.

    The grade is the best of the classes 1e-2, 1e-3, 1e-4 that it reaches in every value of every judged case, or of
    the cases of --case. Exit 1 if a check fails or no class is reached, 2 if it declines all.

    A class needs checks that values can't replace: continuity, energies, linearity, placement, and work. Their results
    are kept in the store; `gate`, `pack` and `board` call a solver without them "not checked". The field is also
    compared with that of `fem` at points of no case; this does not change the grade.

    Examples
    --------
        shellbench check-solver mine --quick

        shellbench check-solver mine --case scordelis_lo --refine "cells=[8, 8];[16, 16];[32, 32]"
    """
    from shellbench.testing.grading import ExamOptions
    from shellbench.testing.suite import check_solver

    if quick and suite:
        raise typer.BadParameter("name suites or take the quick one", param_hint="'--quick'")
    if checks_only and (quick or suite):
        raise typer.BadParameter("makes no grade, so it takes no suites", param_hint="'--checks-only'")
    own = () if cases and not quick else None
    exam = ExamOptions(tuple(dict.fromkeys(suite)) if suite else own, store, jobs, quick, not checks_only)
    try:
        with plugins_are_input():
            code = check_solver(
                solver, cases or (), settings or (), refine=refine, seconds=timeout, as_json=json, exam=exam
            )
    except KeyboardInterrupt:
        raise Interrupted("interrupted: what had ended is kept, and the same command goes on from there") from None
    raise typer.Exit(code)
