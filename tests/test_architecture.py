"""The design's import rules: arrows run down only, and the solvers never meet."""

import ast
from itertools import combinations
from pathlib import Path

import pytest

import shellbench

PACKAGE = Path(shellbench.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
CORE = {"solution", "measure", "case", "suite", "catalog", "reference", "surface", "material", "conditions", "quantities",
        "places", "path", "course", "dynamics", "load_curve", "rigid", "rounding", "expression", "model", "errors", "engine", ""}  # fmt: skip
MAY_IMPORT = {
    "fem": CORE | {"fem"},
    "ndf": CORE | {"ndf"},
    "cst": CORE | {"cst"},
    "kratos": CORE | {"kratos"},
    "mujoco": CORE | {"mujoco"},
    "bench": CORE | {"bench"},
    "report": CORE | {"bench", "report"},
    "conformance": CORE | {"bench", "conformance"},
    "pytest_plugin": CORE | {"bench", "pytest_plugin"},
    "cli": CORE | {"bench", "conformance", "report", "cli"},
    "__main__": {"cli"},
}
HEAVY = {"torch", "skfem", "scipy", "KratosMultiphysics", "mujoco"}


def imports(path: Path) -> set[str]:
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
    return names


def layer(path: Path) -> str:
    first = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    return "" if first == "__init__" else first


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_run_down(path):
    allowed = MAY_IMPORT.get(layer(path), CORE)
    for name in imports(path):
        parts = name.split(".")
        if (
            parts[0] == "shellbench"
            and len(parts) > 1
            and (PACKAGE / parts[1]).with_suffix(".py").exists() | (PACKAGE / parts[1]).is_dir()
        ):
            assert parts[1] in allowed, f"{path.name} imports {name}"


@pytest.mark.parametrize(
    "path",
    [p for p in MODULES if layer(p) in {"bench", "report", "cli"} | CORE],
    ids=lambda p: str(p.relative_to(PACKAGE)),
)
def test_the_bench_and_the_core_need_no_solver_library(path):
    for name in imports(path):
        root = name.split(".")[0]
        assert root not in HEAVY - ({"scipy"} if layer(path) in {"report", "load_curve"} else set()), (
            f"{path.name} imports {name}"
        )


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


@pytest.mark.parametrize(("one", "other"), list(combinations(("fem", "ndf", "cst", "kratos", "mujoco"), 2)))
def test_the_solvers_share_no_mechanics(one, other):
    """No function body of some length stands on both sides."""

    def bodies(folder):
        for path in (PACKAGE / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.FunctionDef) and len(node.body) > 3:
                    yield "\n".join(ast.unparse(line) for line in node.body[1:])

    assert not set(bodies(one)) & set(bodies(other))
