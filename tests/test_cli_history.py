"""``shellbench history`` and its section of the page: one solver over stores, packs and commits."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from shellbench.bench.store import Store
from tests.bench.conftest import full, made_once, own_case, plugin, store, toys  # noqa: F401 - fixtures
from tests.bench.running import changed
from tests.test_cli import shellbench  # noqa: F401 - fixture
from tests.test_cli_compare import off, runs

FACTOR = 0.5  # a run that no gate judges, with an error of one half


@pytest.fixture
def three(full: Store, tmp_path: Path) -> list[Store]:  # noqa: F811
    """Three versions: of the second a figure is worse, the third has lost a run beside."""
    found = [full, Store(tmp_path / "second"), Store(tmp_path / "third")]
    for one in found[1:]:
        shutil.copytree(full.folder, one.folder)
        off(one, -1e-2, factor=FACTOR)
    (noisy, *_) = runs(found[2], "toy-noisy")
    for file in found[2].folder.glob(f"{noisy.run_id}*"):
        file.unlink()
    return found


def history(shellbench, versions, *more: object):  # noqa: F811
    return shellbench("history", *(one.folder for one in versions), *more)


def test_every_step_says_what_it_lost_and_what_went(shellbench, three) -> None:  # noqa: F811
    code, out, _ = history(shellbench, three, "--wide")
    assert code == 0  # it judges nothing
    first, second = (line for line in out.splitlines() if " figures" in line and " -> " in line)
    assert "second: 1 lost" in first
    assert "second -> third: nothing lost" in second
    assert "\n  loss: strip toy" in out
    assert "\n  only in second: strip toy-noisy" in out
    (halved,) = (line for line in out.splitlines() if "(loss)" in line)
    assert [word for word in halved.split() if word.startswith(("-", "("))] == ["-50", "-50", "(loss)", "-50"]


def test_data_have_each_figure_of_each_version(shellbench, three) -> None:  # noqa: F811
    found = json.loads(history(shellbench, three, "--format", "json", "--solver", "toy")[1])
    assert [one["name"] for one in found["versions"]][1:] == ["second", "third"]
    (worse,) = [one for one in found["figures"] if one["settings"] and one["quantity"] == "centre"]
    assert [one["verdict"] for one in worse["versions"]] == [None, "loss", "same"]
    assert [one["error"] for one in worse["versions"]] == pytest.approx([-0.5, -0.505, -0.505])
    assert {one["solver"] for one in found["figures"]} == {"toy"}
    noisy = json.loads(history(shellbench, three, "--format", "json", "--solver", "toy-noisy")[1])["figures"]
    assert [one["verdict"] for one in noisy[0]["versions"]][1:] in (["same", "gone"], ["same", "same"])


def test_packs_and_commits_are_versions_too(shellbench, full: Store, tmp_path: Path) -> None:  # noqa: F811
    for record in full.read().records:
        older = record.environment.model_dump() | {"git_sha": "a" * 40, "git_dirty": False}
        changed(full, record, environment=older)
    assert shellbench("pack", "toy", "--store", full.folder, "--out", tmp_path / "old.zip")[0] == 0
    (record,) = runs(full, "toy")
    again = record.model_copy(update={"run_id": record.run_id[:-8] + "0" * 8})
    values = record.model_dump()["values"]
    values["centre"]["value"] *= 1.001
    identity = record.identity.model_dump() | {"source": "another"}
    newer = {"environment": older | {"git_sha": "b" * 40}, "identity": identity, "sequence": 99}
    changed(full, again, values=values, **newer)
    for versions in ((), (tmp_path / "old.zip", "bbbb")):
        code, out, _ = shellbench("history", *versions, "--store", full.folder, "--solver", "toy", "--format", "json")
        (centre,) = [o for o in json.loads(out)["figures"] if o["quantity"] == "centre" and not o["settings"]]
        assert (code, [one["verdict"] for one in centre["versions"]]) == (0, [None, "loss"])


@pytest.mark.parametrize(
    ("versions", "said"),
    [(("toy", "toy"), "give --solver toy"), ((".",), "two versions at least"), ((), "two versions")],
)
def test_what_has_no_history_exits_2(shellbench, full: Store, versions, said) -> None:  # noqa: F811
    code, out, err = shellbench("history", *versions, "--store", full.folder)
    assert (code, out) == (2, "")
    assert said in err


@pytest.mark.long
def test_the_page_has_a_section(shellbench, three, tmp_path: Path) -> None:  # noqa: F811
    first, _, third = (one.folder for one in three)
    code, _, _ = shellbench("report", "--store", third, "--history", first, "--out", tmp_path / "page", "--no-print")
    assert code == 0
    pages = "".join(path.read_text(encoding="utf-8") for path in (tmp_path / "page").glob("*.html"))
    assert 'id="history"' in pages
    assert "1 lost" in pages
    assert (tmp_path / "page/figures/history.svg").is_file()
    assert (tmp_path / "page/history.csv").is_file()
