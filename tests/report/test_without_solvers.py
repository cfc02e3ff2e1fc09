"""Tables and the report are made anew from records alone, on a machine without any solver or its libraries.

Each command runs in a process of its own, in which the solvers and the libraries that they stand on can't be imported.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from shellbench.bench import catalog
from shellbench.bench.identity import current_source
from shellbench.bench.registry import solver_entries
from tests.patience import GUARD
from tests.report.conftest import record

PACKAGES = ("torch", "skfem", "pypardiso", "shellbench.solvers.fem", "shellbench.solvers.ndf", "shellbench.solvers.cst")
SOLVERS = ("fem", "ndf-ritz", "ndf")
TEXT = (".md", ".csv", ".tex", ".json", ".html")
PROGRAM = f"""
import sys
from importlib.abc import MetaPathFinder

class Blocked(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if any(name == package or name.startswith(package + ".") for package in {PACKAGES}):
            raise ImportError(name + " is blocked")

mode, *arguments = sys.argv[1:]
if mode != "with":
    sys.meta_path.insert(0, Blocked())
if mode == "unregistered":
    from shellbench.bench import registry
    registry.entry_points = lambda group: ()
from shellbench.cli import main
sys.argv = ["shellbench", *arguments]
try:
    main()
finally:
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
                update={"identity": made.identity.model_copy(update=source), "defaults": made.identity.settings}
            )
            path = folder / f"{made.run_id}.json"
            path.write_text(json.dumps(changed.model_dump(mode="json")), encoding="utf-8")
    return folder


def shellbench(mode: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", PROGRAM, mode, *map(str, arguments)]
    quiet = os.environ | {"OMP_NUM_THREADS": "1"}
    return subprocess.run(command, capture_output=True, text=True, timeout=GUARD, check=False, env=quiet)


@pytest.mark.parametrize(
    "format_", ["json", *(pytest.param(name, marks=pytest.mark.long) for name in ("latex", "text", "markdown", "csv"))]
)
def test_tables_are_the_same_without_solvers(runs: Path, format_: str) -> None:
    written = [shellbench(mode, "table", "--store", runs, "--format", format_) for mode in ("with", "without")]
    assert [w.returncode for w in written] == [0, 0], written[1].stderr
    assert written[0].stdout == written[1].stdout
    assert "square_plate" in written[0].stdout.lower().replace(" ", "_")
    assert written[1].stderr == written[0].stderr


def test_tables_are_the_same_where_no_solver_is_registered(runs: Path) -> None:
    with_, without = (
        shellbench(mode, "table", "--store", runs, "--format", "csv") for mode in ("with", "unregistered")
    )
    assert without.returncode == 0, without.stderr
    assert without.stdout == with_.stdout
    for solver, count in (("fem", "1 stored run is"), ("ndf", "3 stored runs are"), ("ndf-ritz", "3 stored runs are")):
        assert f"solver '{solver}' is not installed: {count} shown as recorded" in without.stderr


@pytest.mark.parametrize("mode", ["without", "unregistered"])
def test_the_gate_stays_red_and_calm_without_solvers(runs: Path, mode: str) -> None:
    scope = ("--suite", "obstacle_course", "--store", runs, "--baseline", runs / "none.json")
    ended = shellbench(mode, "gate", *scope)
    assert ended.returncode == 1
    assert "Traceback" not in ended.stderr


def folder_of(mode: str, runs: Path, out: Path) -> dict[str, bytes]:
    ended = shellbench(mode, "report", "--store", runs, "--no-print", "--out", out)
    assert ended.returncode == 0, ended.stderr
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


def test_the_paper_needs_no_solver(runs: Path, tmp_path: Path) -> None:
    ended = shellbench("without", "report", "--store", runs, "--paper", tmp_path / "paper")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split() == ["written", "to", str(tmp_path / "paper" / "paper.tex")]
    assert (tmp_path / "paper" / "tables" / "displacements_obstacle_course.tex").is_file()
    assert not (tmp_path / "paper" / "index.html").exists()
