"""Distribution of runs over workers, and repetition of lost ones; the tests replace Dask to control the order of events."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest
from on_cluster import toy_tasks
from shellbench_dask import cluster
from shellbench_dask.cluster import LOSSES, DaskCluster, SchedulerLostError, difference

from shellbench.bench.run.execute import Ended, Event, Started
from shellbench.bench.store.store import Store

pytestmark = pytest.mark.usefixtures("toys")


def versions(**packages: str) -> dict[str, Any]:
    return {"packages": {"python": "3.11.8.final.0", "distributed": "2026.8.0", **packages}}


class Future:
    """A run that was sent to a worker; the test decides its end."""

    def __init__(self, key: str, behaviour: str, worker: str) -> None:
        self.key, self.behaviour, self.worker = key, behaviour, worker

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        self.callback = callback

    def end(self, answer: Any) -> None:
        self.answer = answer
        self.callback(self)

    def result(self) -> Any:
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer


class Dask:
    """Stands for Dask's client: at each look at the workers, what goes on there has ended or has lost its worker.

    Attributes
    ----------
    threads
        Of each worker.
    together
        What went on at each look, by behaviour.
    """

    status = "running"
    scheduler = SimpleNamespace(ncores=None)

    def __init__(self, *threads: int) -> None:
        self.threads = threads
        self.generation = 0
        self.going: list[Future] = []
        self.together: list[list[str]] = []

    def subscribe_topic(self, topic: str, handler: Callable[[Any], None]) -> None:
        self.tell = handler

    def get_versions(self) -> dict[str, Any]:
        return {"client": versions(), "workers": dict.fromkeys(self.workers(), versions())}

    def workers(self) -> dict[str, int]:
        return {f"tcp://{self.generation}.{number}": threads for number, threads in enumerate(self.threads)}

    def submit(self, function: Any, text: str, *order: Any, key: str, workers: list[str]) -> Future:
        assert workers[0] in self.workers()
        future = Future(key, json.loads(text)["settings"]["behaviour"], workers[0])
        self.going.append(future)
        return future

    def cancel(self, futures: list[Future], force: bool) -> None:
        assert force

    def sync(self, ask: Any, callback_timeout: float) -> dict[str, int]:
        going, self.going = self.going, []
        if going:
            self.together.append(sorted(future.behaviour for future in going))
        if any(future.behaviour == "kill_worker" for future in going):
            self.generation += 1
        else:
            for future in going:
                future.end({"refused": "done"})
        return self.workers()


def played(monkeypatch: pytest.MonkeyPatch, dask: Any) -> Callable[..., list[Event]]:
    """Make runs with a client that the test plays."""
    monkeypatch.setattr(cluster, "connect_client", lambda given: nullcontext(dask))
    monkeypatch.setattr(cluster, "LOOK", 0.01)
    return lambda store, tasks, jobs=None, threads=1, said=None: list(
        DaskCluster("tcp://here", jobs, threads, None, (said if said is not None else []).append).run(tasks, store)
    )


def test_of_runs_lost_together_only_the_one_to_blame_is_lost_again(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    dask = Dask(3)
    events = played(monkeypatch, dask)(store, toy_tasks(store, "exact", "kill_worker", "print", "fail"))
    assert dask.together[:2] == [["exact", "kill_worker", "print"], ["fail"]]  # what has not been lost comes first
    assert sorted(dask.together[2:]) == [["exact"], *[["kill_worker"]] * (LOSSES - 1), ["print"]]
    ended = {event.task.settings["behaviour"]: event for event in events if isinstance(event, Ended)}
    assert ended["exact"].refused == ended["print"].refused == "done"
    record = ended["kill_worker"].record
    assert record is not None
    assert (record.status, record.reason) == (
        "failed",
        f"the worker was lost {LOSSES} times: out of memory or of walltime, perhaps",
    )


@pytest.mark.parametrize(
    ("threads", "jobs", "most"),
    [(1, None, 6), (2, None, 3), (3, None, 2), (8, None, 2), (1, 2, 2), (None, None, 3)],
    ids=str,
)
def test_a_worker_takes_what_its_threads_allow_and_one_run_at_least(
    store: Store, monkeypatch: pytest.MonkeyPatch, threads: int | None, jobs: int | None, most: int
) -> None:
    dask = Dask(4, 2)
    events = played(monkeypatch, dask)(store, toy_tasks(store, *["exact"] * 6), jobs, threads)
    assert [len(runs) for runs in dask.together] == [most] * (6 // most)
    assert len(events) == 6


def test_a_run_that_starts_a_second_time_has_lost_its_worker(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    class SameAddress(Dask):
        """Its worker dies at the first run, and another comes at once at the same address: Dask runs it again."""

        def submit(self, function: Any, text: str, *order: Any, key: str, workers: list[str]) -> Future:
            first = not self.together and not self.going
            place = json.dumps(json.loads(text)["environment"])
            for _ in range(2 if first else 1):
                self.tell((0.0, {"key": key, "environment": place}))
            return super().submit(function, text, *order, key=key, workers=workers)

    said: list[str] = []
    events = played(monkeypatch, SameAddress(1))(store, toy_tasks(store, "exact"), said=said)
    assert said == ["worker tcp://0.0 was lost: strip toy is tried again"]
    assert [type(event) for event in events] == [Started, Ended]


def test_a_worker_that_cannot_import_shellbench_is_left_out(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    class Bare(Dask):
        def sync(self, ask: Any, callback_timeout: float) -> dict[str, int]:
            for future in self.going:
                future.end(ModuleNotFoundError("No module named 'shellbench'"))
            self.going = []
            return self.workers()

    said: list[str] = []
    (event,) = played(monkeypatch, Bare(1))(store, toy_tasks(store, "exact"), said=said)
    reason = "shellbench can't be used there (No module named 'shellbench'); install the same packages there"
    assert said == [f"worker tcp://0.0 is left out: {reason}"]
    assert isinstance(event, Ended)
    assert event.refused == f"no worker can make it: tcp://0.0: {reason}"


def test_workers_of_other_versions_do_not_fit(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    class Mixed(Dask):
        def get_versions(self) -> dict[str, Any]:
            there = (versions(python="3.12.1.final.0"), versions(distributed="2024.1.0"))
            return {"client": versions(), "workers": dict(zip(self.workers(), there, strict=True))}

    said: list[str] = []
    (event,) = played(monkeypatch, Mixed(1, 1))(store, toy_tasks(store, "exact"), said=said)
    reason = "it has python 3.12 (here 3.11); use the same versions at both ends"
    assert said == [
        f"worker tcp://0.0 is left out: {reason}",
        "worker tcp://0.1 is left out: it has distributed 2024.1.0 (here 2026.8.0); use the same versions at both ends",
    ]
    assert isinstance(event, Ended)
    assert event.refused == f"no worker can make it: tcp://0.0: {reason}"


def test_the_patch_version_of_python_may_differ() -> None:
    assert difference(versions(python="3.11.2.final.0"), versions()) is None


def test_a_closed_connection_is_one_sentence(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    dask = Dask(1)
    dask.status = "connecting"
    with pytest.raises(SchedulerLostError, match="the scheduler tcp://here is gone"):
        played(monkeypatch, dask)(store, toy_tasks(store, "exact"))


def test_a_scheduler_that_does_not_answer_any_more_is_one_sentence(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Mute(Dask):
        def sync(self, ask: Any, callback_timeout: float) -> dict[str, int]:
            raise TimeoutError

    with pytest.raises(SchedulerLostError, match="the scheduler tcp://here is gone"):
        played(monkeypatch, Mute(1))(store, toy_tasks(store, "exact"))
