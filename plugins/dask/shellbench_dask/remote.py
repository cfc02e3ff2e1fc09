"""One run on a worker of a Dask cluster, for `shellbench_dask.cluster`.

A task arrives as text and runs as a local run (`shellbench.bench.run.local`) in a temporary folder, in a process of its
own. Its record and the bytes of its files are sent back. The worker tells the client its start and its progress.
"""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from shellbench.bench.plugins.kinds import kind_name
from shellbench.bench.plugins.process import ServerProcess
from shellbench.bench.plugins.registry import find_solver
from shellbench.bench.run.execute import Ended, Progressed
from shellbench.bench.run.local import LocalProcesses
from shellbench.bench.store.environment import engine_distribution, environment, threads
from shellbench.bench.store.identity import current_source
from shellbench.bench.store.record import document
from shellbench.bench.store.store import LOG, Store
from shellbench.bench.store.task import Task
from shellbench.errors import InputError, ShellbenchError
from shellbench.protocol.engine import ENGINE, engine_version

RUNNING = {"executing", "long-running"}  # states of a Dask task that a client still waits for
SERVING = {"running", "paused", "closing_gracefully"}  # states of a Dask worker that can still answer
PARSING = threading.Lock()  # threads must not parse Python at the same time before CPython 3.12 (its issue 106905)
STANDS_BY = 30.0  # seconds for which a solver stays imported on a worker after a run
PAUSE = 1.0  # seconds between two progress messages of a run, which all pass the scheduler


def run_task(text: str, topic: str, threads_each: int | None, timeout: float | None) -> dict[str, Any]:
    """Make a run in a thread of a Dask worker; clients refer to this function by its name.

    Parameters
    ----------
    text
        The task, as JSON.
    topic
        Dask's topic for the worker's events.
    threads_each
        Threads of the run; None for the default on the worker's machine.

    Returns
    -------
    dict
        One of: ``unfit``, the reason why this worker can't make it; ``refused``, the reason why the solver refused its
        input; ``record``, JSON, with ``files``, their bytes by name.

    Raises
    ------
    AbandonedError
        If no client waits for it any more, or the worker is being closed.
    """
    from distributed import get_worker

    task = Task.model_validate_json(text)
    reason = reason_unfit(task)
    if reason is not None:
        return {"unfit": reason}
    name, settings = task.identity.solver, task.identity.settings
    place = environment(
        task.identity.device,
        find_solver(name).distribution,
        threads_each=threads_each or threads(),
        engine=engine_distribution(settings),
    )
    task = task.model_copy(update={"environment": place})
    worker = get_worker()
    key = worker.get_current_task()

    def wanted() -> bool:
        state = worker.state.tasks.get(key)
        return worker.status.name in SERVING and state is not None and state.state in RUNNING

    worker.log_event(topic, {"key": key, "environment": place.model_dump_json()})
    told = -PAUSE
    with (
        standing_by(worker, task) as idle,
        tempfile.TemporaryDirectory(prefix="shellbench-", ignore_cleanup_errors=True) as folder,
    ):
        processes = LocalProcesses(1, place.threads, timeout, wanted, idle, keep=True)
        try:
            with contextlib.closing(processes.run([task], Store(Path(folder)))) as events:
                for event in events:
                    if isinstance(event, Progressed) and time.monotonic() - told >= PAUSE:
                        told = time.monotonic()
                        progress = event.progress
                        step = (progress.step, progress.total, progress.message)
                        worker.log_event(topic, {"key": key, "progress": step})
                    elif isinstance(event, Ended):
                        return pack_results(event)
        except ShellbenchError as error:
            record = task.record(status="failed", reason=f"on its worker: {error}", seconds=0.0)
            return {"record": document(record).decode(), "files": {}}
    raise AssertionError("a run ended without a word")


def reason_unfit(task: Task) -> str | None:
    """Return the reason why this machine can't make the planned run, or None if it can."""
    name = task.identity.solver
    try:
        with PARSING:
            source = current_source(find_solver(name), kind_name(task.case))
    except (InputError, OSError, SyntaxError) as error:
        return f"{error}; install the same packages there"
    if source != task.identity.source:
        return f"the source of solver '{name}' differs from the one here; install the same version there"
    engine = engine_distribution(task.identity.settings)
    wanted = task.identity.settings.get(ENGINE)
    if engine is not None and engine_version(engine) != wanted:
        found = engine_version(engine) or f"no {engine}"
        return f"solver '{name}' was planned with {wanted}, but it has {found}; install the same version there"
    return None


@contextlib.contextmanager
def standing_by(worker: Any, task: Task) -> Iterator[list[ServerProcess]]:
    """Lend an idle fork server that has imported a task's solver, if there is one, and keep idle servers.

    Runs therefore do not repeat the imports. Servers are ended when they have been idle for a while, and end with the
    Dask worker. They are an attribute of the worker, because a plug-in of Dask would stay on the cluster.
    """
    identity = task.identity
    key = (identity.solver, identity.source, identity.settings.get(ENGINE), task.target, task.environment.threads)
    entries: list[tuple[ServerProcess, float]] = vars(worker).setdefault("shellbench_servers", {}).setdefault(key, [])
    idle: list[ServerProcess] = []
    with contextlib.suppress(IndexError):  # none, or another run's thread was faster
        while not idle:
            server, _ = entries.pop()
            if server.process.poll() is None:
                idle.append(server)
            else:
                server.end()

    def end(entry: tuple[ServerProcess, float]) -> None:
        with contextlib.suppress(ValueError):  # it is in use, or was used since: its entry is a new one
            entries.remove(entry)
            entry[0].end()

    try:
        yield idle
    finally:
        for server in idle:
            entry = (server, time.monotonic())
            entries.append(entry)
            worker.loop.add_callback(worker.loop.call_later, STANDS_BY, end, entry)


def pack_results(ended: Ended) -> dict[str, Any]:
    """Return the results of a run as data."""
    record = ended.record
    if record is None:
        return {"refused": ended.refused}
    names = {LOG, *(name for name in (record.fields_file, record.solution_file) if name)}
    files = {name: (ended.folder / name).read_bytes() for name in names if (ended.folder / name).is_file()}
    return {"record": document(record).decode(), "files": files}
