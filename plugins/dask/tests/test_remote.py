"""Execution of an order by a worker."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from on_cluster import toy_tasks
from shellbench_dask import remote
from shellbench_dask.remote import reason_unfit, standing_by

from shellbench.bench.plugins import source
from shellbench.bench.plugins.process import ServerProcess
from shellbench.bench.store.store import Store

pytestmark = pytest.mark.usefixtures("toys")


def with_engine(store: Store, engine: str) -> Any:
    (task,) = toy_tasks(store, "exact")
    settings = {**task.identity.settings, "engine": engine}
    return task.model_copy(update={"identity": task.identity.model_copy(update={"settings": settings})})


def test_an_engine_of_another_version_does_not_fit(store: Store) -> None:
    said = "; install the same version there"
    assert reason_unfit(with_engine(store, "psutil 0.1")).endswith(said)
    assert reason_unfit(with_engine(store, "psutil 0.1")).startswith(
        "solver 'toy' was planned with psutil 0.1, but it has psutil "
    )
    assert (
        reason_unfit(with_engine(store, "no-such 1.0"))
        == f"solver 'toy' was planned with no-such 1.0, but it has no no-such{said}"
    )
    assert reason_unfit(with_engine(store, remote.engine_version("psutil"))) is None


def test_the_source_is_read_by_one_thread_at_a_time(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    (task,) = toy_tasks(store, "exact")
    inside: list[int] = []
    reading = source.source_digest

    def alone(*modules: Any) -> str:
        inside.append(1)
        assert len(inside) == 1
        try:
            return reading(*modules)
        finally:
            inside.pop()

    monkeypatch.setattr("shellbench.bench.store.identity.source_digest", alone)
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(reason_unfit, [task] * 8)) == [None] * 8


class Loop:
    """Stands for a worker's event loop; time passes when the test says so."""

    def __init__(self) -> None:
        self.later: list[Any] = []

    def add_callback(self, function: Any, *arguments: Any) -> None:
        function(*arguments)

    def call_later(self, seconds: float, function: Any, *arguments: Any) -> None:
        self.later.append(lambda: function(*arguments))


def test_a_server_stands_by_for_the_same_source_and_is_ended_when_it_is_not_used(store: Store, plugin: Path) -> None:
    worker = SimpleNamespace(loop=Loop())
    (task,) = toy_tasks(store, "exact")
    other = task.model_copy(update={"identity": task.identity.model_copy(update={"source": "other"})})
    server = ServerProcess.start("toy", task.target, 1)
    try:
        with standing_by(worker, task) as idle:
            assert idle == []
            idle.append(server)
        with standing_by(worker, other) as idle:
            assert idle == []
        with standing_by(worker, task) as idle:
            assert idle == [server]
            worker.loop.later.pop()()  # its time is over, but it is in use
            assert server.process.poll() is None
        worker.loop.later.pop()()
        assert server.process.poll() is not None
        with standing_by(worker, task) as idle:
            assert idle == []
    finally:
        server.end()
