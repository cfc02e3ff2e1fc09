"""Runs on an existing Dask cluster, with the same results as on this machine.

Runs are few, long and heavy, and the cost of each is measured separately. Dask therefore carries tasks and records,
watches its workers and cancels; this module chooses the worker. Dask would queue runs on a worker, and count its loss
for all of them. Here a worker gets as many runs at a time as its threads allow, and no queue.

A lost worker loses only its current runs. Each is tried again, alone on a worker, so that only the run that caused the
loss is lost again. `Client.submit(retries=...)` does not count lost workers, and Dask's ``allowed-failures`` belongs to
the scheduler and counts for all runs alike.

Solvers are sent by name and cases as data: no object of the user is pickled.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import queue
import re
import secrets
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shellbench.bench.run.execute import Ended, Event, Progressed, Started
from shellbench.bench.store.environment import THREADS
from shellbench.bench.store.record import Environment, read_document
from shellbench.bench.store.store import Store
from shellbench.bench.store.task import Task
from shellbench.disk import said_plainly
from shellbench.errors import InputError, ShellbenchError
from shellbench.files import read_file
from shellbench.problem import Progress
from shellbench.protocol.schema import MAX_BYTES
from shellbench_dask.remote import run_task

LOSSES = 3  # workers that a run may lose before it counts as failed
LOOK = 1.0  # seconds between two looks at the workers
PATIENCE = 10.0  # seconds for a scheduler to answer
MUST_AGREE = ("python", "distributed")
SILENT = 100  # above all levels of `logging`
LOSS_ERRORS = {"KilledWorker", "CancelledError", "FutureCancelledError", "FuturesCancelledError", "AbandonedError"}


class SchedulerLostError(ShellbenchError):
    """The scheduler was lost during runs."""


@dataclass(frozen=True)
class DaskCluster:
    """Makes runs on the workers of a Dask scheduler.

    Attributes
    ----------
    address
        Address of the scheduler, or path of its scheduler file.
    jobs
        Largest number of runs at a time; None for as many as the workers take.
    threads
        Threads of each run; None for the default. A worker takes one run for each such number of its threads, and at
        least one.
    timeout
        Seconds after which a run is stopped by its worker; None for none.
    say
        Receives sentences on workers that are awaited, lost or unfit.
    """

    address: str
    jobs: int | None
    threads: int | None
    timeout: float | None
    say: Callable[[str], None]

    def expect(self, task: Task) -> None:
        """Do nothing: the workers prepare themselves."""

    def close(self) -> None:
        """Do nothing."""

    def run(self, tasks: Sequence[Task], store: Store) -> Generator[Event, None, None]:
        """Make runs; see `shellbench.bench.run.execute.Executor`.

        Raises
        ------
        InputError
            If no scheduler answers.
        SchedulerLostError
            If the scheduler is lost during runs.
        """
        with connect_client(self.address) as client:
            sweep = _Sweep(self, client, store, deque(map(_Run, tasks)))
            try:
                yield from sweep.make()
            except ShellbenchError:
                raise
            except Exception as error:
                if isinstance(error, OSError) or client.status != "running":  # a time-out is an OSError too
                    kept = "what had ended is kept, and the same command goes on from there"
                    raise SchedulerLostError(f"the scheduler {self.address} is gone: {kept}") from error
                raise
            finally:
                sweep.stop()


@dataclass(eq=False)
class _Run:
    """A waiting or current run; `announced` is set once, `executing` again on each worker."""

    task: Task
    losses: int = 0
    announced: bool = False
    worker: str = ""
    future: Any = None
    began: float = 0.0
    executing: bool = False


@dataclass
class _Sweep:
    """Waiting and current runs.

    Attributes
    ----------
    sent
        Runs that were sent to workers, by Dask's key.
    workers
        Threads of each worker, by its address.
    unfit
        Reasons why a worker can't make runs, by worker and solver; the solver None stands for all solvers.
    events
        Messages of workers and Dask's threads: a run's key, with its environment, its progress or its answer.
    lonely
        True if there was no worker at the last check.
    """

    how: DaskCluster
    client: Any
    store: Store
    waiting: deque[_Run]
    sent: dict[str, _Run] = field(default_factory=dict)
    workers: dict[str, int] = field(default_factory=dict)
    unfit: dict[tuple[str, str | None], str] = field(default_factory=dict)
    events: queue.SimpleQueue[dict[str, Any]] = field(default_factory=queue.SimpleQueue)
    topic: str = field(default_factory=lambda: f"shellbench-{secrets.token_hex(8)}")
    lonely: bool = False

    def make(self) -> Iterator[Event]:
        """Check the workers regularly, send them runs, and receive messages, until all runs have ended."""
        self.client.subscribe_topic(self.topic, lambda event: self.events.put(event[1]))
        looked = float("-inf")
        while self.waiting or self.sent:
            if time.monotonic() - looked >= LOOK:
                yield from self._look()
                looked = time.monotonic()
            yield from self._send()
            yield from self._hear()

    def stop(self) -> None:
        """Stop the current runs: the workers check every second if a client waits for them."""
        with contextlib.suppress(OSError):  # of a scheduler that is gone; the workers find out by themselves
            if self.sent and self.client.status == "running":
                self.client.cancel([run.future for run in self.sent.values()], force=True)

    def _look(self) -> Iterator[Event]:
        """Update the list of workers with new and lost ones."""
        now = dict(self.client.sync(self.client.scheduler.ncores, callback_timeout=PATIENCE))
        if set(now) - set(self.workers):
            versions = self.client.get_versions()
            for worker, theirs in versions["workers"].items():
                if reason := difference(theirs, versions["client"]):
                    self._leave_out(worker, None, f"it {reason}")
        if not now and not self.lonely:
            self.how.say(f"no worker is connected to {self.how.address}: waiting for one")
        self.workers, self.lonely = now, not now
        for key in [key for key, run in self.sent.items() if run.worker not in now]:
            yield from self._retry_lost(key)

    def _leave_out(self, worker: str, solver: str | None, reason: str) -> None:
        if (worker, solver) not in self.unfit:
            self.unfit[worker, solver] = reason
            self.how.say(f"worker {worker} is left out: {reason}")

    def _send(self) -> Iterator[Event]:
        """Send runs to workers with room for them, and give up those that none of the workers can make."""
        for run in list(self.waiting):
            solver = run.task.identity.solver
            reasons = {w: self.unfit.get((w, None)) or self.unfit.get((w, solver)) for w in self.workers}
            if reasons and all(reasons.values()):
                self.waiting.remove(run)
                worker, reason = next(iter(reasons.items()))
                yield self._refused(run, f"no worker can make it: {worker}: {reason}")
            elif self.how.jobs is None or len(self.sent) < self.how.jobs:
                chosen = self._freest_worker(run, [worker for worker, reason in reasons.items() if reason is None])
                if chosen is not None:
                    self.waiting.remove(run)
                    self._submit(run, chosen)

    def _freest_worker(self, run: _Run, workers: Sequence[str]) -> str | None:
        """Return the worker with most room for a run, if any; a run that has lost a worker gets one for itself."""
        busy = Counter(other.worker for other in self.sent.values())
        taken = {other.worker for other in self.sent.values() if other.losses or run.losses}
        each = self.how.threads or THREADS
        room = {w: max(1, self.workers[w] // each) - busy[w] for w in workers if w not in taken}
        best = max(room, key=lambda worker: room[worker], default=None)
        return best if best is not None and room[best] > 0 else None

    def _submit(self, run: _Run, worker: str) -> None:
        key = f"{run.task.run_id}-{secrets.token_hex(4)}"
        order = (run.task.model_dump_json(), self.topic, self.how.threads, self.how.timeout)
        run.worker, run.began, run.executing = worker, time.monotonic(), False
        run.future = self.client.submit(run_task, *order, key=key, workers=[worker])
        self.sent[key] = run
        run.future.add_done_callback(lambda future: self.events.put({"key": key, "answer": _answer(future)}))

    def _hear(self) -> Iterator[Event]:
        """Wait a limited time for events, and process all of them."""
        with contextlib.suppress(queue.Empty):
            event = self.events.get(timeout=LOOK)
            while True:
                self._check()
                if event["key"] in self.sent:
                    yield from self._react(event["key"], event)
                event = self.events.get_nowait()
        self._check()

    def _check(self) -> None:
        """Check that the scheduler is there, because without it all workers seem to be lost."""
        if self.client.status != "running":
            raise ConnectionError

    def _react(self, key: str, event: Mapping[str, Any]) -> Iterator[Event]:
        run = self.sent[key]
        match event:
            case {"answer": answer}:
                yield from self._handle_answer(key, answer)
            case {"progress": progress} if run.executing:
                yield Progressed(run.task, Progress(*progress))
            case {"environment": _} if run.executing:  # a second time: a new worker at the same address
                yield from self._retry_lost(key)
            case {"environment": environment}:
                place = Environment.model_validate_json(environment)
                run.task = run.task.model_copy(update={"environment": place})
                run.began, run.executing = time.monotonic(), True
                if not run.announced:
                    run.announced = True
                    yield Started(run.task)

    def _handle_answer(self, key: str, answer: Any) -> Iterator[Event]:
        if LOSS_ERRORS & {kind.__name__ for kind in type(answer).__mro__}:  # by name: they differ by Dask's version
            yield from self._retry_lost(key)
            return
        run = self.sent.pop(key)
        if isinstance(answer, ImportError | RuntimeError) and not run.executing:
            reason = f"shellbench can't be used there ({_in_words(answer)}); install the same packages there"
            answer = {"unfit": reason}
        match answer:
            case {"unfit": reason}:
                self._leave_out(run.worker, run.task.identity.solver, reason)
                self.waiting.appendleft(run)
            case {"refused": reason}:
                yield self._refused(run, reason)
            case {"record": text, "files": files}:
                yield self._came_back(run, text, files)
            case error:
                yield self._failed(run, f"its worker {run.worker} could not make it: {_in_words(error)}")

    def _came_back(self, run: _Run, text: str, files: Mapping[str, bytes]) -> Ended:
        try:
            record = read_document(text.encode())
        except InputError:
            return self._failed(run, f"its worker {run.worker} sent no whole record")
        if (record.run_id, record.identity) != (run.task.run_id, run.task.identity):
            return self._failed(run, f"its worker {run.worker} sent the record of another run")
        folder = self.store.begin(run.task.run_id)
        with said_plainly(self.store.folder):
            for name, data in files.items():
                if Path(name).name == name:
                    (folder / name).write_bytes(data)
        return Ended(run.task, folder, record)

    def _retry_lost(self, key: str) -> Iterator[Event]:
        """Schedule a run that has lost its worker after all others, or give it up."""
        run = self.sent.pop(key)
        self.client.cancel([run.future], force=True)
        self.workers.pop(run.worker, None)  # until the next look
        run.losses += 1
        if run.losses >= LOSSES:
            yield self._failed(run, f"the worker was lost {run.losses} times: out of memory or of walltime, perhaps")
        else:
            task = run.task
            self.how.say(f"worker {run.worker} was lost: {task.case_name} {task.identity.solver} is tried again")
            self.waiting.append(run)

    def _refused(self, run: _Run, reason: str) -> Ended:
        return Ended(run.task, self.store.begin(run.task.run_id), refused=reason)

    def _failed(self, run: _Run, reason: str) -> Ended:
        record = run.task.record(status="failed", reason=reason, seconds=time.monotonic() - run.began)
        return Ended(run.task, self.store.begin(run.task.run_id), record)


def _answer(future: Any) -> Any:
    """Return a worker's answer, or its error instead; Dask's own thread calls this."""
    try:
        return future.result()
    except BaseException as error:
        return error


def _in_words(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


@contextlib.contextmanager
def connect_client(given: str) -> Iterator[Any]:
    """Connect to a scheduler by its address or its scheduler file; gives a `distributed.Client`.

    Raises
    ------
    InputError
        If no scheduler answers there, or its versions differ from those here.
    """
    from distributed import Client
    from distributed.utils import silence_logging_cmgr

    address = address_of(given)
    with silence_logging_cmgr(SILENT), warnings.catch_warnings():  # what matters is said in one sentence
        warnings.simplefilter("ignore")
        try:
            asyncio.run(_examine(address))
            client = Client(address, timeout=PATIENCE, set_as_default=False)
        except InputError as error:
            raise InputError(f"--scheduler {given}: {error}") from None
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RuntimeError, ImportError) as error:
            first = _in_words(error).partition(". ")[0]
            raise InputError(f"--scheduler {given}: no Dask scheduler answers there ({first})") from None
        try:
            yield client
        finally:
            with contextlib.suppress(Exception):  # of a lost scheduler there is nothing left to close
                client.close(timeout=PATIENCE)


async def _examine(address: str) -> None:
    """Refuse a server that is no scheduler of the same versions, before a client connects."""
    from distributed import Security, rpc
    from distributed.versions import get_versions

    secure = Security().get_connection_args("client")
    async with rpc(address, timeout=PATIENCE, connection_args=secure) as there:
        kind = (await asyncio.wait_for(there.identity(), PATIENCE))["type"]
        if kind != "Scheduler":
            raise InputError(f"it is the address of a Dask {kind.lower()}, not of a scheduler")
        theirs = await asyncio.wait_for(there.versions(packages=[]), PATIENCE)
    if reason := difference(theirs, get_versions()):
        raise InputError(f"it {reason}")


def difference(theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> str | None:
    """Return the differences of versions that must agree at both ends; None if there are none.

    Both arguments have the form of `distributed.versions.get_versions`. Dask's own check compares many packages, in a
    table.
    """
    there, here = ({name: str(end["packages"].get(name)) for name in MUST_AGREE} for end in (theirs, ours))
    for end in (there, here):
        end["python"] = ".".join(end["python"].split(".")[:2])
    different = [f"{name} {there[name]} (here {here[name]})" for name in MUST_AGREE if there[name] != here[name]]
    return f"has {', '.join(different)}; use the same versions at both ends" if different else None


def address_of(given: str) -> str:
    """Return the given address, or the address in a scheduler file.

    Raises
    ------
    InputError
        If it is neither.
    """
    if "://" in given or not (given.endswith(".json") or Path(given).exists()):
        if re.fullmatch(r".+:\d+/*", given):
            return given
        raise InputError(f"--scheduler {given}: expected an address such as tcp://127.0.0.1:8786, or a scheduler file")
    try:
        return str(json.loads(read_file(Path(given), MAX_BYTES).decode("utf-8"))["address"])
    except InputError as error:
        raise InputError(f"--scheduler {given}: {error}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--scheduler {given}: is no scheduler file, for it names no address") from None
