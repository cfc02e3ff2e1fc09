"""Runs on this machine: several at a time, each in a process of its own."""

from __future__ import annotations

import contextlib
import selectors
import shutil
import signal
import stat
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shellbench.bench.plugins.process import GARBLED, STARTING, ServerProcess, cpu_time, is_overdue
from shellbench.bench.run.execute import Ended, Event, Progressed, Started
from shellbench.bench.run.worker import DISK_FULL, RECORD, REFUSED
from shellbench.bench.store.record import LARGEST_RECORD, Record, read_document
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task
from shellbench.disk import StoreError, said_plainly
from shellbench.errors import InputError
from shellbench.problem import Progress

LONGEST_WAIT = 1.0  # seconds between two checks of the deadlines
LEAST_WAIT = 0.01  # the same while a run is being stopped


class AbandonedError(Exception):
    """The runs are no longer wanted."""


@dataclass(frozen=True)
class LocalProcesses:
    """Makes runs in processes of this machine, forked from one server for each solver (`shellbench.bench.run.server`).

    Attributes
    ----------
    jobs, threads
        Runs at a time, and threads of each.
    timeout
        Seconds after which a run is stopped, that run only (`shellbench.bench.plugins.process.is_overdue`); None for
        none.
    wanted
        Called about every second; if it returns False, the runs are stopped by `AbandonedError`.
    idle
        Idle servers of earlier runs, of the same solvers and numbers of threads.
    keep
        True if servers that are idle at the end stay in `idle`; the caller must then end them.
    taken
        Returns the number of `jobs` that are in other use at the moment; called about every second.
    """

    jobs: int
    threads: int
    timeout: float | None = None
    wanted: Callable[[], bool] = lambda: True
    idle: list[ServerProcess] = field(default_factory=list)
    keep: bool = False
    taken: Callable[[], int] = lambda: 0

    def expect(self, task: Task) -> None:
        """Start the server of a solver, if none is idle: it imports the solver while its runs are planned."""
        if task.identity.solver not in {server.solver for server in self.idle}:
            self.idle.append(ServerProcess.start(task.identity.solver, task.target, self.threads))

    def close(self) -> None:
        """End the idle servers."""
        while self.idle:
            self.idle.pop().end()

    def run(self, tasks: Sequence[Task], store: Store) -> Generator[Event, None, None]:
        """Make runs; see `shellbench.bench.run.execute.Executor`.

        Raises
        ------
        StoreError
            If the store can't be written.
        AbandonedError
            If they are no longer wanted.
        """
        runs = _Runs(self, store)
        try:
            yield from runs.make(tasks)
        finally:
            runs.stop()


@dataclass
class _Running:
    task: Task
    folder: Path
    server: ServerProcess
    began: float
    timed_out: bool = False
    garbled: bool = False


@dataclass
class _Runs:
    """Current runs."""

    how: LocalProcesses
    store: Store
    running: list[_Running] = field(default_factory=list)

    @property
    def idle(self) -> list[ServerProcess]:
        return self.how.idle

    def make(self, tasks: Sequence[Task]) -> Iterator[Event]:
        # 1. Start one server for each solver, and wait until all have imported it.
        # 2. Fill the free places with runs.
        # 3. Wait for the servers until a run has ended, fill its place, and yield it.
        # A pool of workers would share processes between runs. Each run here has its own, forked from an idle server.
        # Its memory is its own, its end harms no other, and the import is paid once.
        waiting = deque(tasks)
        self._warm_up(tasks)
        while waiting or self.running:
            yield from self._fill_places(waiting)
            heard: list[Event] = []
            started: list[Event] = []
            try:
                for event in self._wait():
                    heard.append(event)
                # Storing an ended run takes a moment: start the next runs before, so that no place stays empty.
                for event in self._fill_places(waiting, at_once=True):
                    started.append(event)
            finally:
                yield from heard  # no ended run is lost, even after an error
                yield from started

    def _fill_places(self, waiting: deque[Task], at_once: bool = False) -> Iterator[Event]:
        """Start runs in the free places; with `at_once` only those with an idle server."""
        while waiting and len(self.running) < self.how.jobs - self.how.taken():
            if at_once and waiting[0].identity.solver not in {server.solver for server in self.idle}:
                return
            yield from self._start(waiting.popleft())

    def stop(self) -> None:
        """End all processes that are not kept, and remove the folders of the stopped runs."""
        if not self.how.keep:
            self.how.close()
        for run in self.running:
            run.server.end()
            self.store.discard(run.folder)

    def _warm_up(self, tasks: Sequence[Task]) -> None:
        """Start one server for each solver and wait for all, so that their imports disturb no timed run."""
        for task in tasks:
            self.how.expect(task)
        for server in self.idle:
            self._until_ready(server)

    def _until_ready(self, server: ServerProcess) -> None:
        """Wait until a server has imported its solver, or has died; its first run will report this."""
        with selectors.DefaultSelector() as selector:
            selector.register(server.fileno(), selectors.EVENT_READ)
            began = time.monotonic()
            while not server.ready and {"event": "died"} not in (heard := server.read_events()):
                self._stop_if_unwanted()
                took = time.monotonic() - began
                if GARBLED in heard or (took > STARTING and is_overdue(STARTING, took, cpu_time(server.process.pid))):
                    server.hung = True
                    server.end()
                    return
                selector.select(LONGEST_WAIT)

    def _stop_if_unwanted(self) -> None:
        if not self.how.wanted():
            raise AbandonedError

    def _start(self, task: Task) -> Iterator[Event]:
        # A server makes one run at a time. More runs of one solver need more servers, which are started when first
        # needed.
        server = next((s for s in self.idle if s.solver == task.identity.solver), None)
        if server is None:
            self.how.expect(task)
            server = self.idle[-1]
            self._until_ready(server)
        folder = self.store.begin(task.run_id)
        self.idle.remove(server)
        run = _Running(task, folder, server, time.monotonic())
        self.running.append(run)
        try:
            task.write(folder)
        except OSError as error:
            raise StoreError(f"store {self.store.folder}: can't be written ({error.strerror})") from None
        yield Started(task)
        # The server has died: the run ends like one with a killed process, and is not lost.
        if not server.send_task(folder):
            yield from self._end(run, None)

    def _wait(self) -> Iterator[Event]:
        """Wait a limited time for events of the servers, and stop runs that exceed their time."""
        self._stop_if_unwanted()
        # Wait for an event of a server, the next deadline, or the next check if the runs are wanted.
        now = time.monotonic()
        wait = LONGEST_WAIT
        if self.how.timeout is not None:
            for run in self.running:
                waited = now - run.began
                if waited < self.how.timeout:
                    wait = min(wait, self.how.timeout - waited)
                elif run.timed_out or is_overdue(self.how.timeout, waited, run.server.cpu_time()):
                    run.timed_out = True
                    run.server.kill_run()  # again until it has ended: at first its process may not be known yet
                    wait = LEAST_WAIT
        with selectors.DefaultSelector() as selector:
            for run in self.running:
                selector.register(run.server.fileno(), selectors.EVENT_READ, run)
            heard: list[_Running] = [key.data for key, _ in selector.select(wait)]
        for run in heard:
            for event in run.server.read_events():
                yield from self._react(run, event)
        # A killed server may send no event. Without this check its run would never end.
        for run in [run for run in self.running if run.server.process.poll() is not None]:
            yield from self._end(run, None)

    def _react(self, run: _Running, event: dict[str, Any]) -> Iterator[Event]:
        match event["event"]:
            case "started":
                # The deadline counts from when the run's own process began, not from when the server was asked.
                run.began = time.monotonic()
            case "progress":
                yield Progressed(run.task, Progress(event["step"], event["total"], event["message"]))
            case "ended":
                yield from self._end(run, event["status"])
            case "garbled":
                run.garbled = True
                yield from self._end(run, None)
            case "died":
                yield from self._end(run, None)

    def _end(self, run: _Running, status: int | None) -> Iterator[Event]:
        """Return the result of a run; `status` is that of its process, None if its server has died."""
        # The end of a run may be reported twice: by its last event, and by its server's death.
        if run not in self.running:
            return
        # A full disk is no failure of the solver, and a record of it could not be written. The whole plan stops.
        if (run.folder / DISK_FULL).exists():
            raise StoreError(f"store {self.store.folder}: the disk is full, so what was being written is lost")
        self.running.remove(run)
        if status is None:
            run.server.end()
        else:
            self.idle.append(run.server)
        yield self._result_of_run(run, status)

    def _result_of_run(self, run: _Running, status: int | None) -> Ended:
        # A complete record counts even if its process died later. Otherwise the record describes the death.
        broken = _what_it_broke(run)
        if broken is None and (refused := _written(run.folder / REFUSED)) is not None:
            return Ended(run.task, run.folder, refused=" ".join(refused.decode(errors="replace").split()))
        record = None if broken else _left_record(run)
        if record is None:
            _remove(run.folder / RECORD)  # it may be a pipe, a link or a folder at a path that the store must write
            seconds = time.monotonic() - run.began
            kind = "timeout" if run.timed_out else "failed"
            reason = (
                f"stopped after {self.how.timeout:g} s" if run.timed_out else broken or _cause_of_death(run, status)
            )
            record = run.task.record(status=kind, reason=reason, seconds=seconds)
        return Ended(run.task, run.folder, record)


def _what_it_broke(run: _Running) -> str | None:
    """Return the damage that a run did to its surroundings, in a clause; its folder is recreated empty."""
    folder = run.folder
    if folder.is_dir() and not folder.is_symlink():
        with contextlib.suppress(OSError):
            folder.chmod(0o700)
        return "the run wrote to the stream by which its server speaks to shellbench" if run.garbled else None
    _remove(folder)
    with said_plainly(folder.parent):
        folder.mkdir(parents=True)
    return "the run removed the folder in which it worked"


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()


def _written(path: Path) -> bytes | None:
    """Return the content of a file that a run wrote; None if it is no regular file of an allowed size."""
    try:
        found = path.lstat()
        return path.read_bytes() if stat.S_ISREG(found.st_mode) and found.st_size <= LARGEST_RECORD else None
    except OSError:
        return None


def _left_record(run: _Running) -> Record | None:
    """Return the record of a run; None if there is none, or if it belongs to another run."""
    written, task = _written(run.folder / RECORD), run.task
    try:
        record = None if written is None else read_document(written)
    except InputError:
        return None
    if record is None or (record.run_id, record.identity, record.case) != (task.run_id, task.identity, task.case):
        return None
    return record if (record.case_name, record.own_case) == (task.case_name, task.own_case) else None


def _cause_of_death(run: _Running, status: int | None) -> str:
    if run.server.hung:
        return "the solver's process hung, or talked nonsense, where it imported the solver"
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
