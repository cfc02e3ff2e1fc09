"""Packages outside of shellbench import what docs/solver_protocol.md lists as public, and nothing else of it."""

import ast
import re
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins import registry
from shellbench.errors import InputError

ROOT = Path(__file__).resolve().parent.parent
PLUGINS = sorted(path.parent for path in (ROOT / "plugins").glob("*/pyproject.toml"))
BENCH = ROOT / "plugins" / "dask"  # a part of the bench, for one version of shellbench
PACKAGES = [*(path for path in PLUGINS if path != BENCH), ROOT / "examples" / "solver_template"]
MODULE = re.compile(r"`(shellbench(?:\.\w+)*)`")


def public() -> set[str]:
    """Names of the modules in the first column of the table."""
    page = (ROOT / "docs" / "solver_protocol.md").read_text(encoding="utf-8")
    section = page.partition("\n## What is public\n")[2].partition("\n## ")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {name for row in rows for name in MODULE.findall(row)}


def imported(path: Path) -> set[str]:
    """Modules of shellbench that a file imports, at any depth; of `import_module`, too."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Import():
                found |= {alias.name for alias in node.names}
            case ast.ImportFrom(level=0, module=str(module)):
                submodules = {f"{module}.{alias.name}" for alias in node.names} if module in PARENTS else {module}
                found |= submodules
            case ast.Call(args=[ast.Constant(value=str(name)), *_]):
                found.add(name)
    return {name for name in found if re.fullmatch(r"shellbench(\.\w+)*", name)}


PARENTS = {name.rpartition(".")[0] for name in public()} - public()  # packages that are no modules of the list


def test_what_is_public_is_there_and_is_no_solver() -> None:
    assert len(public()) > 20
    for name in public():
        assert find_spec(name) is not None, name
        assert not name.startswith("shellbench.solvers")


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_a_package_imports_what_is_public_only(package: Path) -> None:
    files = [path for path in package.rglob("*.py") if "tests" not in path.relative_to(package).parts]
    assert files
    for path in files:
        assert imported(path) <= public(), f"{path}: {sorted(imported(path) - public())}"


@pytest.mark.parametrize(
    "code",
    [
        "import shellbench.solvers.fem.solver",
        "from shellbench.solvers.fem import solver",
        "from shellbench.problems import solving",
        "def f():\n    from shellbench.bench.store.store import Store",
        "importlib.import_module('shellbench.bench.judge.gate')",
    ],
)
def test_what_is_not_public_is_seen(tmp_path: Path, code: str) -> None:
    (tmp_path / "bad.py").write_text(code, encoding="utf-8")
    assert imported(tmp_path / "bad.py") - public()


@pytest.mark.parametrize("package", PLUGINS, ids=lambda path: path.name)
def test_a_plugin_says_how_it_is_installed_in_ten_lines(package: Path) -> None:
    readme = (package / "README.md").read_text(encoding="utf-8")
    assert f"python -m pip install ./plugins/{package.name}" in readme
    assert len([line for line in readme.splitlines() if line]) <= 12


def test_what_a_package_brings_is_known_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    told = tomllib.loads(Path(registry.__file__).with_name("packages.toml").read_text(encoding="utf-8"))
    for package in PLUGINS:
        project = tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        brings = told.pop(project["name"])
        assert brings["folder"] == f"plugins/{package.name}"
        assert set(brings["solvers"]) == set(project["entry-points"].get("shellbench.solvers", ()))
        assert set(brings["suites"]) == {path.stem for path in package.glob("*/data/cases/suites/*.toml")}
    assert not told
    monkeypatch.setattr(registry, "solver_entries", dict)
    with pytest.raises(InputError, match=r"solver 'mujoco-flex' comes with .*: python -m pip install ./plugins/mujoco"):
        registry.find_solver("mujoco-flex")
    monkeypatch.setattr(catalog, "suite_names", list)
    with pytest.raises(InputError, match=r"suite 'engines' comes with .*: python -m pip install ./plugins/kratos"):
        catalog.find_suite("engines")
