"""Running tasks in tests, as the command line does."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

from shellbench.bench.display import Silent
from shellbench.bench.execute import Ended, Event, Outcome, execute
from shellbench.bench.local import LocalProcesses
from shellbench.bench.plan import Request, make_plan
from shellbench.bench.record import Record, document, read_document
from shellbench.bench.store import Store
from shellbench.bench.task import Task
from shellbench.bench.worker import RECORD, work


def run(
    store: Store,
    *cases: str,
    suites: tuple[str, ...] = (),
    solvers: tuple[str, ...] = (),
    settings: dict[str, dict[str, Any]] | None = None,
    seeds: tuple[int, ...] = (),
    force: bool = False,
    timeout: float | None = None,
    jobs: int = 2,
) -> list[Outcome]:
    """Plan and run."""
    request = Request(tuple(map(str, cases)), suites, solvers, settings or {}, seeds)
    plan = make_plan(request, store.read(), force)
    return execute(plan.tasks, store, Silent(), LocalProcesses(jobs, 1, timeout))


def behave(store: Store, behaviour: str, **more: Any) -> Record:
    """Run the strip by a toy solver that behaves like this; return its record."""
    outcome = run(store, "strip", solvers=("toy",), settings={"toy": {"behaviour": behaviour}}, **more)[0]
    assert outcome.record is not None
    return outcome.record


@dataclass(frozen=True)
class InThisProcess:
    """Makes runs right here: nothing has to be started, and a crash would be the test's own."""

    def run(self, tasks: Sequence[Task], store: Store) -> Generator[Event, None, None]:
        for task in tasks:
            folder = store.begin(task.run_id)
            task.write(folder)
            work(folder, lambda progress: None)
            yield Ended(task, folder, read_document((folder / RECORD).read_bytes()))


def run_here(
    store: Store, *cases: str, solver: str, seeds: tuple[int, ...] = (), force: bool = False, **settings: Any
) -> list[Record]:
    """Plan runs of a solver and make them in this process; return their records."""
    request = Request(tuple(map(str, cases)), (), (solver,), {solver: settings} if settings else {}, seeds)
    outcomes = execute(make_plan(request, store.read(), force).tasks, store, Silent(), InThisProcess())
    return [outcome.record for outcome in outcomes if outcome.record is not None]


def changed(store: Store, record: Record, **change: Any) -> None:
    """Have a record of a store say something else, as if it had been written so."""
    made = Record.model_validate({**record.model_dump(), **change})
    (store.folder / f"{record.run_id}.json").write_bytes(document(made))
