"""The command line's contract: names, options, exit codes, and one sentence for whatever is wrong."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from shellbench import __version__, cli
from shellbench.bench.run import local
from shellbench.bench.store.planned import FOLDER
from shellbench.bench.store.store import Store
from shellbench.errors import Interrupted
from shellbench.problems.shell.records import self_intersection
from shellbench.report.page import sections
from tests.bench import strip
from tests.bench.conftest import made_once, own_case, plugin, store, toys  # noqa: F401 - fixtures
from tests.bench.running import InThisProcess, command
from tests.bench.test_compare import CONTRACT, edit
from tests.patience import COMMAND_LINE, GUARD, until


@pytest.fixture
def shellbench(toys: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]):  # noqa: F811
    """Run the program in an empty folder; return exit code, standard output and standard error."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)

    return partial(command, monkeypatch, capfd)


def test_the_whole_way(shellbench, tmp_path: Path) -> None:
    """Run, resume, table, gate, baseline, export."""
    code, out, err = shellbench("run", "--suite", "toys", "--jobs", 2)
    *lines, last = out.splitlines()
    assert (code, last, err) == (0, "5 solved", "")
    assert len(lines) == 5
    assert len(list(Path("reports/runs").glob("strip-*.solution.json"))) == 5
    assert shellbench("run", "--suite", "toys") == (0, "5 kept from before\n", "")
    code, out, err = shellbench("table", "--format", "json")
    assert (code, err) == (0, "")
    assert all(set(CONTRACT) <= set(row) for row in json.loads(out))
    code, out, err = shellbench("gate", "--suite", "toys")
    assert (code, err) == (0, "")
    assert "every gate holds" in out
    assert shellbench("baseline", "--write")[0] == 0
    assert "regression (reported only): 5 ok" in shellbench("gate")[1]
    assert "regression: 5 ok" in shellbench("gate", "strip", "--regression")[1]
    for suffix in ("npz", "obj"):
        assert shellbench("export", "strip", "--solver", "toy", "--out", f"shape.{suffix}", "--resolution", 5)[0] == 0
    with np.load("shape.npz") as arrays:
        assert arrays["displacement"].shape == (5, 5, 3)
        assert -arrays["displacement"][2, 2, 2] == pytest.approx(strip.CENTRE)
    lines = Path("shape.obj").read_text(encoding="utf-8").splitlines()
    assert sum(line.startswith("v ") for line in lines) == 25
    faces = np.array([[int(i) for i in line.split()[1:]] for line in lines if line.startswith("f ")])
    assert faces.shape == (16, 4)
    assert set(faces.ravel()) == set(range(1, 26))


@pytest.fixture
def solved(shellbench, made_once: tuple[Path, Path]):  # noqa: F811
    """The program in a folder whose store has the exact run of the strip by a toy."""
    shutil.copytree(made_once[0], "reports/runs")
    return shellbench


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the figures out of reports: tests of the report draw them."""
    monkeypatch.setattr(sections, "exhibits", lambda evidence: [])


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make runs in this process, which takes a twentieth of the time: other tests start some of their own."""
    monkeypatch.setattr(local, "LocalProcesses", lambda *_: InThisProcess())


@pytest.mark.parametrize("format_", ["text", "markdown", "latex", "csv"])
def test_table_prints_in_all_formats(solved, format_: str) -> None:
    code, out, err = solved("table", "--format", format_)
    assert (code, err) == (0, "")
    assert ("Left out: 4 other runs of suite 'toys'" in out) == (
        format_ in {"text", "markdown"}
    )  # others are for programs
    assert "Strip" in out or "strip" in out


@pytest.mark.parametrize("command", ["table", "gate", "report", "baseline"])
@pytest.mark.parametrize("more", [(), ("--suite", "toys")])
def test_a_store_without_runs_is_bad_input(shellbench, command: str, more: tuple[str, ...]) -> None:
    for _ in range(2):
        code, out, err = shellbench(command, *more)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "reports/runs: is" in err
        Path("reports/runs").mkdir(parents=True, exist_ok=True)
    assert not Path("reports/latest").exists()


def test_a_gate_that_judges_nothing_exits_2(solved) -> None:
    for scope in (("--solver", "falling"), ("--solver", "toy-noisy"), ("--suite", "toys", "--solver", "falling")):
        code, out, err = solved("gate", *scope)
        assert (code, out) == (2, "")
        assert "nothing was judged" in err


@pytest.mark.usefixtures("here", "undrawn")
def test_the_obvious_path_is_green(shellbench) -> None:
    """Table, gate and report after one case by one solver: about that, in one line what else there is, and green."""
    assert shellbench("run", "strip", "--solver", "toy")[0] == 0
    code, out, err = shellbench("gate")
    assert code == 0
    assert "accuracy: 2 ok" in out
    assert "Left out: 4 other runs of suite 'toys'" in out
    assert err == ""
    code, out, err = shellbench("report", "--no-print")
    assert (code, err) == (0, "")
    page = Path("reports/latest/report.md").read_text(encoding="utf-8")
    assert "All 2 gated values pass." in page
    assert "4 other runs" in page
    assert shellbench("gate", "--suite", "toys")[0] == 1


@pytest.mark.usefixtures("here", "undrawn")
def test_two_files_of_one_title_are_told_apart(shellbench, own_case: Path) -> None:  # noqa: F811
    other = own_case.with_name("thicker_strip.toml")
    other.write_text(own_case.read_text(encoding="utf-8"), encoding="utf-8")
    edit(other, "thickness = 0.1", "thickness = 0.2")
    assert shellbench("run", own_case, other, "--solver", "toy")[0] == 0
    for format_ in ("text", "markdown"):
        out = shellbench("table", "--format", format_)[1].replace("\\", "")
        assert out.count("Strip (own_strip.toml): centre") == out.count("Strip (thicker_strip.toml): centre") == 1
    out = shellbench("table", other)[1]
    assert "own_strip" not in out
    assert shellbench("report", other, "--no-print")[0] == 0
    assert "own_strip" not in Path("reports/latest/report.md").read_text(encoding="utf-8")
    assert shellbench("report", "--no-print")[0] == 0
    assert "own\\_strip.toml" in Path("reports/latest/report.md").read_text(encoding="utf-8")


def test_in_a_pipe_a_run_is_a_line(shellbench, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.setenv(name, "1")
    code, out, _ = shellbench("run", "strip", "--solver", "toy", "--solver", "toy-noisy", "--seed", 0, "--seed", 1)
    assert code == 0
    *lines, last = out.splitlines()
    assert last == "3 solved"
    assert sorted(line.partition("  ")[0].split()[:3] for line in lines)[0][:3] == ["ok", "strip", "toy"]
    assert len(lines) == 3
    assert all(letter.isprintable() for letter in out.replace("\n", ""))
    code, out, _ = shellbench("run", "strip", "--solver", "toy", "--set", "toy.behaviour=crash")
    assert out.startswith("failed strip toy")


def test_a_killed_command_leaves_its_plan(shellbench, own_case: Path, plugin: Path, store: Store) -> None:  # noqa: F811
    """The last run hangs and its command is killed: the gate is red over it until it has ended."""
    words = [sys.executable, "-m", "shellbench", "run", str(own_case), "--store", str(store.folder)]
    words += ["--solver", "toy", "--set", "toy.behaviour=hang"]
    process = subprocess.Popen(words, env=os.environ | {"PYTHONPATH": str(plugin)}, stderr=subprocess.PIPE)
    until(lambda: list(store.folder.glob(".*.partial/log.txt")) or process.poll() is not None)
    assert process.poll() is None
    process.kill()
    process.communicate(timeout=GUARD)
    code, out, _ = shellbench("gate", "--store", store.folder)
    assert code == 1
    assert "RED  own_strip toy centre: planned, but did not end" in out
    code, out, _ = shellbench("table", own_case, "--store", store.folder)
    assert (code, "missing" in out) == (0, True)


def test_failed_runs_exit_1_and_the_others_are_kept(shellbench) -> None:
    code, out, err = shellbench(
        "run", "strip", "--solver", "toy", "--solver", "toy-noisy", "--set", "toy.behaviour=crash"
    )
    assert (code, out.splitlines()[-1]) == (1, "1 solved, 1 failed")
    assert err == "shellbench: strip toy: failed: the solving process was ended by SIGSEGV\n"
    code, out, err = shellbench("run", "strip", "--solver", "toy", "--set", "toy.behaviour=hang", "--timeout", "0.5")
    assert (code, err) == (1, "shellbench: strip toy: timeout: stopped after 0.5 s\n")


@pytest.mark.usefixtures("here", "undrawn")
def test_an_answer_that_has_not_settled_exits_1_is_kept_and_is_in_the_table(shellbench) -> None:
    asked = ("run", "strip", "--solver", "toy", "--set", "toy.behaviour=unsettled")
    code, out, err = shellbench(*asked)
    assert code == 1
    assert out.startswith("not settled strip toy")
    assert out.endswith("1 not settled\n")
    assert "strip toy: not settled: centre still moves by 2e-3" in err
    code, out, err = shellbench(*asked)  # the same run would end the same
    assert (code, out) == (1, "1 kept from before (1 of them not settled)\n")
    assert "strip toy: not settled: centre still moves by 2e-3" in err
    rows = json.loads(shellbench("table", "--format", "json")[1])
    assert {row["status"] for row in rows} == {"not settled"}
    assert {row["reason"] for row in rows} == {"centre still moves by 2e-3"}
    assert rows[0]["value"] is not None
    assert shellbench("report", "--no-print")[0] == 0
    assert "not settled" in Path("reports/latest/report.md").read_text(encoding="utf-8")


def test_refused_input_exits_2(shellbench) -> None:
    code, _, err = shellbench("run", "strip", "--solver", "toy", "--set", "toy.behaviour=refuse")
    assert (code, err) == (2, "shellbench: strip toy: refused: setting 'behaviour' does not fit the case\n")


def test_what_does_not_apply_is_said_and_exits_0(shellbench, own_case: Path) -> None:  # noqa: F811
    edit(own_case, 'kind = "plane"', 'kind = "cylinder"\naxis = "y"\nradius = 9')
    code, out, err = shellbench("run", own_case, "--solver", "toy")
    assert (code, out) == (0, "1 not applicable\n")
    assert err == "shellbench: own_strip toy: not applicable: it solves planes only\n"


HOSTILE = [
    ("run",),
    ("run", "nowhere"),
    ("run", "nowhere.toml"),
    ("run", "."),
    ("run", "../strip"),
    ("run", "strip\x01"),
    ("run", "strip", "--solver", "nobody"),
    ("run", "strip", "--solver", ""),
    ("run", "strip", "--solver", "toy-broken"),
    ("run", "strip", "--suite", "nothing"),
    ("run", "strip", "--set", "toy"),
    ("run", "strip", "--solver", "toy", "--set", "toy.factor=[1"),
    ("run", "strip", "--solver", "toy", "--set", "toy.factor=nan", "--set", "toy.x=1"),
    ("run", "strip", "--solver", "toy", "--set", "toy.__class__=1"),
    ("run", "strip", "--seed", "-1"),
    ("run", "strip", "--seed", "x"),
    ("run", "strip", "--seed", "99999999999"),
    ("run", "strip", "--jobs", "0"),
    ("run", "strip", "--timeout", "0"),
    ("run", "strip", "--timeout", "nan"),
    ("run", "strip", "--timeout", "-inf"),
    ("run", "strip", "--device", "tpu"),
    ("run", "strip", "--solver", "toy", "--device", "cuda"),
    ("run", "strip", "--store", "a_file"),
    ("run", "strip", "--store", "a_file/below"),
    ("run", "strip", "--no-such-option"),
    ("table", "--format", "xml"),
    ("table", "--suite", "nothing"),
    ("table", "--store", "a_file"),
    ("gate", "--suite", "nothing"),
    ("gate", "--solver", "nobody"),
    ("gate", "--baseline", "a_file"),
    ("gate", "--baseline", "/dev/full"),
    ("run", "strip", "--solver", "toy", "--set", "toy.factor=inf"),
    ("report", "--store", "a_file"),
    ("baseline", "--solver", "nobody"),
    ("export", "strip", "--solver", "toy"),
    ("export", "strip", "--solver", "toy", "--out", "x.stl"),
    ("export", "strip", "--solver", "toy", "--out", "x.npz"),
    ("export", "strip", "--solver", "toy", "--out", "x.npz", "--resolution", "1"),
    ("export", "strip", "--solver", "toy", "--out", "x.pvd", "--at", "0.5"),
    ("export", "nowhere", "--solver", "toy", "--out", "x.npz"),
    ("export", "strip", "--solver", "nobody", "--out", "x.npz"),
    ("no-such-command",),
]


@pytest.mark.parametrize("arguments", HOSTILE, ids=" ".join)
def test_bad_input_exits_2_with_a_sentence(shellbench, arguments: tuple[str, ...]) -> None:
    Path("a_file").write_text("no JSON", encoding="utf-8")
    code, out, err = shellbench(*arguments)
    assert out == ""
    if "a_file/below" in arguments:  # the disk's fault, not the user's
        assert code == 1
    else:
        assert code == 2
    assert err.startswith("shellbench: ") == ("Usage" not in err)
    if "Usage" not in err:
        assert err.count("\n") == 1


def test_a_malformed_case_is_one_sentence_with_file_and_field(shellbench, own_case: Path) -> None:  # noqa: F811
    edit(own_case, "thickness = 0.1", 'thickness = "thin"')
    code, _, err = shellbench("run", own_case, "--solver", "toy")
    assert code == 2
    assert str(own_case) in err
    assert "material.thickness" in err
    assert err.count("\n") == 1


def test_list_says_what_there_is(shellbench) -> None:
    code, out, err = shellbench("list", "--json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert [case["name"] for case in found["cases"]] == ["strip"]
    assert [suite["name"] for suite in found["suites"]] == ["toys"]
    solvers = {solver["name"]: solver for solver in found["solvers"]}
    assert solvers["toy"]["available"]
    assert not solvers["toy"]["seeded"]
    assert solvers["toy-noisy"]["seeded"]
    assert {s["name"] for s in solvers["toy"]["settings"]} == {"behaviour", "factor", "gate", "seconds", "dtype"}
    assert "No module named" in solvers["toy-broken"]["reason"]
    text = shellbench("list", "--all", "--wide")[1]
    assert all(word in text for word in ("strip", "toys"))
    text = shellbench("list", "--wide")[1]
    assert re.search(r"\nshell, solved by [^:]*\n  toys +1  ", text)
    folded = " ".join(text.split())
    assert all(word in folded for word in ("toy (package toy-shells)", "toy-noisy (package toy-shells)"))
    assert "No module named" in text
    assert "1 case: `shellbench list --all` has a line for each" in text


def test_vtu_without_pyvista_names_the_extra(solved, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)
    code, _, err = solved("export", "strip", "--solver", "toy", "--out", "x.vtu")
    assert code == 2
    assert "shellbench[vtk]" in err
    assert list(Path().glob("*.vtu")) == []


def test_version_and_help(shellbench) -> None:
    assert shellbench("--version")[:2] == (0, f"shellbench {__version__}\n")
    for name in cli.COMMANDS:
        code, out, _ = shellbench(name, "--help")
        assert (code, "Usage" in out) == (0, True)
        assert "<bool>" not in out
        assert "<list" not in out


@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_interrupt_exits_130_with_a_sentence(own_case: Path, plugin: Path, store: Store, number: int) -> None:  # noqa: F811
    words = [sys.executable, "-c", COMMAND_LINE, "run", str(own_case), "--store", str(store.folder)]
    words += ["--solver", "toy", "--set", "toy.behaviour=hang"]
    environment = os.environ | {"PYTHONPATH": str(plugin)}
    process = subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until(lambda: list(store.folder.glob(".*.partial/log.txt")) or process.poll() is not None)
    assert process.poll() is None
    process.send_signal(number)
    out, err = process.communicate(timeout=GUARD)
    assert process.returncode == Interrupted.exit_code
    assert out == ""
    assert err.startswith("shellbench: interrupted")
    assert err.count("\n") == 1
    assert {path.name for path in store.folder.iterdir()} == {".lock", FOLDER}


@pytest.fixture
def falling_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The suite's free fall as a user's own file; the catalog of these tests has none."""
    monkeypatch.setattr(self_intersection, "crossings", lambda points, triangles: ())  # a plate that falls has none
    path = tmp_path / "fall.toml"
    path.write_bytes((Path(__file__).parents[1] / "cases" / "free_fall.toml").read_bytes())
    return path


@pytest.mark.usefixtures("here")
def test_a_motion_is_run_shown_and_exported_at_any_time(shellbench, falling_case: Path) -> None:
    code, out, err = shellbench("run", falling_case, "--solver", "falling")
    assert (code, out.splitlines()[-1], err) == (0, "1 solved", "")
    code, out, _ = shellbench("table", "--format", "json")
    assert code == 0
    rows = {row["quantity"]: row for row in json.loads(out)}
    assert rows["fall_500ms"]["value"] == pytest.approx(9.8 / 8)
    assert (rows["fall_500ms"]["at"], rows["fall_500ms"]["mark"]) == (0.5, "t = 0.5 s")
    assert "at t = 0.5 s" in shellbench("table")[1]
    export = ("export", falling_case, "--solver", "falling", "--resolution", 3, "--out")
    for options, t in (((), 1.0), (("--at", 0.25), 0.25), (("--at", 0), 0.0)):
        assert shellbench(*export, "shape.npz", *options)[0] == 0
        with np.load("shape.npz") as arrays:
            assert np.allclose(arrays["displacement"], [0, 0, -9.8 * t**2 / 2])
    assert shellbench(*export, "shape.obj", "--at", 0.25)[0] == 0
    assert "at t = 0.25 s" in Path("shape.obj").read_text(encoding="utf-8").splitlines()[0]
    for at in ("1.5", "-0.1", "nan"):
        code, _, err = shellbench(*export, "late.npz", "--at", at)
        assert code == 2
        assert "moves from 0 to 1 s" in err
        assert not Path("late.npz").exists()


def test_a_linear_case_has_one_state_to_export(solved) -> None:
    code, _, err = solved("export", "strip", "--solver", "toy", "--out", "x.npz", "--at", 0.5)
    assert code == 2
    assert "linear" in err


def test_all_about_one_is_listed_by_name(shellbench) -> None:
    for name in ("strip", "toys", "toy-noisy"):
        code, out, err = shellbench("list", name)
        assert (code, err) == (0, "")
        assert out.startswith(f"{name}: ")
        assert json.loads(shellbench("list", name, "--json")[1])["name"] == name
    code, out, err = shellbench("list", "strop")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "no case, suite or solver is called 'strop': the nearest is strip" in err


@pytest.mark.usefixtures("here")
def test_a_quick_run_takes_one_seed_of_a_named_solver(shellbench) -> None:
    code, out, _ = shellbench("run", "--suite", "toys", "--quick", "--solver", "toy-noisy")
    assert (code, out.splitlines()[-1]) == (0, "1 solved")
    code, out, err = shellbench("run", "--suite", "toys", "--quick")
    assert (code, out) == (2, "")
    assert "--quick takes fem and ndf-ritz, which no requested suite declares" in err
