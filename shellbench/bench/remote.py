"""One run on a worker of a Dask cluster: what `shellbench.bench.cluster` has a worker do.

A task comes as text, is run by the machinery of local runs (`shellbench.bench.local`) in a temporary folder, in a
process of its own, and goes back whole: its record and the bytes of its files. On its way it tells the client that it
has started, and how far it is.
"""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from shellbench.bench.environment import engine_distribution, environment, threads
from shellbench.bench.execute import Ended, Progressed, Started
from shellbench.bench.identity import current_source
from shellbench.bench.kinds import kind_name
from shellbench.bench.local import LocalProcesses
from shellbench.bench.process import ServerProcess
from shellbench.bench.record import document
from shellbench.bench.registry import find_solver
from shellbench.bench.store import LOG, Store
from shellbench.bench.task import Task
from shellbench.engine import ENGINE, engine_version
from shellbench.errors import InputError, ShellbenchError
from shellbench.model import Model

RUNNING = {"executing", "long-running"}  # states of a Dask task that somebody still waits for
SERVING = {"running", "paused", "closing_gracefully"}  # states of a Dask worker that can still answer
PARSING = threading.Lock()  # threads must not parse Python at the same time before CPython 3.12 (its issue 106905)
STANDS_BY = 30.0  # seconds for which a solver stays imported on a worker after a run
PAUSE = 1.0  # seconds between two words on progress, of each run: they all go through the scheduler


class Order(Model):
    """A run to be made on a worker.

    Attributes
    ----------
    topic
        Under which the worker tells what happens.
    threads
        Of the run; None for as many as usual on the worker's machine.
    """

    task: Task
    topic: str
    threads: int | None = None
    timeout: float | None = None


def run_order(text: str) -> dict[str, Any]:
    """Do an order, which is JSON, in a thread of a Dask worker; refer to this function by its name.

    Returns
    -------
    dict
        One of: ``unfit``, why this worker can't do it; ``refused``, why the solver refused its input; ``record``, JSON,
        with ``files``, their bytes by name.

    Raises
    ------
    AbandonedError
        If nobody waits for it any more, or the worker is being closed.
    """
    order = Order.model_validate_json(text)
    worker: Any = import_module("distributed").get_worker()
    key = worker.get_current_task()
    reason = unfit(order.task)
    if reason is not None:
        return {"unfit": reason}
    task = at_home(order.task, order.threads)

    def wanted() -> bool:
        state = worker.state.tasks.get(key)
        return worker.status.name in SERVING and state is not None and state.state in RUNNING

    def tell(**event: Any) -> None:
        worker.log_event(order.topic, {"key": key, **event})

    tell(environment=task.environment.model_dump_json())
    standing_by = StandingBy.for_task(worker, task)
    processes = LocalProcesses(1, task.environment.threads, order.timeout, wanted, standing_by.take(), keep=True)
    with (
        standing_by.taking_back(processes.idle),
        tempfile.TemporaryDirectory(prefix="shellbench-", ignore_cleanup_errors=True) as folder,
    ):
        try:
            return packed(run_one(task, processes, Store(Path(folder)), tell))
        except ShellbenchError as error:
            record = task.record(status="failed", reason=f"on its worker: {error}", seconds=0.0)
            return {"record": document(record).decode(), "files": {}}


@dataclass(frozen=True)
class StandingBy:
    """Fork servers that stand by on a Dask worker between runs of the same source, so that not each run imports anew.

    They are ended when they have not been used for a while, and end by themselves when the Dask worker does.
    """

    entries: list[_Entry]
    loop: Any

    @classmethod
    def for_task(cls, worker: Any, task: Task) -> StandingBy:
        """Return those of a worker, of which it is an attribute, that have imported what a task needs."""
        identity = task.identity
        key = (identity.solver, identity.source, identity.settings.get(ENGINE), task.target, task.environment.threads)
        known = worker.__dict__.setdefault("shellbench_servers", {})
        return cls(known.setdefault(key, []), worker.loop)

    def take(self) -> list[ServerProcess]:
        """Return one that lives, or none."""
        with contextlib.suppress(IndexError):
            while True:
                server = self.entries.pop().server
                if server.process.poll() is None:
                    return [server]
                server.end()
        return []

    @contextlib.contextmanager
    def taking_back(self, idle: list[ServerProcess]) -> Iterator[None]:
        """Have the servers that a run has left idle stand by."""
        try:
            yield
        finally:
            for server in idle:
                entry = _Entry(server)
                self.entries.append(entry)
                self.loop.add_callback(self.loop.call_later, STANDS_BY, self._end, entry)

    def _end(self, entry: _Entry) -> None:
        """End a server, unless it is in use or has been since."""
        with contextlib.suppress(ValueError):
            self.entries.remove(entry)
            entry.server.end()


@dataclass(frozen=True, eq=False)
class _Entry:
    """A server that stands by since it was put there: one that is put there again is another entry."""

    server: ServerProcess


def unfit(task: Task) -> str | None:
    """Return why this machine can't make the run that was planned, or None if it can."""
    name = task.identity.solver
    try:
        with PARSING:
            source = current_source(find_solver(name), kind_name(task.case))
    except (InputError, OSError, SyntaxError) as error:
        return f"{error}; install there what is installed here"
    if source != task.identity.source:
        return f"the source of solver '{name}' differs from the one here; install the same version there"
    engine = engine_distribution(task.identity.settings)
    wanted = task.identity.settings.get(ENGINE)
    if engine is not None and engine_version(engine) != wanted:
        found = engine_version(engine) or f"no {engine}"
        return f"solver '{name}' was planned with {wanted}, but it has {found}; install the same version there"
    return None


def at_home(task: Task, threads_each: int | None) -> Task:
    """Return a task with this machine as its environment."""
    place = environment(
        task.identity.device,
        find_solver(task.identity.solver).distribution,
        threads_each=threads_each or threads(),
        engine=engine_distribution(task.identity.settings),
    )
    return task.model_copy(update={"environment": place})


def run_one(task: Task, processes: LocalProcesses, store: Store, tell: Callable[..., None]) -> Ended:
    """Make one run, and pass on now and then how far it is."""
    said = -PAUSE
    with contextlib.closing(processes.run([task], store)) as events:
        for event in events:
            match event:
                case Started():
                    pass
                case Progressed(_, progress):
                    now = time.monotonic()
                    if now - said >= PAUSE:
                        said = now
                        tell(step=progress.step, total=progress.total, message=progress.message)
                case Ended():
                    return event
    raise AssertionError("a run ended without a word")


def packed(ended: Ended) -> dict[str, Any]:
    """Return what a run has left as data."""
    record = ended.record
    if record is None:
        return {"refused": ended.refused}
    names = {LOG, *(name for name in (record.fields_file, record.solution_file) if name)}
    files = {name: (ended.folder / name).read_bytes() for name in names if (ended.folder / name).is_file()}
    return {"record": document(record).decode(), "files": files}


def unpack(files: Mapping[str, bytes], folder: Path) -> None:
    """Write the files of a run into its folder here."""
    for name, data in files.items():
        if Path(name).name == name:
            (folder / name).write_bytes(data)
