"""Runs on an existing Dask cluster, each as if it were made on this machine.

Runs are few, long and heavy, and must be charged for what they do themselves. So Dask carries orders and answers,
and the choice of the worker is made here: a worker gets as many runs at a time as its threads allow, never one that
waits behind another. A worker that is lost costs the runs that it had, and no others. Each of them is tried again,
and then has a worker for itself, so that of runs that were lost together only the one to blame is lost again.

Solvers are referred to by name and cases are data: nothing of the user's is pickled.
"""

from __future__ import annotations

import queue
import secrets
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from shellbench.bench.environment import THREADS
from shellbench.bench.execute import Ended, Event, Progressed, Started
from shellbench.bench.record import Environment, read_document
from shellbench.bench.remote import Order, run_order, unpack
from shellbench.bench.scheduler import Scheduler, connected
from shellbench.bench.store import Store, said_plainly
from shellbench.bench.task import Task
from shellbench.errors import InputError
from shellbench.problem import Progress

LOSSES = 3  # workers that a run may lose before it counts as failed
LOOK = 1.0  # seconds between two looks at the workers
ANY_SOLVER = ""
LOSS_ERRORS = {"KilledWorker", "CancelledError", "FutureCancelledError", "FuturesCancelledError", "AbandonedError"}


@dataclass(frozen=True)
class DaskCluster:
    """Makes runs on the workers of a Dask scheduler.

    Attributes
    ----------
    address
        Of the scheduler, or its scheduler file.
    jobs
        Runs at a time at most; None for as many as the workers take.
    threads
        Of each run; None for as many as usual. A worker takes one run for so many threads of its own, and always one.
    timeout
        Seconds after which a run is stopped by its worker; None for none.
    say
        Takes sentences on workers that are waited for, lost or unfit.
    """

    address: str
    jobs: int | None
    threads: int | None
    timeout: float | None
    say: Callable[[str], None]

    def expect(self, task: Task) -> None:
        """Do nothing: the workers get ready by themselves."""

    def close(self) -> None:
        """Do nothing."""

    def run(self, tasks: Sequence[Task], store: Store) -> Generator[Event, None, None]:
        """Make runs; see `shellbench.bench.execute.Executor`.

        Raises
        ------
        InputError
            If `distributed` is not installed, or no scheduler answers.
        SchedulerLostError
            If the scheduler is gone in mid-run.
        """
        with connected(self.address) as scheduler:
            sweep = _Sweep(self, scheduler, store, deque(tasks))
            try:
                yield from sweep.make()
            finally:
                sweep.stop()


@dataclass
class _Sent:
    """A run that a worker has been sent."""

    task: Task
    worker: str
    future: Any
    began: float
    started: bool = False


@dataclass
class _Sweep:
    """Runs that wait and that go on."""

    how: DaskCluster
    scheduler: Scheduler
    store: Store
    waiting: deque[Task]
    topic: str = field(default_factory=lambda: f"shellbench-{secrets.token_hex(8)}")
    workers: dict[str, int] = field(default_factory=dict)
    unfit: dict[tuple[str, str], str] = field(default_factory=dict)
    sent: dict[str, _Sent] = field(default_factory=dict)
    losses: Counter[str] = field(default_factory=Counter)
    shown: set[str] = field(default_factory=set)
    heard: queue.SimpleQueue[tuple[str, Any]] = field(default_factory=queue.SimpleQueue)
    looked: float = float("-inf")
    waits_for_workers: bool = False

    def make(self) -> Iterator[Event]:
        self.scheduler.client.subscribe_topic(self.topic, lambda event: self.heard.put(("event", event[1])))
        while self.waiting or self.sent:
            if time.monotonic() - self.looked >= LOOK:
                yield from self._look()
            yield from self._refuse()
            self._send()
            yield from self._hear()

    def stop(self) -> None:
        """Have the workers stop the runs that go on: they look every second whether somebody waits for them."""
        futures = [sent.future for sent in self.sent.values()]
        self.sent.clear()
        if futures and self.scheduler.client.status == "running":
            with self.scheduler.losses_said():
                self.scheduler.client.cancel(futures, force=True)

    def _look(self) -> Iterator[Event]:
        """See which workers have come and which are lost."""
        now = self.scheduler.workers()
        if set(now) - set(self.workers):
            for address, reason in self.scheduler.misfits().items():
                self._leave_out(address, ANY_SOLVER, f"it {reason}; use the same versions at both ends")
        self.workers, self.looked = now, time.monotonic()
        if not now and not self.waits_for_workers:
            self.how.say(f"no worker is connected to {self.how.address}: waiting for one")
        self.waits_for_workers = not now
        for key in [key for key, sent in self.sent.items() if sent.worker not in now]:
            yield from self._lost(key)

    def _leave_out(self, worker: str, solver: str, reason: str) -> None:
        if (worker, solver) not in self.unfit:
            self.unfit[worker, solver] = reason
            self.how.say(f"worker {worker} is left out: {reason}")

    def _why_unfit(self, worker: str, solver: str) -> str | None:
        return self.unfit.get((worker, ANY_SOLVER)) or self.unfit.get((worker, solver))

    def _refuse(self) -> Iterator[Event]:
        """Give up runs that none of the workers can make."""
        for task in list(self.waiting):
            reasons = {worker: self._why_unfit(worker, task.identity.solver) for worker in self.workers}
            if reasons and all(reasons.values()):
                self.waiting.remove(task)
                worker, reason = next(iter(reasons.items()))
                yield Ended(task, self.store.begin(task.run_id), refused=f"no worker can make it: {worker}: {reason}")

    def _send(self) -> None:
        for task in list(self.waiting):
            if self.how.jobs is not None and len(self.sent) >= self.how.jobs:
                return
            worker = self._free_worker(task)
            if worker is not None:
                self.waiting.remove(task)
                self._submit(task, worker)

    def _free_worker(self, task: Task) -> str | None:
        """Return the worker with most room for a run; one that has lost a worker needs an empty one."""
        busy = Counter(sent.worker for sent in self.sent.values())
        alone = {sent.worker for sent in self.sent.values() if self.losses[sent.task.run_id]}
        room = {
            worker: max(1, threads // (self.how.threads or THREADS)) - busy[worker]
            for worker, threads in self.workers.items()
            if worker not in alone
            and self._why_unfit(worker, task.identity.solver) is None
            and not (self.losses[task.run_id] and busy[worker])
        }
        best = max(room, key=lambda worker: room[worker], default=None)
        return best if best is not None and room[best] > 0 else None

    def _submit(self, task: Task, worker: str) -> None:
        order = Order(task=task, topic=self.topic, threads=self.how.threads, timeout=self.how.timeout)
        key = f"{task.run_id}-{secrets.token_hex(4)}"
        with self.scheduler.losses_said():
            future = self.scheduler.client.submit(
                run_order,
                order.model_dump_json(),
                key=key,
                pure=False,
                retries=0,
                workers=[worker],
                allow_other_workers=False,
            )
        self.sent[key] = _Sent(task, worker, future, time.monotonic())
        future.add_done_callback(lambda done: self.heard.put((key, _answer(done))))

    def _hear(self) -> Iterator[Event]:
        """Take in what has come, and wait for something for a while."""
        wait = LOOK
        while True:
            try:
                key, said = self.heard.get(timeout=wait)
            except queue.Empty:
                break
            wait = 0.0
            if key == "event":
                yield from self._told(said)
            elif key in self.sent:
                yield from self._answered(key, said)
        self.scheduler.check()

    def _told(self, event: Mapping[str, Any]) -> Iterator[Event]:
        sent = self.sent.get(event["key"])
        if sent is None:
            return
        if "environment" not in event:
            if sent.started:
                yield Progressed(sent.task, Progress(event["step"], event["total"], event["message"]))
        elif sent.started:  # a second time: a new worker at the same address
            yield from self._lost(event["key"])
        else:
            place = Environment.model_validate_json(event["environment"])
            sent.task = sent.task.model_copy(update={"environment": place})
            sent.started, sent.began = True, time.monotonic()
            if sent.task.run_id not in self.shown:
                self.shown.add(sent.task.run_id)
                yield Started(sent.task)

    def _answered(self, key: str, answer: Any) -> Iterator[Event]:
        sent = self.sent[key]
        self.scheduler.check()
        if isinstance(answer, BaseException):
            if _is_loss(answer):
                yield from self._lost(key)
                return
            if isinstance(answer, ImportError | RuntimeError) and not sent.started:
                reason = f"shellbench can't be used there ({_said(answer)}); install there what is installed here"
                answer = {"unfit": reason}
        del self.sent[key]
        if isinstance(answer, BaseException):
            yield self._failed(sent, f"its worker {sent.worker} could not make it: {_said(answer)}")
        elif "unfit" in answer:
            self._leave_out(sent.worker, sent.task.identity.solver, answer["unfit"])
            self.waiting.appendleft(sent.task)
        else:
            yield self._came_back(sent, answer)

    def _came_back(self, sent: _Sent, answer: Mapping[str, Any]) -> Ended:
        if "refused" in answer:
            return Ended(sent.task, self.store.begin(sent.task.run_id), refused=answer["refused"])
        try:
            record = read_document(answer["record"].encode())
        except InputError:
            return self._failed(sent, f"its worker {sent.worker} sent no whole record")
        if (record.run_id, record.identity) != (sent.task.run_id, sent.task.identity):
            return self._failed(sent, f"its worker {sent.worker} sent the record of another run")
        folder = self.store.begin(sent.task.run_id)
        with said_plainly(self.store.folder):
            unpack(answer["files"], folder)
        return Ended(sent.task, folder, record)

    def _lost(self, key: str) -> Iterator[Event]:
        """Try a run that has lost its worker again, when the others have been; or give it up."""
        sent = self.sent.pop(key)
        with self.scheduler.losses_said():
            self.scheduler.client.cancel([sent.future], force=True)
        task = sent.task
        self.losses[task.run_id] += 1
        count = self.losses[task.run_id]
        if count >= LOSSES:
            yield self._failed(sent, f"the worker was lost {count} times: out of memory or of walltime, perhaps")
            return
        self.how.say(f"worker {sent.worker} was lost: {task.case_name} {task.identity.solver} is tried again")
        self.waiting.append(task)
        self.looked = float("-inf")  # the worker must not be taken for one that is there

    def _failed(self, sent: _Sent, reason: str) -> Ended:
        record = sent.task.record(status="failed", reason=reason, seconds=time.monotonic() - sent.began)
        return Ended(sent.task, self.store.begin(sent.task.run_id), record)


def _answer(future: Any) -> Any:
    """Return what a worker has answered, or the error in its place; fetched in Dask's own thread."""
    try:
        return future.result()
    except BaseException as error:
        return error


def _is_loss(error: BaseException) -> bool:
    """Tell whether a worker was lost: by name, for Dask's modules must not be needed to read this one."""
    names = {kind.__name__ for kind in type(error).__mro__}
    return bool(names & LOSS_ERRORS)


def _said(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
