"""Third-party solvers and kinds, asked from outside: however they end, it is one sentence, and never a good exit."""

import datetime
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins import kinds, outside
from shellbench.bench.plugins.line import Line
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.bench.plugins.subject import Subject
from shellbench.bench.store.store import Store
from shellbench.errors import InputError, PluginError, ShellbenchError
from tests.bench.running import run
from tests.patience import GUARD

PLUGIN = """
import ctypes, os, signal, sys, time
from shellbench.problem import Capabilities, Settings
{top}
class Bad:
    name = "bad"
    capabilities = Capabilities(theories=("kirchhoff-love-linear",), label="bad")
    settings_type = Settings
    def declines(self, case):
        {declines}
    def solve(self, case, settings, start=None, progress=None): ...
    def load(self, path): ...
"""
METADATA = "Metadata-Version: 2.1\nName: bad-dist\nVersion: 1.0\n"
POINTS = "[shellbench.solvers]\nbad = bad_plugin:Bad\n"
NOISE = (
    "[os.write(n, b'noise') for n in range(3, 30) if os.path.exists(f'/proc/self/fd/{n}') and os.isatty(n) is False]"
)
Make = Callable[..., SolverEntry]


@pytest.fixture
def plugin_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Make]:
    """Install a plug-in with such lines at its top and in `declines`; nothing is kept of other tests."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(tmp_path / "installed")

    def make(top: str = "", declines: str = "return None") -> SolverEntry:
        about = tmp_path / "installed" / "bad_dist-1.0.dist-info"
        about.mkdir(parents=True, exist_ok=True)
        (about / "METADATA").write_text(METADATA)
        (about / "entry_points.txt").write_text(POINTS)
        (tmp_path / "installed" / "bad_plugin.py").write_text(PLUGIN.format(top=top, declines=declines))
        return SolverEntry("bad", "bad_plugin:Bad", "bad-dist", "1.0")

    yield make
    for found in ("solver", "kind"):
        subject = outside.outsider(found, SolverEntry("bad", "bad_plugin:Bad", "bad-dist", "1.0")).subject
        if subject is not None:
            subject.stop()
    outside.outsider.cache_clear()


def asked(entry: SolverEntry) -> str | None:
    found = outside.resolve_solver(entry)
    assert isinstance(found, outside.AskedSolver)
    return found.declines(catalog.named_case("square_plate"))


@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    ("top", "declines", "words"),
    [
        ("sys.exit(0)", "", "the import raised SystemExit: 0"),
        ("os._exit(0)", "", "the import: its process died (exit code 0)"),
        ("raise ValueError('two\\nlines')", "", "two lines"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "", "the import: its process died (signal 11)"),
        ("os.kill(os.getppid(), signal.SIGKILL); time.sleep(60)", "", "the import: its process died (signal 9)"),
        (NOISE, "", "it wrote something else than its answer"),
        ("class Settings(Settings):\n    order: int", "", "its setting 'order' has no default"),
        ("", "sys.exit(0)", "declines raised SystemExit: 0"),
        ("", "os._exit(0)", "declines: its process died (exit code 0)"),
        ("", "os.closerange(3, 99); return None", "declines: "),
        ("", "return 0", "declines raised TypeError: it returned int"),
    ],
)
def test_whatever_it_does_is_one_sentence(plugin_of: Make, top: str, declines: str, words: str) -> None:
    entry = plugin_of(top, declines or "return None")
    with pytest.raises(PluginError) as found:
        asked(entry)
    said = str(found.value)
    assert said.startswith("solver 'bad' can't be used: ")
    assert words in said
    assert "\n" not in said
    assert found.value.exit_code == 1


@pytest.mark.parametrize(
    ("limit", "value", "top", "words"),
    [
        ("SECONDS", 1.0, "time.sleep(3600)", "did not end within 1 s"),
        ("MEMORY", 4e8, "kept = bytearray(b'x') * 600_000_000; time.sleep(3600)", "more than 0.4 GB"),
    ],
)
def test_it_has_a_limit(
    plugin_of: Make, monkeypatch: pytest.MonkeyPatch, limit: str, value: float, top: str, words: str
) -> None:
    monkeypatch.setattr(outside, limit, value)
    with pytest.raises(PluginError, match=words):
        asked(plugin_of(top))


def test_what_it_answered_is_kept_until_a_file_changes(plugin_of: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = plugin_of(declines="return 'not this one'")
    starts: list[str] = []
    start = Subject.start.__func__  # type: ignore[attr-defined]

    def counted(cls: type[Subject], module: str, *arguments: str, **more: float) -> Subject:
        starts.append(module)
        return start(cls, module, *arguments, **more)

    monkeypatch.setattr(Subject, "start", classmethod(counted))
    for count in (1, 1, 2):
        if count == 2:  # of another size: Python tells a changed file by its second and its size
            plugin_of(declines="return 'nor another one'")
        subject = outside.outsider("solver", entry).subject
        if subject is not None:
            subject.stop()
        outside.outsider.cache_clear()
        assert asked(entry) == ("not this one" if count == 1 else "nor another one")
        assert len(starts) == count
    (kept,) = (Path(os.environ["XDG_CACHE_HOME"]) / "shellbench" / "plugins").iterdir()
    kept.write_text("no answers")
    outside.outsider.cache_clear()
    assert asked(entry) == "nor another one"


def test_what_a_line_carries_is_data_and_nothing_that_runs() -> None:
    import socket

    import numpy as np

    here, there = map(Line, socket.socketpair())
    sent = {"a": np.arange(6.0).reshape(2, 3), "b": [1, None, "x", float("inf")], "c": np.int64(3)}
    here.send(sent)
    came = there.receive()
    assert np.array_equal(came["a"], sent["a"])
    assert came["b"] == sent["b"]
    assert came["c"] == 3
    for bad in (object(), np.array([object()])):
        with pytest.raises(TypeError):
            here.send(bad)
    for shape in (["x"], [0.5], [[1]]):
        here.send([1, "ok", {"$array": ["<f8", shape, ""]}])
        with pytest.raises(ValueError, match="no array"):
            there.receive()
    here.end.send(b"\xff" * 8)
    with pytest.raises(ValueError, match="too long"):
        there.receive()


KIND = """
from typing import Literal
from shellbench.problem import Kind, Problem, Quantity, Variant
class Length(Quantity):
    kind: Literal["length"] = "length"
class Spring(Problem):
    kind: Literal["spring"] = "spring"
    theory: Literal["hooke"] = "hooke"
    stiffness: float
    quantities: tuple[Length, ...]
    def mark_words(self, mark):
        return f"pull {mark:g}"
KIND = Kind(problem=Spring, keep=lambda s, c: None, variants={"soft": Variant("soft", lambda c: {**c.data(), "stiffness": 0.5})})
"""
SPRING = {
    "kind": "spring",
    "title": "A spring",
    "stiffness": 2.0,
    "quantities": [{"name": "l", "kind": "length", "primary": True}, {"name": "half", "kind": "length", "at": 0.5}],
    "known": [{"quantity": "l", "value": 0.5, "source": "Hooke"}],
}


def test_a_kind_of_another_package_is_known_as_data(plugin_of: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    plugin_of(KIND)
    entry = SolverEntry("spring", "bad_plugin:KIND", "bad-dist", "1.0")
    known = kinds.kind_entries() | {"spring": entry}
    monkeypatch.setattr(kinds, "kind_entries", lambda: known)
    points = Path(str(sys.path[0])) / "bad_dist-1.0.dist-info" / "entry_points.txt"
    points.write_text("[shellbench.problems]\nspring = bad_plugin:KIND\n")
    kinds.find_kind.cache_clear()
    try:
        problem = kinds.find_kind("spring").problem
        case = problem.build(SPRING, "mine", "mine.toml")
        assert (case.name, case.primary.name, case.theory, case.states) == ("mine", "l", "hooke", (0.5, 1.0))
        assert case.mark_words(0.5) == "pull 0.5"
        assert case.known[0].value == 0.5
        assert kinds.problem_of({**case.data(), "name": "mine"}).digest() == case.digest()
        soft = catalog.variant_of(case, "soft")
        assert soft.name == "mine@soft"
        assert soft.digest() != case.digest()
        assert kinds.kinds_of_theories(["hooke"]) == ("spring",)
        assert "bad_plugin" not in sys.modules
        with pytest.raises(InputError, match=r"^mine\.toml: field 'stiffness'"):
            problem.build(SPRING | {"stiffness": "x"}, "mine", "mine.toml")
    finally:
        outside.outsider("kind", entry).subject.stop()  # type: ignore[union-attr]
        kinds.find_kind.cache_clear()


def test_a_date_is_a_text_to_a_plug_in(plugin_of: Make) -> None:
    entry = plugin_of("import datetime\nclass Dated(Settings):\n    day: datetime.date | None = None").name
    points = SolverEntry(entry, "bad_plugin:Bad", "bad-dist", "1.0")
    file = Path(str(sys.path[0])) / "bad_plugin.py"
    file.write_text(file.read_text().replace("settings_type = Settings", "settings_type = Dated"))
    solver = outside.resolve_solver(points)
    given = outside.settings_of(solver, {"day": datetime.date(2026, 1, 2)}, 0, "cpu")
    assert given.model_dump()["day"] == "2026-01-02"
    with pytest.raises(InputError, match="'no'"):
        outside.settings_of(solver, {"day": "no"}, 0, "cpu")


def test_a_kind_of_ours_can_not_be_replaced(plugin_of: Make) -> None:
    plugin_of()
    points = Path(str(sys.path[0])) / "bad_dist-1.0.dist-info" / "entry_points.txt"
    points.write_text("[shellbench.problems]\nshell = bad_plugin:KIND\n")
    kinds.kind_entries.cache_clear()
    try:
        with pytest.raises(ShellbenchError, match="two installed packages call a kind of problem 'shell'"):
            kinds.kind_entries()
    finally:
        points.write_text(POINTS)
        kinds.kind_entries.cache_clear()


@pytest.mark.long
@pytest.mark.parametrize(
    ("top", "declines"), [("os._exit(0)", ""), ("sys.exit(0)", ""), ("", "os._exit(0)"), ("", "sys.exit(0)")]
)
def test_no_command_takes_it_for_good(plugin_of: Make, store: Store, top: str, declines: str) -> None:
    plugin_of(top, declines or "return None")
    run(store, "square_plate", solvers=("fem",))
    place = ("--store", str(store.folder))
    for code, command in (
        (1, ("run", "square_plate", "--solver", "bad", *place)),
        (1, ("gate", "square_plate", "--suite", "obstacle_course", "--solver", "bad", *place)),
        (2, ("list", "bad")),
        (2, ("check-solver", "bad", "--case", "square_plate", *place)),
    ):
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, sys.path))}
        call = [sys.executable, "-m", "shellbench", *command]
        done = subprocess.run(call, env=environment, capture_output=True, text=True, timeout=GUARD, check=False)
        assert done.returncode == code, (command, done.stdout, done.stderr)
        said = done.stdout if command[0] == "gate" else done.stderr.splitlines()[-1]  # a gate says it of the rows
        assert "solver 'bad' can't be used: " in said, (command, done.stdout, done.stderr)
