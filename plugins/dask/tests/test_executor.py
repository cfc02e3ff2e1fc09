"""Common behaviour of all executors, on this machine and on a cluster."""

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from on_cluster import by_behaviour, toy_tasks
from shellbench_dask.cluster import DaskCluster

from shellbench.bench.run.display import Silent
from shellbench.bench.run.execute import Ended, Executor, Progressed, Started, execute
from shellbench.bench.run.local import LocalProcesses
from shellbench.bench.store.record import Record
from shellbench.bench.store.store import LOG, Store
from tests.bench import strip
from tests.patience import GUARD

pytestmark = pytest.mark.usefixtures("toys")

Make = Callable[..., Executor]
TIMEOUT = 0.5  # of a run that hangs


LOCAL = pytest.param("local", marks=pytest.mark.long)  # tests/bench/test_execute.py asks the same of it, quickly


@pytest.fixture(params=[LOCAL, "cluster"])
def make(request: pytest.FixtureRequest) -> Make:
    if request.param == "local":
        return lambda timeout=None: LocalProcesses(2, 1, timeout)
    file = str(request.getfixturevalue("cluster").file)
    return lambda timeout=None: DaskCluster(file, None, 1, timeout, lambda sentence: None)


def test_whatever_a_solver_does_ends_as_an_outcome_in_one_sentence(make: Make, store: Store) -> None:
    tasks = toy_tasks(store, "exact", "fail_with_partial", "refuse", "raise", "exit", "crash", "print")
    made = execute(tasks, store, Silent(), make(GUARD))
    outcomes = by_behaviour([*made, *execute(toy_tasks(store, "hang"), store, Silent(), make(TIMEOUT))])
    how = {name: (o.record.status, o.record.reason) if o.record else o.refused for name, o in outcomes.items()}
    assert how == {
        "hang": ("timeout", f"stopped after {TIMEOUT:g} s"),
        "exact": ("ok", None),
        "fail_with_partial": ("failed", "the strip stopped half way"),
        "refuse": "setting 'behaviour' does not fit the case",
        "raise": ("failed", "the solver stopped unexpectedly: ZeroDivisionError: a bug in the solver"),
        "exit": ("failed", "the solving process ended with exit status 1 and left no record"),
        "crash": ("failed", "the solving process was ended by SIGSEGV"),
        "print": ("ok", None),
    }
    assert {r.run_id for r in store.read().records} == {o.record.run_id for o in outcomes.values() if o.record}
    assert list(store.folder.glob(".*.partial")) == []
    chatter = store.folder / f"{outcomes['print'].record.run_id}.{LOG}"
    assert "chatter on standard output" in chatter.read_text(encoding="utf-8")
    partial = outcomes["fail_with_partial"].record
    assert partial.values["centre"].value == pytest.approx(strip.CENTRE / 2, rel=1e-12)
    assert store.file(partial.solution_file) is not None


def test_events_of_a_run_come_in_order(make: Make, store: Store) -> None:
    tasks = toy_tasks(store, "exact")
    with store.at_work(), contextlib.closing(make().run(tasks, store)) as events:
        seen = list(events)
    assert isinstance(seen[0], Started)
    assert isinstance(seen[-1], Ended)
    assert seen[1:-1]
    for event in seen[1:-1]:
        assert isinstance(event, Progressed)
        assert (event.progress.total, event.progress.message) == (3, "a step")
    assert {event.task.run_id for event in seen} == {tasks[0].run_id}


def test_closing_leaves_nothing(make: Make, store: Store) -> None:
    events = make().run(toy_tasks(store, "hang", "hang"), store)
    with store.at_work():
        assert isinstance(next(events), Started)
        events.close()
    assert [path.name for path in store.folder.iterdir()] == [".lock"]


def test_a_record_of_the_cluster_is_whole_and_equal_to_a_local_one(cluster, tmp_path: Path) -> None:
    records: list[tuple[Store, Record]] = []
    for name, executor in [
        ("local", LocalProcesses(1, 1)),
        ("remote", DaskCluster(cluster.address, None, 1, None, lambda sentence: None)),
    ]:
        store = Store(tmp_path / name)
        (outcome,) = execute(toy_tasks(store, "exact"), store, Silent(), executor)
        assert outcome.record is not None
        assert store.read().records == (outcome.record,)
        records.append((store, outcome.record))
    (here, local), (there, remote) = records
    own = {"run_id", "created", "seconds", "peak_memory_bytes", "idle_memory_bytes", "fields_file", "solution_file"}
    own |= {"checksums"}  # by the names of these files
    assert local.sequence == remote.sequence == 1
    for store, record in records:
        assert [store.check(record, name) for name in (record.fields_file, record.solution_file)] == [None, None]
        assert set(record.checksums) == {record.fields_file, record.solution_file}
    assert remote.model_dump(exclude=own) == local.model_dump(exclude=own)
    ours, theirs = here.file(local.solution_file), there.file(remote.solution_file)
    assert ours is not None
    assert theirs is not None
    assert theirs.read_bytes() == ours.read_bytes()
    with np.load(here.file(local.fields_file)) as a, np.load(there.file(remote.fields_file)) as b:
        assert sorted(a) == sorted(b)
        for key in a:
            np.testing.assert_allclose(a[key], b[key], rtol=1e-12)


def test_memory_is_that_of_the_run_and_not_of_the_worker(cluster, store: Store) -> None:
    allocated = 200e6  # bytes: what the toy allocates
    executor = DaskCluster(str(cluster.file), None, 1, None, lambda sentence: None)
    (outcome,) = execute(toy_tasks(store, "allocate"), store, Silent(), executor)
    record = outcome.record
    assert record is not None
    assert 0.95 * allocated < record.peak_memory_bytes - record.idle_memory_bytes < 1.3 * allocated
