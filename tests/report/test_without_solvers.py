"""Tables and the report are made anew from records alone, on a machine without any solver or its libraries.

Commands run in processes in which the solvers and the libraries that they stand on can't be imported.
"""

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import solver_entries
from shellbench.bench.store.identity import current_source
from shellbench.bench.store.record import document
from tests.patience import GUARD
from tests.report.conftest import record

PACKAGES = ("torch", "skfem", "pypardiso", "shellbench.solvers.fem", "shellbench.solvers.ndf", "shellbench.solvers.cst")
SOLVERS = ("fem", "ndf-ritz", "ndf")
TEXT = (".md", ".csv", ".tex", ".json", ".html")
END = "--- end of a command"
pytestmark = pytest.mark.long
PROGRAM = f"""
import sys
from importlib.abc import MetaPathFinder

class Blocked(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if any(name == package or name.startswith(package + ".") for package in {PACKAGES}):
            raise ImportError(name + " is blocked")

mode, *commands = sys.argv[1:]
if mode != "with":
    sys.meta_path.insert(0, Blocked())
if mode == "unregistered":
    from shellbench.bench.plugins import registry
    found = registry.entry_points
    registry.entry_points = lambda group: () if group == "shellbench.solvers" else found(group=group)
from shellbench.cli import main
for command in commands:
    sys.argv = ["shellbench", *command.split("\\t")]
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code or 0
    for stream in (sys.stdout, sys.stderr):
        print({END!r}, code, file=stream, flush=True)
if mode != "with":
    assert not set({PACKAGES}) & set(sys.modules)
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Records of the plate that count today: their source is the solvers' source of today."""
    folder = tmp_path_factory.mktemp("current") / "runs"
    folder.mkdir()
    case = catalog.named_case("square_plate")
    entries = solver_entries()
    for solver in SOLVERS:
        for seed in (None,) if solver == "fem" else (0, 1, 2):
            made = record(folder, case, solver, seed, 1e-7, settings={"width": 600})
            source = {"source": current_source(entries[solver])}
            changed = made.model_copy(
                update={
                    "identity": made.identity.model_copy(update=source),
                    "defaults": made.identity.settings,
                    "sequence": len(list(folder.glob("*.json"))) + 1,
                }
            )
            (folder / f"{made.run_id}.json").write_bytes(document(changed))
    return folder


@dataclass(frozen=True)
class Ended:
    """Output and exit code of a command."""

    code: int
    out: str
    err: str


def shellbench(mode: str, *commands: Sequence[object]) -> list[Ended]:
    """Make commands one after another in one process: it takes longer to import everything than to make one."""
    lines = ["\t".join(map(str, command)) for command in commands]
    quiet = os.environ | {"OMP_NUM_THREADS": "1"}
    program = [sys.executable, "-c", PROGRAM, mode, *lines]
    done = subprocess.run(program, capture_output=True, text=True, timeout=GUARD, check=False, env=quiet)
    assert done.returncode == 0, done.stderr
    outs, errs = (re.split(f"^{END} (\\d+)\n", text, flags=re.MULTILINE) for text in (done.stdout, done.stderr))
    found = [Ended(int(code), out, err) for out, code, err in zip(outs[::2], outs[1::2], errs[::2], strict=False)]
    assert len(found) == len(commands)
    return found


def table(runs: Path, format_: str) -> tuple[object, ...]:
    return "table", "--store", runs, "--format", format_


@pytest.fixture(scope="module")
def said(runs: Path) -> dict[str, list[Ended]]:
    """Tables as JSON and as CSV: with solvers, without them, and where none is registered; there the gate too."""
    tables = (table(runs, "json"), table(runs, "csv"))
    gate = ("gate", "--suite", "obstacle_course", "--store", runs, "--baseline", runs / "none.json")
    return {
        "with": shellbench("with", *tables),
        **{mode: shellbench(mode, *tables, gate) for mode in ("without", "unregistered")},
    }


def must_be_the_same(with_: Ended, without: Ended) -> None:
    assert (with_.code, without.code) == (0, 0), without.err
    assert with_.out == without.out
    assert "square_plate" in with_.out.lower().replace(" ", "_")
    assert without.err == with_.err


@pytest.mark.parametrize("place", [0, 1], ids=["json", "csv"])
def test_tables_are_the_same_without_solvers(said: dict[str, list[Ended]], place: int) -> None:
    must_be_the_same(said["with"][place], said["without"][place])


@pytest.mark.long
@pytest.mark.parametrize("format_", ["latex", "text", "markdown"])
def test_tables_for_readers_are_the_same_without_solvers(runs: Path, format_: str) -> None:
    must_be_the_same(*(shellbench(mode, table(runs, format_))[0] for mode in ("with", "without")))


def test_tables_are_the_same_where_no_solver_is_registered(said: dict[str, list[Ended]]) -> None:
    with_, without = said["with"][1], said["unregistered"][1]
    assert without.code == 0, without.err
    assert without.out == with_.out
    for solver, count in (("fem", "1 stored run is"), ("ndf", "3 stored runs are"), ("ndf-ritz", "3 stored runs are")):
        assert f"solver '{solver}' is not installed: {count} shown as recorded" in without.err


@pytest.mark.parametrize("mode", ["without", "unregistered"])
def test_the_gate_stays_red_and_calm_without_solvers(said: dict[str, list[Ended]], mode: str) -> None:
    ended = said[mode][2]
    assert ended.code == 1
    assert "Traceback" not in ended.err


def folder_of(mode: str, runs: Path, out: Path) -> dict[str, bytes]:
    (ended,) = shellbench(mode, ("report", "--store", runs, "--no-print", "--out", out))
    assert ended.code == 0, ended.err
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


@pytest.mark.long
@pytest.mark.parametrize("mode", ["without", "unregistered"])
def test_the_report_is_the_same_without_solvers(runs: Path, tmp_path: Path, mode: str) -> None:
    """Every file, figures too; rows that are missing as well, which no solver can be asked about."""
    with_, without = folder_of("with", runs, tmp_path / "with"), folder_of(mode, runs, tmp_path / mode)
    assert set(with_) == set(without)
    assert any(name.endswith(".png") for name in with_)
    differing = [name for name in with_ if with_[name] != without[name]]
    assert [name for name in differing if name.endswith(TEXT)] == []
    assert differing == []


@pytest.mark.long
def test_the_paper_needs_no_solver(runs: Path, tmp_path: Path) -> None:
    (ended,) = shellbench("without", ("report", "--store", runs, "--paper", tmp_path / "paper"))
    assert ended.code == 0, ended.err
    assert ended.out.split() == ["written", "to", str(tmp_path / "paper" / "paper.tex")]
    assert (tmp_path / "paper" / "tables" / "displacements_obstacle_course.tex").is_file()
    assert not (tmp_path / "paper" / "index.html").exists()
