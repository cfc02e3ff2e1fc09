"""The design's import rules: arrows run down only, and the solvers never meet."""

import ast
import subprocess
import sys
from functools import cache
from itertools import combinations
from pathlib import Path

import pytest

import shellbench
from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import solver_entries
from tests.patience import GUARD

PACKAGE = Path(shellbench.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
PLUGINS = PACKAGE.parent / "plugins"
KINDS, SOLVERS = "problems", "solvers"
BASE = {
    "",
    "errors",
    "files",
    "disk",
    "nearest",
    "model",
    "engine",
    "account",
    "sample",
    "portrait",
    "problem",
    "protocol",
    "load_curve",
    "known",
    "shown",
}  # what all stand on
BELOW = {  # what a layer may import beside itself
    "base": BASE,
    "problems": BASE | {"problems"},
    "solvers": BASE | {"problems"},
    "bench": BASE | {"bench"},
    "report": BASE | {"bench", "report"},
    "testing": BASE | {"problems", "bench", "testing"},
    "interface": BASE | {"bench", "report"},
    "cli": BASE | {"bench", "testing", "report", "cli"},
    "__main__": {"cli"},
}
HEAVY = {"torch", "skfem", "scipy", "KratosMultiphysics", "mujoco"}


@cache
def imports(path: Path) -> frozenset[str]:
    """Absolute names of all that a module imports, at any depth."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = path.relative_to(PACKAGE.parent).with_suffix("").parts
            base = ".".join(parents[: -node.level]) + "." if node.level else ""
            names |= {
                f"{base}{node.module or ''}".rstrip("."),
                *(f"{base}{node.module or ''}.{a.name}" for a in node.names),
            }
    return frozenset(names)


def layer(path: Path) -> str:
    first = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    return "" if first == "__init__" else first


def test_imports_run_down():
    for path, name in ((module, name) for module in MODULES for name in imports(module)):
        own, parts = layer(path), name.split(".")
        if parts[0] != "shellbench" or len(parts) == 1 or not is_module(*parts[1:2]):
            continue
        if own == parts[1] == SOLVERS:
            same = path.relative_to(PACKAGE).parts[1]
            assert len(parts) == 2 or parts[2] == same, f"solver {same} imports {name}"
        else:
            assert parts[1] in BELOW["base" if own in BASE else own], f"{path} imports {name}"


@cache
def is_module(name: str) -> bool:
    return (PACKAGE / name).with_suffix(".py").exists() or (PACKAGE / name).is_dir()


def test_only_solvers_need_a_solver_library():
    # between values, the nearest place or triangles, or least squares of a mesh
    looking_up = ("load_curve", "body", "self_intersection", "spline")
    for path in (path for path in MODULES if layer(path) != SOLVERS):
        refused = HEAVY - ({"scipy"} if layer(path) == "report" or path.stem in looking_up else set())
        found = {name for name in imports(path) if name.split(".")[0] in refused}
        assert not found, f"{path} imports {found}"


def test_the_report_knows_no_kind_of_problem():
    kinds = {f"shellbench.{KINDS}.{folder.name}" for folder in (PACKAGE / KINDS).iterdir() if folder.is_dir()}
    for path in (path for path in MODULES if layer(path) == "report"):
        found = {name for name in imports(path) if ".".join(name.split(".")[:3]) in kinds}
        assert not found, f"{path} imports {found}"


def test_the_report_knows_no_case_by_name():
    names = set(catalog.case_names())
    for path in (PACKAGE / "report").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert node.value not in names, f"{path.name}: {node.value}"


def test_no_modules_import_each_other_in_a_circle():
    """Imports for types only count too. Two of one folder may, of which one comes late."""
    names = {path: ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts) for path in MODULES}
    graph = {name: imports(path) & set(names.values()) - {name} for path, name in names.items()}
    while True:
        imported = set().union(*graph.values())
        circles = {name: wanted & graph.keys() for name, wanted in graph.items() if name in imported}
        circles = {name: wanted for name, wanted in circles.items() if wanted}
        if circles == graph:
            break
        graph = circles
    for name, other in ((name, other) for name, wanted in graph.items() for other in wanted):
        assert other.rpartition(".")[0] == name.rpartition(".")[0], f"in circles: {sorted(graph)}"


DECLARE = """
import sys
from shellbench.bench.plugins.registry import load_solver, solver_entries
from shellbench.errors import InputError
for entry in solver_entries().values():
    try:
        load_solver(entry)
    except InputError as error:  # an engine that is not installed
        assert "not installed" in str(error), error
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""


def test_solvers_are_listed_without_what_solves():
    """A solver declares itself in a light module; what solves is imported when it is called."""
    assert solver_entries()
    done = subprocess.run([sys.executable, "-c", DECLARE], capture_output=True, text=True, timeout=GUARD, check=True)
    assert not HEAVY & set(done.stdout.split())


def test_the_bench_knows_no_solver_by_name():
    for path in MODULES:
        if layer(path) in {"bench", "report"}:
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    assert node.value not in {
                        "fem",
                        "ndf",
                        "ndf-ritz",
                        "ndf-published",
                        "cst-hinge",
                        "kratos-iga",
                        "kratos-thin",
                        "mujoco-flex",
                    }, f"{path.name}: {node.value}"


@pytest.mark.parametrize(
    ("one", "other"),
    list(combinations(("fem", "ndf", "cst", "kratos", "mujoco", "rope", "pbd", "pendulum", "field"), 2)),
)
def test_the_solvers_share_no_mechanics(one, other):
    """No function body of some length stands on both sides."""

    assert bodies(one)
    assert not bodies(one) & bodies(other)


@cache
def bodies(solver):
    """What functions of more than three statements do, as text."""
    return {
        "\n".join(ast.unparse(line) for line in node.body[1:])
        for folder in (PLUGINS / solver / f"shellbench_{solver}", PACKAGE / SOLVERS / solver)
        for path in folder.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef) and len(node.body) > 3
    }
