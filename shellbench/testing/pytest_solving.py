"""A solver's answers to a case, found once in a session of pytest, however many items and processes ask for them."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shellbench.bench.current import newest, run_key
from shellbench.bench.display import Silent
from shellbench.bench.environment import cores, threads
from shellbench.bench.execute import execute
from shellbench.bench.local import LocalProcesses
from shellbench.bench.plan import Request, make_plan
from shellbench.bench.record import Record
from shellbench.bench.store import Store, said_plainly
from shellbench.bench.task import Task
from shellbench.errors import ShellbenchError

try:
    import fcntl
except ImportError:  # pragma: no cover - no such locks outside POSIX; then each process solves for itself
    fcntl = None  # type: ignore[assignment]

WORKERS = "PYTEST_XDIST_WORKER_COUNT"  # set by pytest-xdist in each of its processes


@dataclass(frozen=True)
class Answer:
    """What came of a solver and a case.

    Attributes
    ----------
    records
        By seed; None for a deterministic solver.
    declined
        Why the solver does not take the case; None if it does.
    trouble
        Why there is no record of a run, in one sentence; None if there is one of each.
    """

    records: Mapping[int | None, Record] = field(default_factory=dict)
    declined: str | None = None
    trouble: str | None = None

    def record(self, seed: int) -> Record | None:
        """Return the record of a seed; a deterministic solver has one for all."""
        return self.records.get(seed, self.records.get(None))


@dataclass
class Answers:
    """Answers of one session.

    Attributes
    ----------
    store
        Finished runs of this and of earlier sessions: those of the same identity are not made again.
    began
        The largest sequence number of a record when the session began; a run that has failed since is not tried again.
    """

    store: Store
    began: int
    settings: Mapping[str, Mapping[str, Any]]
    timeout: float | None
    known: dict[tuple[str, str, tuple[int, ...]], Answer] = field(default_factory=dict)

    def is_new(self, record: Record) -> bool:
        """Whether a record was made by this session, or beside it."""
        return (record.sequence or 0) > self.began

    def answer(self, case: str, solver: str, seeds: Sequence[int]) -> Answer:
        """Return the answer of a solver to a case, solving it if need be."""
        key = (case, solver, tuple(seeds))
        if key not in self.known:
            self.known[key] = self._found(*key)
        return self.known[key]

    def _found(self, case: str, solver: str, seeds: tuple[int, ...]) -> Answer:
        given = {solver: self.settings[solver]} if solver in self.settings else {}
        request = Request(cases=(case,), solvers=(solver,), settings=given, seeds=seeds)
        try:
            with locked(self.store.folder, f"{case}-{solver}"):
                return self._solved(request)
        except ShellbenchError as error:
            return Answer(trouble=" ".join(str(error).split()))
        except Exception as error:  # a plug-in may raise anything when it is asked whether it takes a case
            said = " ".join(str(error).split())
            return Answer(trouble=f"the solver could not be asked: {type(error).__name__}{f': {said}' if said else ''}")

    def _solved(self, request: Request) -> Answer:
        contents = self.store.read()
        plan = make_plan(request, contents)
        if plan.declined:
            return Answer(declined=plan.declined[0].reason)
        past = newest(contents)
        kept = [record for record in past.values() if record.run_id in plan.kept]
        waiting: list[Task] = []
        for task in plan.tasks:
            failed = past.get(run_key(task))
            if failed is not None and self.is_new(failed):
                kept.append(failed)
            else:
                waiting.append(task)
        outcomes = execute(waiting, self.store, Silent(), LocalProcesses(jobs=1, threads=share(), timeout=self.timeout))
        refused = [outcome.refused for outcome in outcomes if outcome.record is None]
        made = [outcome.record for outcome in outcomes if outcome.record is not None]
        records = {record.identity.seed: record for record in (*kept, *made)}
        return Answer(records, trouble=f"the solver refused its input: {refused[0]}" if refused else None)


def share() -> int:
    """Return the threads of a run, so that the processes of pytest-xdist do not fight over the cores."""
    workers = int(os.environ.get(WORKERS, "1"))
    return max(1, min(threads(), cores() // workers))


@contextlib.contextmanager
def locked(folder: Path, name: str) -> Iterator[None]:
    """Hold a lock by name among all processes that work in a folder; StoreError if it can't be written."""
    safe = re.sub(r"[^A-Za-z0-9_-]+", "_", name)
    with said_plainly(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle = (folder / f".gate-{safe}.lock").open("a")
    with handle:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
