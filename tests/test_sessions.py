"""The sessions of the noxfile: what a user's command asks of the gate, and what the maintainers' does."""

from __future__ import annotations

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
def course(monkeypatch: pytest.MonkeyPatch):
    """Return the commands of the session `obstacle_course` by name."""
    nox: Any = types.ModuleType("nox")
    nox.session, nox.Session, nox.options = (lambda made: made), Session, types.SimpleNamespace()
    monkeypatch.setitem(sys.modules, "nox", nox)
    sessions = runpy.run_path(str(ROOT / "noxfile.py"))

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


def test_the_checks_before_landing_judge_regression() -> None:
    (line,) = [text for text in (ROOT / ".ci" / "run").read_text().splitlines() if "obstacle_course" in text]
    assert "--regression" in line.partition("--")[2]
