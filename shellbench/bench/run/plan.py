"""Plans: from the requests of the command line to tasks.

- Suites run their declared runs, on all their cases or on the named ones.
- A named solver narrows a suite to its runs of that solver. If the suite has none, the solver joins with its default
  settings.
- A case without a suite runs as the first of its suites declares. If it belongs to no suite, as a user's own case, it
  runs as in `DEFAULT_SUITE` with one seed.
- Given settings and seeds replace the declared ones.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from shellbench.bench.catalogue import catalog
from shellbench.bench.catalogue.suite import SuiteRun
from shellbench.bench.plugins.outside import AskedSolver, declines, resolve_solver, settings_of
from shellbench.bench.plugins.registry import SolverEntry, find_solver
from shellbench.bench.plugins.settings import dump_settings
from shellbench.bench.store.current import newest, run_key
from shellbench.bench.store.earlier import START, Earlier
from shellbench.bench.store.environment import engine_distribution, environment
from shellbench.bench.store.identity import make_identity
from shellbench.bench.store.record import ANSWERED, NOT_SETTLED, Environment, Record
from shellbench.bench.store.store import Contents
from shellbench.bench.store.task import Task, case_data, new_run_id
from shellbench.errors import InputError
from shellbench.problem import Problem, SeededSettings, Solver

DEFAULT_SUITE = "obstacle_course"
QUICK_SUITE = "quick"
FIRST_SEED = 0


@dataclass(frozen=True)
class Request:
    """A request: names as they were typed; empty fields were left open.

    - `start`: an earlier run that all runs continue.
    - `threads`: threads of each run; None for the default (`shellbench.bench.store.environment.threads`).
    - `quick`: solvers that run with one seed if the request names no solver; named solvers then run with one seed too.
    """

    cases: tuple[str, ...] = ()
    suites: tuple[str, ...] = ()
    solvers: tuple[str, ...] = ()
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seeds: tuple[int, ...] = ()
    device: str = "cpu"
    threads: int | None = None
    quick: tuple[str, ...] = ()
    start: Earlier | None = None


@dataclass(frozen=True)
class Declined:
    """A run that does not apply: the solver can't take the case."""

    case: str
    solver: str
    reason: str


@dataclass(frozen=True)
class Plan:
    """A plan of runs.

    Attributes
    ----------
    tasks
        Runs to make.
    kept
        Names of the runs that have a valid record.
    unsettled
        Records of those kept runs whose answers have not settled.
    declined
        Combinations that do not apply.
    notes
        Notes for the user, one sentence each.
    seen
        Number of the newest record that was looked at.
    """

    tasks: tuple[Task, ...]
    kept: tuple[str, ...]
    unsettled: tuple[Record, ...]
    declined: tuple[Declined, ...]
    notes: tuple[str, ...]
    seen: int = 0


def wanted_runs(request: Request) -> Iterator[tuple[Problem, SuiteRun]]:
    """Yield cases with their runs, before given settings, seeds and device are applied.

    Raises
    ------
    InputError
        If a name is unknown, or the request is empty.
    """
    if not request.cases and not request.suites:
        raise InputError(f"nothing to run: name a case, a path to a .toml file, or --suite {DEFAULT_SUITE}")
    found = _runs_asked(request)
    yield from _first_seeds(request, found) if request.quick else found


def _runs_asked(request: Request) -> Iterator[tuple[Problem, SuiteRun]]:
    cases = [catalog.find_case(text) for text in request.cases]
    for name in dict.fromkeys(request.suites):
        suite = catalog.find_suite(name)
        for case in _of_suite(name, cases):
            yield from ((case, run) for run in _runs_of_solvers(suite.runs_for(case.name), request.solvers))
    if not request.suites:
        for case in cases:
            yield from ((case, run) for run in _runs_of(case, request.solvers))


def _first_seeds(request: Request, found: Iterator[tuple[Problem, SuiteRun]]) -> Iterator[tuple[Problem, SuiteRun]]:
    """Yield, for each quick or named solver, the first seed that is declared for a case and settings."""
    seen: set[tuple[str, str, str]] = set()
    for case, run in found:
        key = (case.name, run.solver, repr(sorted(run.settings.items())))
        if run.solver in (request.solvers or request.quick) and key not in seen:
            seen.add(key)
            yield case, run.model_copy(update={"seeds": run.seeds[:1]})
    if not seen:
        quick = " and ".join(request.quick)
        raise InputError(f"nothing to run: --quick takes {quick}, which no requested suite declares; add --solver")


def _of_suite(name: str, cases: Sequence[Problem]) -> Iterator[Problem]:
    """Yield the cases of a suite, or those that the named cases select; a user's own case selects itself."""
    if not cases:
        yield from catalog.cases_of(name)
    for case in cases:
        found = [case] if catalog.is_own(case) else catalog.cases_named(name, case.name)
        if not found:
            raise InputError(f"case '{case.name}' is not in suite '{name}': {_names(catalog.cases_of(name))}")
        yield from found


def _runs_of(case: Problem, solvers: Sequence[str]) -> tuple[SuiteRun, ...]:
    if solvers:
        return tuple(SuiteRun(solver=solver, seeds=(FIRST_SEED,)) for solver in dict.fromkeys(solvers))
    known = [name for name in case.suites if name in catalog.suite_names()]
    if known and not catalog.is_own(case):
        return catalog.find_suite(known[0]).runs_for(case.name)
    runs = catalog.find_suite(DEFAULT_SUITE).runs
    return tuple(run.model_copy(update={"seeds": (FIRST_SEED,)}) for run in runs if not run.settings)


def _runs_of_solvers(runs: tuple[SuiteRun, ...], solvers: Sequence[str]) -> tuple[SuiteRun, ...]:
    if not solvers:
        return runs
    listed = [run for name in dict.fromkeys(solvers) for run in runs if run.solver == name]
    others = [name for name in dict.fromkeys(solvers) if name not in {run.solver for run in runs}]
    return (*listed, *(SuiteRun(solver=name, seeds=(FIRST_SEED,)) for name in others))


def make_plan(
    request: Request, contents: Contents, force: bool = False, expect: Callable[[Task], None] = lambda task: None
) -> Plan:
    """Make tasks of a request.

    Solvers are asked if they decline a case only if no record exists, because the import of some takes long.

    Parameters
    ----------
    request
        The request.
    contents
        Content of the store: records of the same identity with an answer are kept, failed runs are tried again.
    force
        True to repeat runs that have a valid record.
    expect
        Called with each task before its solver is asked, so that the executor can prepare.

    Raises
    ------
    InputError
        If a name is unknown, a setting is invalid, a built-in solver can't be imported, or a device is not supported.
    PluginError
        If a solver of another package does not answer.
    """
    wanted = list(wanted_runs(request))
    names = dict.fromkeys(run.solver for _, run in wanted)
    entries = {name: find_solver(name) for name in names}
    for name in request.settings:
        find_solver(name)
        if name not in names:
            raise InputError(f"--set {name}.{next(iter(request.settings[name]))}: solver '{name}' is not to be run")
    solvers = {name: resolve_solver(entry) for name, entry in entries.items()}
    _check_start(request.start, solvers)
    notes = _check_device(request, solvers)
    answered = {} if force else {key: r for key, r in newest(contents).items() if r.status in ANSWERED}
    place, exam = cache(environment), catalog.exam_version()  # computed once for a plan, because each call runs git
    tasks: dict[str, Task] = {}
    kept: dict[str, Record] = {}
    declined: dict[tuple[str, str], Declined] = {}
    for case, run in wanted:
        solver = solvers[run.solver]
        made = {}
        for seed in request.seeds or run.seeds:
            task = _task(case, entries[run.solver], solver, run, request, seed, place, exam)
            made[run_key(task)] = task
        kept |= {key: answered[key] for key in made if key in answered}
        waiting = {key: task for key, task in made.items() if key not in answered}
        if waiting:
            expect(next(iter(waiting.values())))
            reason = declines(solver, case)
            if reason is None:
                tasks |= waiting
            else:
                declined[case.name, run.solver] = Declined(case.name, run.solver, reason)
    return Plan(
        tasks=tuple(tasks.values()),
        kept=tuple(record.run_id for record in kept.values()),
        unsettled=tuple(record for record in kept.values() if record.status == NOT_SETTLED),
        declined=tuple(declined.values()),
        notes=notes,
        seen=max((record.sequence or 0 for record in contents.records), default=0),
    )


def _check_start(start: Earlier | None, solvers: Mapping[str, Solver | AskedSolver]) -> None:
    if start is None:
        return
    for name, solver in solvers.items():
        if name != start.solver:
            raise InputError(f"--start {start.run_id}: this run is by solver '{start.solver}', not by '{name}'")
        if not getattr(solver, "uses_start", False):
            raise InputError(f"--start: solver '{name}' can't go on from an earlier solution")


def _check_device(request: Request, solvers: Mapping[str, Solver | AskedSolver]) -> tuple[str, ...]:
    without = [name for name, solver in solvers.items() if request.device not in solver.capabilities.devices]
    if without and (set(without) == set(solvers) or set(without) & set(request.solvers)):
        offered = ", ".join(solvers[without[0]].capabilities.devices)
        raise InputError(f"--device {request.device}: solver '{without[0]}' runs on {offered}")
    return tuple(f"solver '{name}' runs on the cpu" for name in without)


def _task(
    case: Problem,
    entry: SolverEntry,
    solver: Solver | AskedSolver,
    run: SuiteRun,
    request: Request,
    seed: int,
    place: Callable[..., Environment],
    exam: int | None,
) -> Task:
    device = request.device if request.device in solver.capabilities.devices else "cpu"
    overrides = {**run.settings, **request.settings.get(run.solver, {})}
    settings = settings_of(solver, overrides, seed, device)
    defaults: dict[str, Any] = {}
    with contextlib.suppress(InputError):  # a plug-in may have settings without a default
        defaults = dump_settings(settings_of(solver, {}, seed, device))
    identity = make_identity(case, entry, settings)
    if request.start is not None:
        identity = identity.model_copy(update={"settings": {**identity.settings, START: request.start.run_id}})
    run_id, created = new_run_id(case.name, entry.name, identity.seed)
    apart = {"seed": settings.seed, "device": settings.device} if isinstance(settings, SeededSettings) else {}
    return Task(
        run_id=run_id,
        created=created,
        identity=identity,
        target=entry.target,
        case_name=case.name,
        case=case_data(case),
        own_case=catalog.is_own(case),
        settings={**overrides, **apart},
        defaults=defaults,
        solver_label=solver.capabilities.label,
        exam=exam,
        start=None if request.start is None else str(request.start.file),
        environment=place(
            device,
            entry.distribution,
            threads_each=request.threads,
            engine=engine_distribution(identity.settings),
        ),
    )


def _names(cases: Sequence[Problem]) -> str:
    return "its cases are " + ", ".join(case.name for case in cases) if cases else "it has no cases yet"
