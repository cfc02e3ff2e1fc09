"""Running tasks in tests, as the command line does."""

import sys
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

import pytest

from shellbench import cli
from shellbench.bench.run.display import Silent
from shellbench.bench.run.execute import Ended, Event, Executor, Outcome, execute
from shellbench.bench.run.local import LocalProcesses
from shellbench.bench.run.plan import Request, make_plan
from shellbench.bench.run.worker import RECORD, work
from shellbench.bench.store.environment import environment
from shellbench.bench.store.record import Identity, Record, document, read_document
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task, case_data
from shellbench.problem import Problem


def command(patch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run the program in this process; return exit code, standard output and standard error."""
    patch.setattr(sys, "argv", ["shellbench", *map(str, arguments)])
    try:
        cli.main()
        code = 0
    except SystemExit as end:
        code = 0 if end.code is None else int(end.code)
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err
    return code, out, err


@dataclass(frozen=True)
class InThisProcess:
    """Makes runs right here: nothing has to be started, and a crash would be the test's own."""

    def run(self, tasks: Sequence[Task], store: Store) -> Generator[Event, None, None]:
        for task in tasks:
            folder = store.begin(task.run_id)
            task.write(folder)
            work(folder, lambda progress: None)
            yield Ended(task, folder, read_document((folder / RECORD).read_bytes()))

    def expect(self, task: Task) -> None:
        """Nothing has to be made ready."""

    def close(self) -> None:
        """Nothing was."""


def run(
    store: Store,
    *cases: str,
    suites: tuple[str, ...] = (),
    solvers: tuple[str, ...] = (),
    settings: dict[str, dict[str, Any]] | None = None,
    seeds: tuple[int, ...] = (),
    force: bool = False,
    apart: bool = False,
    timeout: float | None = None,
) -> list[Outcome]:
    """Plan and run: in this process, which takes a twentieth of the time, or `apart`, as the command line does."""
    request = Request(tuple(map(str, cases)), suites, solvers, settings or {}, seeds)
    plan = make_plan(request, store.read(), force)
    executor: Executor = LocalProcesses(2, 1, timeout) if apart else InThisProcess()
    return execute(plan.tasks, store, Silent(), executor)


def behave(store: Store, behaviour: str, **more: Any) -> Record:
    """Run the strip by a toy solver that behaves like this, in a process of its own; return its record."""
    settings = {"toy": {"behaviour": behaviour}}
    outcome = run(store, "strip", solvers=("toy",), settings=settings, apart=True, **more)[0]
    assert outcome.record is not None
    return outcome.record


def run_here(
    store: Store, *cases: str, solver: str, seeds: tuple[int, ...] = (), force: bool = False, **settings: Any
) -> list[Record]:
    """Plan runs of a solver and make them in this process; return their records."""
    asked = {solver: settings} if settings else None
    outcomes = run(store, *cases, solvers=(solver,), settings=asked, seeds=seeds, force=force)
    return [outcome.record for outcome in outcomes if outcome.record is not None]


def changed(store: Store, record: Record, **change: Any) -> None:
    """Have a record of a store say something else, as if it had been written so."""
    made = Record.model_validate({**record.model_dump(), **change})
    (store.folder / f"{record.run_id}.json").write_bytes(document(made))


def task_of(case: Problem, target: str) -> Task:
    """A run of a user's own case by a solver of the tests, as the worker is given it."""
    solver = target.rpartition(":")[2]
    where = {"source": "0", "settings": {}, "seed": None, "device": "cpu", "dtype": "float64"}
    return Task(
        run_id="run",
        created="2000-01-01T00:00:00Z",
        identity=Identity(case=case.digest(), solver=solver, **where),
        target=target,
        case_name=case.name,
        case=case_data(case),
        own_case=True,
        settings={},
        solver_label="",
        environment=environment(),
    )
