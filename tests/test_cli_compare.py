"""``shellbench compare``: what is a loss, what is none, what each format says, and what can't be compared."""

import json
import re
import shutil
from pathlib import Path

import pytest

from shellbench.bench.store.store import Store
from tests.bench.conftest import full, made_once, own_case, plugin, store, toys  # noqa: F401 - fixtures
from tests.bench.running import changed, run
from tests.test_cli import shellbench  # noqa: F401 - fixture

HALVED = {"factor": 0.5}  # a run that no gate judges, with an error of one half


@pytest.fixture
def both(full: Store, tmp_path: Path) -> tuple[Store, Store]:  # noqa: F811
    """Two stores of the same runs."""
    after = Store(tmp_path / "after")
    shutil.copytree(full.folder, after.folder)
    return full, after


def runs(where: Store, solver: str, factor: float = 1.0):
    records = where.read().records
    return [r for r in records if r.identity.solver == solver and r.identity.settings.get("factor", 1.0) == factor]


def off(where: Store, by: float, solver: str = "toy", factor: float = 1.0) -> None:
    """Have a figure be off by a factor."""
    for record in runs(where, solver, factor):
        values = record.model_dump()["values"]
        values["centre"]["value"] *= 1 + by
        changed(where, record, values=values)


def compare(shellbench, stores, *more: object):  # noqa: F811
    return shellbench("compare", *(s.folder for s in stores), "--wide", *more)  # names of folders are long, some more


def test_a_store_has_lost_nothing_against_itself(shellbench, both) -> None:  # noqa: F811
    code, out, err = compare(shellbench, both)
    assert (code, err) == (0, "")
    assert out.splitlines()[-1].endswith("nothing lost, of 9 figures")


@pytest.mark.parametrize(
    ("by", "factor", "more", "lost"),
    [
        (1e-3, 0.5, (), False),  # the error of one half shrinks: halved values are too small
        (-1e-3, 0.5, (), True),  # it grows by 5e-4
        (-1e-4, 0.5, (), False),  # by 5e-5, below the threshold
        (-1e-4, 0.5, ("--threshold", 1e-5), True),
        (-1e-3, 0.5, ("--threshold", 1e-3), False),
        (1e-6, 1.0, (), True),  # the frozen tolerance is 1e-9, whatever the threshold
    ],
)
def test_what_is_a_loss(shellbench, both, by, factor, more, lost) -> None:  # noqa: F811
    off(both[1], by, factor=factor)
    code, out, _ = compare(shellbench, both, *more)
    assert (code, "\nloss: strip toy" in out) == (int(lost), lost)
    assert not lost or re.search(r": (error \S+ % -> \S+ %|A alone meets the tolerance of 1e-07 %)\n", out)
    back = compare(shellbench, both[::-1], *more)
    assert (back[0] == 1) == (by > 0 and factor == 0.5)  # what is lost one way is gained the other


def test_a_run_that_ends_worse_is_lost_and_its_reason_told(shellbench, both) -> None:  # noqa: F811
    (record,) = runs(both[1], "toy")
    changed(both[1], record, status="failed", reason="it blew up")
    code, out, _ = compare(shellbench, both)
    assert code == 1
    assert "loss: strip toy centre, energy, membrane: ok -> failed: it blew up" in out
    code, out, _ = compare(shellbench, both[::-1])
    assert (code, "gain: strip toy centre, energy, membrane: failed -> ok" in out) == (0, True)


def test_what_goes_and_comes_is_told_and_counts_if_asked(shellbench, both) -> None:  # noqa: F811
    for record in runs(both[1], "toy-noisy")[:1]:
        (both[1].folder / f"{record.run_id}.json").unlink()
    code, out, _ = compare(shellbench, both)
    assert (code, f"only in {both[0].folder}: strip toy-noisy, seed " in out) == (0, True)
    assert compare(shellbench, both, "--gone")[0] == 1
    found = json.loads(compare(shellbench, both[::-1], "--gone", "--format", "json")[1])
    assert (found["gone"], len(found["appeared"])) == ([], 1)


def test_seconds_and_memory_count_if_asked_and_between_like_machines(shellbench, both) -> None:  # noqa: F811
    for record in runs(both[1], "toy"):
        changed(both[1], record, seconds=record.seconds + 10, peak_memory_bytes=2 * record.peak_memory_bytes)
    assert compare(shellbench, both)[0] == 0
    code, out, _ = compare(shellbench, both, "--seconds", 1.5)
    assert (code, "loss: strip toy takes" in out) == (1, True)
    assert compare(shellbench, both, "--memory", 1.5)[0] == 1
    assert compare(shellbench, both, "--memory", 2.5)[0] == 0
    for record in runs(both[1], "toy"):
        changed(both[1], record, environment=record.environment.model_dump() | {"processor": "another"})
    code, _, err = compare(shellbench, both, "--seconds", 1.5)
    assert code == 0
    assert "other hardware" in err


def test_two_solvers_of_a_store(shellbench, full: Store) -> None:  # noqa: F811
    off(full, 1e-3, "toy-noisy")
    code, out, err = shellbench("compare", "toy", "toy-noisy", "--store", full.folder)
    assert (code, "loss: strip centre: error" in out) == (1, True)
    assert "toy: 1 run is left out: settings are not the defaults" in err
    assert shellbench("compare", "toy-noisy", "toy", "--store", full.folder)[0] == 0


def test_two_commits_of_a_store(shellbench, full: Store) -> None:  # noqa: F811
    """The newest answer of a store is not the only one: it is compared with that of the older commit."""
    for record in full.read().records:
        older = record.environment.model_dump() | {"git_sha": "a" * 40, "git_dirty": False}
        changed(full, record, environment=older)
    (record,) = runs(full, "toy")
    values = record.model_dump()["values"]
    values["centre"]["value"] *= 1.001
    newer = {"environment": older | {"git_sha": "b" * 40, "git_dirty": True}, "values": values, "sequence": 99}
    again = record.model_copy(update={"run_id": record.run_id[:-8] + "0" * 8})
    identity = record.identity.model_dump() | {"source": "another"}
    changed(full, again, identity=identity, **newer)
    code, out, err = shellbench("compare", "aaaa", "bbbb", "--store", full.folder)
    assert code == 1
    assert "aaaaaaaa -> bbbbbbbb: 1 lost" in out
    assert "bbbbbbbb: 1 run is made with changes that are in no commit" in err


def test_an_answer_without_known_value_can_only_change(shellbench, own_case: Path, both) -> None:  # noqa: F811
    for where in both:
        shutil.rmtree(where.folder)
        run(where, str(own_case), solvers=("toy",))
    off(both[1], 0.5)
    code, out, _ = compare(shellbench, both)
    assert (code, "1 changed with no known value" in out) == (0, True)


def test_formats(shellbench, both, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    off(both[1], -1e-2, factor=0.5)
    found = json.loads(compare(shellbench, both, "--format", "json")[1])
    (lost,) = [figure for figure in found["figures"] if figure["verdict"] == "loss"]
    assert (lost["case"], lost["solver"], lost["settings"], lost["quantity"]) == ("strip", "toy", HALVED, "centre")
    assert lost["a"]["error"] == pytest.approx(-0.5)
    assert lost["b"]["error"] == pytest.approx(-0.505)
    assert (found["losses"], found["a"]["what"], found["threshold"]) == (1, "store", 1e-4)
    code, out, _ = compare(shellbench, both, "--format", "markdown")
    assert code == 1
    assert out.startswith("**")
    assert "1 lost" in out.splitlines()[0]
    assert "\n- loss: strip toy" in out
    assert out.count("<details>") == out.count("</details>") == 1
    monkeypatch.setenv("COLUMNS", "80")
    lines = shellbench("compare", *(s.folder for s in both))[1].splitlines()
    assert max(map(len, lines)) <= 80 + len(str(both[1].folder))  # a path is not broken


@pytest.mark.parametrize(
    ("sides", "said"),
    [
        (("toy", "nobody"), "'nobody' is no folder"),
        (("toy", "toy-nosy"), "did you mean toy-noisy"),
        (("toy", "."), "compare two solvers"),
        (("./nowhere", "toy"), "store ./nowhere: is not there"),
        (("toy", "cccc"), "'cccc' is no folder"),
        (("toy", "toy", "--suite", "toy"), "did you mean toys"),
        (("toy", "--exec=x"), "No such option"),
        (("toy", "toy", "--threshold", "-1"), "--threshold"),
    ],
)
def test_what_can_not_be_compared_exits_2(shellbench, full: Store, sides, said) -> None:  # noqa: F811
    code, out, err = shellbench("compare", *sides, "--store", full.folder)
    assert (code, out) == (2, "")
    assert said in err
