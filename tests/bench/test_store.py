"""The store has complete records only, whatever happens to the writing process."""

import contextlib
import errno
import json
import os
import random
import signal
import subprocess
import sys
import time
from multiprocessing import Process
from pathlib import Path

import psutil
import pytest

from shellbench.bench.store import store as stores
from shellbench.bench.store.current import newest
from shellbench.bench.store.planned import FOLDER
from shellbench.bench.store.record import Record, document
from shellbench.bench.store.store import Store
from shellbench.disk import StoreError
from shellbench.errors import InputError
from tests.bench.running import run, run_here
from tests.patience import GUARD

LOCKS = {stores.LOCK, stores.NUMBERING, FOLDER}


@pytest.fixture
def record(recorded: Store) -> Record:
    (found,) = recorded.read().records
    return found


def names(store: Store) -> set[str]:
    return {path.name for path in store.folder.iterdir()} - LOCKS


def test_a_record_comes_back_as_it_was(record: Record, store: Store) -> None:
    assert store.read().records == (record,)
    assert json.loads((store.folder / f"{record.run_id}.json").read_text())["run_id"] == record.run_id


@pytest.mark.parametrize("keep", [0, 1, 100, 2000])
def test_a_truncated_record_is_left_out_with_one_sentence(record: Record, store: Store, keep: int) -> None:
    path = store.folder / f"{record.run_id}.json"
    path.write_bytes(path.read_bytes()[:keep])
    contents = store.read()
    assert contents.records == ()
    assert len(contents.damaged) == 1
    assert path.name in contents.damaged[0]
    assert "\n" not in contents.damaged[0]


@pytest.mark.parametrize("text", ["[]", "{}", "null", '{"schema_version": 2}', "\x00\xff", "[" * 100_000])
def test_foreign_files_are_left_out(record: Record, store: Store, text: str) -> None:
    (store.folder / "other.json").write_text(text, encoding="latin-1")
    contents = store.read()
    assert contents.records == (record,)
    assert len(contents.damaged) == 1


def test_a_damaged_record_is_made_again(record: Record, store: Store) -> None:
    (store.folder / f"{record.run_id}.json").write_text("{", encoding="utf-8")
    assert len(run(store, "strip", solvers=("toy",))) == 1


def test_a_missing_store_is_empty_and_a_file_is_none(tmp_path: Path) -> None:
    assert Store(tmp_path / "nowhere").read().records == ()
    (tmp_path / "file").touch()
    for use in (Store(tmp_path / "file").read, Store(tmp_path / "file").at_work().__enter__):
        with pytest.raises(InputError, match="is not a folder"):
            use()


def test_a_folder_that_can_not_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match="can't be written"), Store(tmp_path / "file" / "runs").at_work():
        pass


def test_newest_of_an_identity_counts(record: Record, store: Store) -> None:
    again = run(store, "strip", solvers=("toy",), force=True)[0].record
    assert [*newest(store.read()).values()] == [again]
    assert len(store.read().records) == 2


def test_records_from_before_come_first_in_the_order_of_their_times(record: Record, store: Store) -> None:
    times = ("2999-01-01T00:00:00+00:00", "2020-01-01T01:00:00+02:00", "2020-01-01T00:30:00+00:00")
    for i, time_ in enumerate(times):
        old = record.model_copy(update={"run_id": f"old{i}", "created": time_, "sequence": None})
        (store.folder / f"old{i}.json").write_bytes(document(old))
    assert [r.run_id for r in store.read().records] == ["old1", "old2", "old0", record.run_id]
    (again,) = run_here(store, "strip", solver="toy", force=True, behaviour="exact")
    assert again.sequence == (record.sequence or 0) + 1


def commit_some(folder: Path, record: Record, name: str, times: int) -> None:
    """Commit copies of a record, as a process of its own."""
    store = Store(folder)
    for i in range(times):
        run_id = f"{name}-{i}"
        store.commit(store.begin(run_id), record.model_copy(update={"run_id": run_id, "sequence": None}))


def test_no_two_records_get_the_same_number(record: Record, store: Store) -> None:
    """Six processes commit at the same time; each sees what the others have written."""
    bare = record.model_copy(update={"fields_file": None, "solution_file": None, "checksums": {}})
    jobs = [Process(target=commit_some, args=(store.folder, bare, f"job{k}", 5)) for k in range(6)]
    for job in jobs:
        job.start()
    for job in jobs:
        job.join(timeout=600)
    numbers = [r.sequence for r in store.read().records]
    assert numbers == list(range(1, 32))


def test_a_damaged_record_with_a_huge_number_is_no_last_one(record: Record, store: Store) -> None:
    path = store.folder / f"{record.run_id}.json"
    data = json.loads(path.read_bytes())
    path.with_name("edited.json").write_text(json.dumps(data | {"sequence": 10**18}), encoding="utf-8")
    assert Store(store.folder).last_number() == record.sequence == 1


@pytest.mark.parametrize("step", range(5))
def test_a_disk_that_fills_while_a_run_is_kept_leaves_nothing_of_it(
    record: Record, store: Store, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever of the writes fails: the moves, the flushes or the record itself."""
    before = names(store)
    partial = store.begin("strip-toy-20260101T000000-00000000")
    for name in (record.fields_file, record.solution_file):
        assert name is not None
        (partial / name.partition(".")[2]).write_bytes((store.folder / name).read_bytes())
    new = record.model_copy(
        update={
            "run_id": "strip-toy-20260101T000000-00000000",
            "fields_file": (record.fields_file or "").partition(".")[2],
            "solution_file": (record.solution_file or "").partition(".")[2],
        }
    )
    left = step
    flush = stores._flush

    def full(path: Path) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(path)

    monkeypatch.setattr(stores, "_flush", full)
    if step < 4:  # fields, solution, record, folder
        with pytest.raises(StoreError, match="disk is full"):
            store.commit(partial, new)
        assert names(store) == before
    else:
        kept = store.commit(partial, new)
        assert store.file(kept.solution_file) is not None
        assert kept in store.read().records


def test_what_the_dead_left_behind_is_cleaned_and_nothing_else(record: Record, store: Store) -> None:
    dead = "strip-toy-20260101T000000-00000000"
    (store.folder / f".{dead}.partial").mkdir()
    (store.folder / f"{dead}.fields.npz").touch()
    (store.folder / f"{dead}.solution.json").touch()
    others = {"notes.txt", "my.fields.npz", "case.toml"}
    for name in others:
        (store.folder / name).touch()
    before = names(store)
    with store.at_work():
        pass
    assert before - names(store) == {f".{dead}.partial", f"{dead}.fields.npz", f"{dead}.solution.json"}


def test_nothing_is_cleaned_while_somebody_else_is_at_work(store: Store) -> None:
    with store.at_work():
        partial = store.begin("strip-toy-20260101T000000-00000000")
        with store.at_work():
            assert partial.is_dir()


def test_files_outside_of_the_store_are_not_reached(record: Record, store: Store, tmp_path: Path) -> None:
    (tmp_path / "secret").touch()
    assert store.file("../secret") is None
    assert store.file(None) is None


def kill_runs_at_random(own_case: Path, plugin: Path, store: Store, times: int) -> None:
    """Kill a command (its parent, a server or a run of it) at random moments; then let it finish."""
    chance = random.Random(0)
    environment = os.environ | {"PYTHONPATH": str(plugin)}
    command = [
        *(sys.executable, "-m", "shellbench", "run", str(own_case), "--store", str(store.folder), "--force"),
        *("--solver", "toy-noisy", *(part for seed in range(6) for part in ("--seed", str(seed)))),
    ]
    for _ in range(times):
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(chance.uniform(0.5, 2.0))
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
        victim = chance.choice([family[0], *family])
        with contextlib.suppress(psutil.NoSuchProcess):
            victim.send_signal(signal.SIGKILL)
        if victim is family[0]:
            process.wait()
            _, alive = psutil.wait_procs(family[1:], timeout=GUARD)
            assert alive == []  # nothing goes on once its parent is dead
        else:
            process.wait(timeout=GUARD)
        contents = store.read()
        assert contents.damaged == ()
        for record in contents.records:
            if record.status == "ok":
                assert store.file(record.fields_file)
                assert store.file(record.solution_file)
    command.remove("--force")
    assert subprocess.run(command, env=environment, check=False, capture_output=True).returncode == 0
    latest = {r.identity.seed: r for r in newest(store.read()).values()}
    assert {seed: record.status for seed, record in latest.items()} == dict.fromkeys(range(6), "ok")
    assert not any(path.name.endswith(".partial") for path in store.folder.iterdir())
    stems = {name.partition(".")[0] for name in names(store)}
    assert stems == {record.run_id for record in store.read().records}


def test_a_killed_command_leaves_a_store_from_which_the_next_goes_on(
    own_case: Path, plugin: Path, store: Store
) -> None:
    kill_runs_at_random(own_case, plugin, store, 1)


@pytest.mark.long
def test_a_command_killed_at_many_moments_does_too(own_case: Path, plugin: Path, store: Store) -> None:
    kill_runs_at_random(own_case, plugin, store, 25)
