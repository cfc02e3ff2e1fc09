"""Making runs: so many at a time, each in a process of its own, each kept as soon as it has ended."""

from __future__ import annotations

import contextlib
import selectors
import signal
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from pydantic import ValidationError

from shellbench.bench.process import ServerProcess
from shellbench.bench.record import Record
from shellbench.bench.store import Store, StoreError
from shellbench.bench.task import Task
from shellbench.bench.worker import DISK_FULL, RECORD, REFUSED
from shellbench.solution import Progress

LONGEST_WAIT = 1.0  # seconds between two looks at the deadlines


@dataclass(frozen=True)
class Outcome:
    """How a task ended.

    Attributes
    ----------
    record
        What was kept; None if the input was refused.
    refused
        Why the solver refused its input, in one sentence.
    """

    task: Task
    record: Record | None = None
    refused: str | None = None


class Observer(Protocol):
    """Who wants to see runs go by."""

    def started(self, task: Task) -> None:
        """Note that a task has started."""
        ...

    def progressed(self, task: Task, progress: Progress) -> None:
        """Note how far a task is."""
        ...

    def ended(self, outcome: Outcome) -> None:
        """Note that a task has ended, and how."""
        ...


@dataclass
class _Running:
    task: Task
    folder: Path
    server: ServerProcess
    began: float
    timed_out: bool = False


@dataclass
class Execution:
    """Runs that go on; `execute` is the way to use it."""

    store: Store
    jobs: int
    timeout: float | None
    observer: Observer
    threads: int
    idle: list[ServerProcess] = field(default_factory=list)
    running: list[_Running] = field(default_factory=list)
    outcomes: list[Outcome] = field(default_factory=list)

    def run(self, tasks: Sequence[Task]) -> list[Outcome]:
        """Make all runs; see `execute`."""
        waiting = deque(tasks)
        try:
            self._warm_up(tasks)
            while waiting or self.running:
                while waiting and len(self.running) < self.jobs:
                    self._start(waiting.popleft())
                self._wait()
        finally:
            for server in [*self.idle, *(r.server for r in self.running)]:
                server.end()
            for run in self.running:
                self.store.discard(run.folder)
        return self.outcomes

    def _warm_up(self, tasks: Sequence[Task]) -> None:
        """Start one server for each solver and wait for all: imports must not disturb runs that are timed."""
        self.idle = [self._server(task) for task in {t.identity.solver: t for t in tasks}.values()]
        for server in self.idle:
            _until_ready(server)

    def _server(self, task: Task) -> ServerProcess:
        return ServerProcess.start(task.identity.solver, task.target, self.threads)

    def _start(self, task: Task) -> None:
        server = next((s for s in self.idle if s.solver == task.identity.solver), None)
        if server is None:
            server = self._server(task)
            _until_ready(server)
        else:
            self.idle.remove(server)
        folder = self.store.begin(task.run_id)
        try:
            task.write(folder)
        except OSError as error:
            server.end()
            self.store.discard(folder)
            raise StoreError(f"store {self.store.folder}: can't be written ({error.strerror})") from None
        self.running.append(_Running(task, folder, server, time.monotonic()))
        self.observer.started(task)
        if not server.give(folder):
            self._end(self.running[-1], None)

    def _wait(self) -> None:
        """Hear what the servers say, for a while, and stop what has run for too long."""
        now = time.monotonic()
        wait = LONGEST_WAIT
        if self.timeout is not None:
            for run in self.running:
                left = run.began + self.timeout - now
                if left <= 0:  # again until it has ended: at first its process may not be known yet
                    run.timed_out = True
                    run.server.kill_run()
                wait = min(wait, max(left, 0.01))
        with selectors.DefaultSelector() as selector:
            for run in self.running:
                selector.register(run.server.fileno(), selectors.EVENT_READ, run)
            heard: list[_Running] = [key.data for key, _ in selector.select(wait)]
        for run in heard:
            for event in run.server.hear():
                self._react(run, event)
        for run in [run for run in self.running if run.server.process.poll() is not None]:
            self._end(run, None)

    def _react(self, run: _Running, event: dict[str, Any]) -> None:
        match event["event"]:
            case "started":
                run.began = time.monotonic()
            case "progress":
                progress = Progress(event["step"], event["total"], event["message"])
                self.observer.progressed(run.task, progress)
            case "ended":
                self._end(run, event["status"])
            case "died":
                self._end(run, None)

    def _end(self, run: _Running, status: int | None) -> None:
        """Keep what a run left; `status` is that of its process, None if its server has died."""
        if run not in self.running:
            return
        self.running.remove(run)
        if status is None:
            run.server.end()
        else:
            self.idle.append(run.server)
        outcome = self._outcome(run, status)
        self.outcomes.append(outcome)
        self.observer.ended(outcome)

    def _outcome(self, run: _Running, status: int | None) -> Outcome:
        with contextlib.suppress(OSError):
            refused = (run.folder / REFUSED).read_text(encoding="utf-8")
            self.store.discard(run.folder)
            return Outcome(run.task, refused=refused)
        if (run.folder / DISK_FULL).exists():
            self.store.discard(run.folder)
            raise StoreError(f"store {self.store.folder}: the disk is full, so what was being written is lost")
        record = _left_record(run.folder)
        if record is None:
            seconds = time.monotonic() - run.began
            kind = "timeout" if run.timed_out else "failed"
            reason = f"stopped after {self.timeout:g} s" if run.timed_out else _cause_of_death(run, status)
            record = run.task.record(status=kind, reason=reason, seconds=seconds)
        return Outcome(run.task, self.store.commit(run.folder, record))


def execute(
    tasks: Sequence[Task],
    store: Store,
    observer: Observer,
    *,
    jobs: int,
    threads: int,
    timeout: float | None = None,
) -> list[Outcome]:
    """Make runs, so many at a time, and keep each in the store as soon as it has ended.

    Parameters
    ----------
    tasks
        In the order in which to start them.
    jobs, threads
        Runs at a time, and threads of each.
    timeout
        Seconds after which a run is stopped, that run only; None for none.

    Returns
    -------
    list of Outcome
        In the order in which they ended.

    Raises
    ------
    StoreError
        If the store can't be written; runs that had ended are kept.
    KeyboardInterrupt
        Passed on after all runs have been stopped; runs that had ended are kept.
    """
    with store.at_work():
        return Execution(store, jobs, timeout, observer, threads).run(tasks) if tasks else []


def _until_ready(server: ServerProcess) -> None:
    """Wait until a server has imported its solver (or died, which its first run will say)."""
    with selectors.DefaultSelector() as selector:
        selector.register(server.fileno(), selectors.EVENT_READ)
        while not any(event["event"] in {"ready", "died"} for event in server.hear()):
            selector.select()


def _left_record(folder: Path) -> Record | None:
    try:
        return Record.model_validate_json((folder / RECORD).read_bytes())
    except (OSError, ValidationError):
        return None


def _cause_of_death(run: _Running, status: int | None) -> str:
    if status is None:
        said = run.server.last_words()
        return f"the solver's process could not be started or was killed{f' ({said})' if said else ''}"
    if status >= 0:
        return f"the solving process ended with exit status {status} and left no record"
    try:
        name = signal.Signals(-status).name
    except ValueError:
        name = f"signal {-status}"
    hint = ": out of memory, perhaps" if name == "SIGKILL" else ""
    return f"the solving process was ended by {name}{hint}"
