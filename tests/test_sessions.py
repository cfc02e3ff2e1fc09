"""The sessions of the noxfile: what a user's command asks of the gate, and what the maintainers' does."""

import runpy
import sys
import types
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]


class Session:
    """A session that notes the commands that it is to run."""

    def __init__(self, *posargs: str) -> None:
        self.posargs = list(posargs)
        self.commands: list[tuple[str, ...]] = []

    def install(self, *_: str) -> None:
        """Install nothing."""

    def run(self, *command: str, **_: Any) -> None:
        self.commands.append(command[1:])


@pytest.fixture
def sessions(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the sessions by name."""
    nox: Any = types.ModuleType("nox")
    nox.session = lambda made=None, **_: made or (lambda made: made)
    nox.Session, nox.options = Session, types.SimpleNamespace()
    monkeypatch.setitem(sys.modules, "nox", nox)
    return runpy.run_path(str(ROOT / "noxfile.py"))


@pytest.fixture
def course(sessions: dict[str, Any]):
    """Return the commands of the session `obstacle_course` by name."""

    def commands(*posargs: str) -> dict[str, tuple[str, ...]]:
        session = Session(*posargs)
        sessions["obstacle_course"](session)
        return {command[0]: command[1:] for command in session.commands}

    return commands


@pytest.mark.parametrize("quick", [(), ("--quick",)])
def test_a_users_run_is_judged_by_accuracy_alone(course, quick: tuple[str, ...]) -> None:
    assert "--regression" not in course(*quick)["gate"]
    asked = course(*quick, "--force", "--regression")
    assert asked["gate"][-1] == "--regression"
    assert "--force" in asked["run"]
    assert not any("--regression" in asked[name] for name in ("run", "table", "report"))


def test_calibration_asks_linear_shells_and_drawn_ones_and_judges(
    sessions: dict[str, Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    drawn = Path("reports/calibration/cases")
    drawn.mkdir(parents=True)
    (drawn / "drawn_0.toml").touch()
    session = Session("--solver", "mine")
    sessions["calibration"](session)
    first, suites, shells, _, gate = session.commands
    assert first == ("-m", "derivations.drawn_shells", str(drawn))
    assert {"obstacle_course", "verification", "shapes", "variants", "thinness"} < set(suites)
    assert str(drawn / "drawn_0.toml") in shells
    assert all(command[-4:] == ("--solver", "mine", "--store", gate[-1]) for command in (suites, shells))
    assert gate[:2] == ("gate", "--store")


def test_the_checks_before_landing_judge_regression() -> None:
    (line,) = [text for text in (ROOT / ".ci" / "run").read_text().splitlines() if "obstacle_course --" in text]
    assert "--regression" in line.partition("--")[2]


def test_constraints_are_what_pip_says_without_folders_and_local_versions(sessions) -> None:
    written = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    frozen = written.replace("torch==2.13.0\n", "torch==2.13.0+cpu\n").splitlines()[1:]
    assert any("+cpu" in line for line in frozen)
    said = [*reversed(frozen), "-e git+ssh://somewhere#egg=shellbench", "mine @ file:///tmp/mine", "shellbench==0.1.0"]
    assert sessions["pinned"]("\n".join(said)) == written


def test_constraints_are_written_by_a_session_and_checked_by_it(sessions, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    session = Session()
    session.run = lambda *_, **__: "b==2\nA==1\n"
    session.log = session.error = lambda words: said.append(words)
    said: list[str] = []
    sessions["constraints"](session)
    assert (tmp_path / "constraints.txt").read_text() == sessions["PINNED"] + "A==1\nb==2\n"
    session.posargs, session.run = ["--check"], lambda *_, **__: "b==2\nA==1\nc==3\n"
    sessions["constraints"](session)
    assert "lacks c==3:" in said[-1]
