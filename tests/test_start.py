"""Commands start quickly, because each imports what it needs and nothing else.

Looked at is what a command has imported when it ends, and not how long it took. Each runs in a process of its own.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from shellbench.bench.plugins.registry import solver_entries
from tests.report.test_without_solvers import runs  # noqa: F401 - a fixture

SOLVES = {"torch", "skfem", "pypardiso", "threadpoolctl"}
DRAWS = {"matplotlib", "PIL", "jinja2"}
READS = {"numpy", "pandas", "scipy"}  # and pydantic, which typer takes for itself
OWN = [name for name, entry in solver_entries().items() if entry.module.split(".")[1] in ("fem", "ndf", "cst")]
COMMANDS = """
import json, sys
from shellbench.cli import main
for arguments in json.loads(sys.argv[1]):
    sys.argv = ["shellbench", *arguments]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
    print("\\nimported:", *sorted({name.partition(".")[0] for name in sys.modules}))
"""


def python(program: str, *arguments: object) -> str:
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", program, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True, env=environment)
    return done.stdout


def imported_after(*commands: list[str]) -> list[set[str]]:
    """Run commands one after another; return the top-level packages that are imported when each ends."""
    lines = python(COMMANDS, json.dumps(commands)).splitlines()
    return [set(line.split()[1:]) for line in lines if line.startswith("imported: ")]


def test_help_imports_nothing() -> None:
    commands = [[], ["run"], ["table"], ["gate"], ["report"], ["list"]]
    after = imported_after(*([*command, "--help"] for command in commands))
    assert len(after) == len(commands)
    assert not after[-1] & (SOLVES | DRAWS | READS)


def test_a_list_imports_nothing_that_solves() -> None:
    (found,) = imported_after(["list", "--json"])
    assert not found & ((SOLVES | DRAWS | {"pandas"}) - {"threadpoolctl"})  # engines take it


def test_a_table_imports_nothing_that_solves_or_draws(runs: Path) -> None:  # noqa: F811
    table = ["table", "--store", str(runs), "--format"]
    for_programs, for_people = imported_after([*table, "json"], [*table, "text"])
    assert not for_programs & (SOLVES | DRAWS | {"scipy", "pandas"})
    assert not for_people & (SOLVES | DRAWS | {"scipy"})
    assert "pandas" in for_people  # what is imported is seen


@pytest.mark.parametrize("name", OWN)
def test_a_solver_says_what_it_is_before_anything_is_imported_that_solves(name: str) -> None:
    entry = solver_entries()[name]
    program = (
        "import json, sys\n"
        "from shellbench.bench.plugins.registry import SolverEntry, load_solver\n"
        "solver = load_solver(SolverEntry(*sys.argv[1:], '', ''))\n"
        "print(json.dumps([solver.capabilities.label, bool(solver.settings_type.model_json_schema()), [*sys.modules]]))"
    )
    label, has_settings, modules = json.loads(python(program, name, entry.target))
    assert label
    assert has_settings
    assert not {module.partition(".")[0] for module in modules} & (SOLVES | DRAWS | {"scipy"})


@pytest.mark.parametrize(("name", "library"), [("fem", "skfem"), ("ndf-ritz", "torch")])
def test_a_fork_server_has_imported_what_solves(name: str, library: str) -> None:
    program = (
        "import sys\n"
        "from shellbench.bench.run.server import import_what_solves\n"
        "import_what_solves(sys.argv[1])\n"
        "before = {module for module in sys.modules if module.startswith('shellbench.')}\n"
        "from shellbench.bench.catalogue import catalog\n"
        "from shellbench.bench.plugins.registry import find_solver, load_solver\n"
        "solver = load_solver(find_solver(sys.argv[2]))\n"
        "solver.solve(catalog.named_case('square_plate'), solver.settings_type())\n"
        "late = {module for module in sys.modules if module.startswith('shellbench.' + sys.argv[3])} - before\n"
        "print(sys.argv[4] in sys.modules, *late)"
    )
    module = solver_entries()[name].module
    found = python(program, module, name, module.rpartition(".")[0].removeprefix("shellbench."), library)
    assert found.split() == ["True"]  # a solve imports nothing more of its solver


def test_a_fork_server_leaves_late_imports_to_a_plug_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lazy_plug.py").write_text("def solve():\n    import lazy_plug_late\n", encoding="utf-8")
    (tmp_path / "lazy_plug_late.py").write_text("", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    program = (
        "import sys\n"
        "from shellbench.bench.run.server import import_what_solves\n"
        "import_what_solves('lazy_plug')\n"
        "print('lazy_plug_late' in sys.modules)"
    )
    assert python(program).strip() == "False"
