"""Runs on a cluster: what comes back, and what a lost worker costs."""

from pathlib import Path

import pytest
from on_cluster import by_behaviour, on_cluster, toy_tasks
from shellbench_dask import cluster as module
from shellbench_dask.cluster import LOSSES, DaskCluster, address_of
from two_workers import Cluster

from shellbench.bench.run.display import Silent
from shellbench.bench.run.execute import execute
from shellbench.bench.store.store import Store
from shellbench.errors import InputError
from tests.bench.test_compare import edit
from tests.patience import until

pytestmark = pytest.mark.usefixtures("toys")


def test_a_lost_worker_costs_its_own_runs_only_and_they_are_tried_again(
    cluster: Cluster, store: Store, tmp_path: Path
) -> None:
    gate = tmp_path / "gate"

    class Killer(Silent):
        def __init__(self) -> None:
            self.killed = False

        def progressed(self, task, progress) -> None:
            if task.settings.get("factor") == 2.0 and not self.killed:
                self.killed = True
                cluster.kill_worker_of_a_run()
                gate.touch()

    killer = Killer()
    said: list[str] = []
    waiting = toy_tasks(store, "exact", factor=2.0, gate=str(gate))
    outcomes = on_cluster(cluster, [*waiting, *toy_tasks(store, "exact", "print")], store, killer, said)
    assert killer.killed
    assert [o.record.status for o in outcomes if o.record] == ["ok", "ok", "ok"]
    assert len([sentence for sentence in said if "was lost: strip toy is tried again" in sentence]) == 1
    assert len(store.read().records) == 3


@pytest.mark.long
def test_a_run_that_loses_each_worker_is_one_failed_record_and_others_survive(cluster: Cluster, store: Store) -> None:
    said: list[str] = []
    outcomes = by_behaviour(
        on_cluster(cluster, toy_tasks(store, "kill_worker", "exact", "print", "raise"), store, said=said)
    )
    lost = outcomes["kill_worker"].record
    assert lost is not None
    assert (lost.status, lost.reason) == (
        "failed",
        f"the worker was lost {LOSSES} times: out of memory or of walltime, perhaps",
    )
    assert len([sentence for sentence in said if "is tried again" in sentence]) == LOSSES - 1
    assert outcomes["exact"].record is not None
    assert outcomes["exact"].record.status == outcomes["print"].record.status == "ok"
    assert outcomes["raise"].record.reason == "the solver stopped unexpectedly: ZeroDivisionError: a bug in the solver"


def test_a_worker_whose_solver_differs_is_left_out_in_one_sentence(
    cluster: Cluster, store: Store, plugin: Path
) -> None:
    edit(plugin / "toy_shells" / "strip.py", "24", "25")
    said: list[str] = []
    outcomes = on_cluster(cluster, toy_tasks(store, "exact", "print", "fail"), store, said=said)
    assert store.read().records == ()
    assert len(said) == len(cluster.workers())  # each worker is asked once, whatever the number of runs
    for sentence in (*said, *(outcome.refused for outcome in outcomes)):
        assert sentence is not None
        assert "tcp://" in sentence
        assert "the source of solver 'toy' differs from the one here; install the same version there" in sentence
    assert len(outcomes) == 3


def test_a_worker_without_the_solver_says_so(cluster: Cluster, store: Store, plugin: Path) -> None:
    edit(plugin / "toy_shells-1.0.dist-info" / "entry_points.txt", "toy =", "toy-renamed =")
    tasks = toy_tasks(store, "exact", solver="toy-renamed")
    (outcome,) = on_cluster(cluster, tasks, store)
    assert "unknown solver 'toy-renamed'" in (outcome.refused or "")
    assert "install the same packages there" in (outcome.refused or "")


def test_the_environment_is_that_of_the_worker(cluster: Cluster, store: Store) -> None:
    (task,) = toy_tasks(store, "exact")
    elsewhere = task.environment.model_copy(update={"processor": "of the client", "git_sha": "0" * 40})
    (outcome,) = on_cluster(cluster, [task.model_copy(update={"environment": elsewhere})], store)
    assert outcome.record is not None
    assert outcome.record.environment == task.environment


def test_so_many_runs_at_a_time_at_most(cluster: Cluster, store: Store) -> None:
    class Counter(Silent):
        now = most = 0

        def started(self, task) -> None:
            self.now += 1
            self.most = max(self.most, self.now)

        def ended(self, outcome) -> None:
            self.now -= 1

    counter = Counter()
    on_cluster(cluster, toy_tasks(store, "exact", "print"), store, counter, jobs=1)
    assert counter.most == 1


@pytest.mark.long
def test_an_interrupt_stops_the_runs_on_the_workers(cluster: Cluster, store: Store) -> None:
    class Interrupter(Silent):
        def ended(self, outcome) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        on_cluster(cluster, toy_tasks(store, "hang", "exact"), store, Interrupter())
    assert [record.status for record in store.read().records] == ["ok"]
    until(lambda: not cluster.runs())
    assert list(store.folder.glob(".*.partial")) == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("nowhere", "expected an address such as tcp://"),
        ("tcp://127.0.0.1", "expected an address such as tcp://"),
        ("missing.json", "can't be read"),
    ],
)
def test_what_is_no_address_is_refused(given: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        address_of(given)
    assert str(caught.value).startswith(f"--scheduler {given}: ")


def test_a_scheduler_that_does_not_answer_is_refused(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.5)
    executor = DaskCluster("tcp://127.0.0.1:9", None, 1, None, print)
    with pytest.raises(InputError, match="no Dask scheduler answers there") as caught:
        execute(toy_tasks(store, "exact"), store, Silent(), executor)
    assert "\n" not in str(caught.value)


def test_the_address_of_a_worker_is_refused(cluster: Cluster, store: Store) -> None:
    worker = next(iter(cluster.workers()))
    with pytest.raises(InputError) as caught:
        execute(toy_tasks(store, "exact"), store, Silent(), DaskCluster(worker, None, 1, None, print))
    assert str(caught.value) == f"--scheduler {worker}: it is the address of a Dask worker, not of a scheduler"
