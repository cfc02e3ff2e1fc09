"""The design's import rules: arrows run down only, and the solvers never meet."""

import ast
import subprocess
import sys
from collections import Counter
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
STEPPING = "stepping"  # step control of paths, which every solver may import
DRIVEN = {"skinning": {"rope"}}  # a solver may use others that make its input: ropes move the bones of a garment
BASE = {"", "errors", "files", "disk", "protocol", "problem"}  # what all stand on
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
ROOMS = {  # of a package, from the lowest up; what stands at its root is a room of its own
    "": ("errors", "files", "disk", "protocol", "problem", "problems", "solvers", "bench", "report", "interface"),
    "bench": ("plugins", "catalogue", "sheet", "store", "run", "judge", "stated"),
    "report": ("data", "figures", "sections", "studies", "page"),
    "problems.shell": (
        *("question", "mesh", "field", "quantities", "posed", "case", "variants", "symmetry"),
        *("declining", "solution", "deck", "records", "sheet", "kind"),
    ),
    "solvers.fem": (
        *("conditioned_settings", "mesh", "algebra", "settings", "mechanics", "linear", "path", "derivatives"),
        *("refinement", "motion", "solving", "solver", "editing_solver", "identifying_solver"),
        *("conditioned", "conditioned_solver"),
    ),
    "solvers.ndf": (
        *("field", "strains", "linear", "field_solver", "bspline", "path", "bspline_solver", "motion", "ritz"),
        *("training", "conditioned", "ritz_solver", "trainer_solver", "published", "conditioned_solver"),
        *("editing_solver", "published_solver", "conditioned_published_solver"),
    ),
}
MOST_MODULES, MOST_LINES = 20, 400  # of a folder, its `__init__` apart; of a module
CEILINGS = {  # lines of code: no blanks, comments and docstrings; the aims are 52,000 and 42,000
    "shellbench": 60_110,
    "tests": 42_950,
    "shellbench/protocol": 1_205,
    "shellbench/bench": 7_215,
    "shellbench/bench/catalogue": 1_003,
    "shellbench/bench/judge": 2_135,
    "shellbench/bench/plugins": 1_306,
    "shellbench/bench/run": 889,
    "shellbench/bench/store": 1_485,
    "shellbench/cli": 1_020,
    "shellbench/problems": 11_448,
    "shellbench/problems/shell": 7_784,
    "shellbench/report": 9_071,
    "shellbench/report/data": 2_406,
    "shellbench/report/figures": 843,
    "shellbench/report/page": 946,
    "shellbench/report/sections": 2_086,
    "shellbench/report/studies": 2_802,
    "shellbench/solvers/fem": 8_450,
    "shellbench/solvers/ndf": 12_484,
    "shellbench/testing": 2_727,
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
            allowed = {same, STEPPING, *DRIVEN.get(same, ())}
            assert len(parts) == 2 or parts[2] in allowed, f"solver {same} imports {name}"
        else:
            assert parts[1] in BELOW["base" if own in BASE else own], f"{path} imports {name}"


@cache
def is_module(name: str) -> bool:
    return (PACKAGE / name).with_suffix(".py").exists() or (PACKAGE / name).is_dir()


def test_only_solvers_need_a_solver_library():
    # between values, the nearest place, cells or triangles, or least squares of a mesh
    looking_up = ("load_curve", "body", "self_intersection", "spline", "cells", "nodal_field")
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


def name_of(path: Path) -> str:
    return ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")


@cache
def arrows() -> dict[str, frozenset[str]]:
    """Modules of the package, and the modules that each imports, for types only as well."""
    names = {name_of(path): path for path in MODULES}
    return {name: imports(path) & names.keys() - {name} for name, path in names.items()}


def test_no_modules_import_each_other_in_a_circle():
    graph = dict(arrows())
    while leaves := [name for name, wanted in graph.items() if not wanted & graph.keys()]:
        for name in leaves:
            del graph[name]
    assert not graph, f"in circles, or above one: {sorted(graph)}"


@pytest.mark.parametrize("package", ROOMS)
def test_rooms_import_those_below_them(package):
    """The order is complete, too: a room that is not in it is not known."""
    prefix = f"shellbench.{package}." if package else "shellbench."
    order = {room: place for place, room in enumerate(ROOMS[package])}
    for name, wanted in arrows().items():
        if name.startswith(prefix):
            own = name.removeprefix(prefix).partition(".")[0]
            assert own in order or not package, f"{name} is in no known room"
            for other in (one for one in wanted if one.startswith(prefix)):
                theirs = other.removeprefix(prefix).partition(".")[0]
                assert order.get(theirs, 0) <= order.get(own, len(order)), f"{name} imports {other}, which is above it"


def test_every_room_says_what_it_is_for():
    for package, rooms in ROOMS.items():
        for room in rooms if package else ("protocol",):
            folder = PACKAGE.joinpath(*package.split("."), room) if package else PACKAGE / room
            said = ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) if folder.is_dir() else "import"
            assert "import" in (said or ""), f"{folder} does not say what it may import"


def test_modules_and_folders_are_small():
    folders = Counter(path.parent for path in MODULES if path.name != "__init__.py")
    assert not {str(folder): many for folder, many in folders.items() if many > MOST_MODULES}
    lengths = {str(path): len(path.read_text().splitlines()) for path in MODULES}
    assert not {path: length for path, length in lengths.items() if length > MOST_LINES}


@pytest.mark.parametrize("folder", CEILINGS)
def test_the_code_weighs_no_more_than_its_budget(folder):
    """Who exceeds a ceiling deletes something, or argues for more in the commit that raises it."""
    root = PACKAGE.parent / folder
    if not root.is_dir():
        pytest.skip("the tests are not beside the package")
    weight = sum(lines_of_code(path) for path in root.rglob("*.py"))
    assert weight <= CEILINGS[folder], f"{folder} has {weight} lines of code, {weight - CEILINGS[folder]} too many"


@cache
def lines_of_code(path: Path) -> int:
    """Lines that are not blank, and neither comments nor texts that stand alone."""
    source = path.read_text()
    words = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Expr)]
    texts = [node for node in words if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)]
    apart = {row for node in texts for row in range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    lines = enumerate(source.split("\n"), start=1)
    return sum(1 for row, line in lines if line.strip() and not line.strip().startswith("#") and row not in apart)


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
    list(combinations(("fem", "ndf", "cst", "kratos", "mujoco", "rope", "pbd", "pendulum", "field", STEPPING), 2)),
)
def test_the_solvers_share_no_mechanics(one, other):
    """No function body of some length stands on both sides, and none of step control is written again."""

    assert bodies(one)
    assert not bodies(one) & bodies(other)


def test_step_control_has_no_mechanics():
    """Lengths of steps are numbers: neither an array nor a shell is needed for them."""
    for path in (PACKAGE / SOLVERS / STEPPING).glob("*.py"):
        outside = {name.partition(".")[0] for name in imports(path)} - {"shellbench"} - sys.stdlib_module_names
        assert not outside, f"{path} imports {outside}"
        room = f"shellbench.{SOLVERS}.{STEPPING}"
        assert not {name for name in imports(path) if name.startswith("shellbench") and not name.startswith(room)}


@cache
def bodies(solver):
    """Return the bodies of functions of more than three statements, as text."""
    return {
        "\n".join(ast.unparse(line) for line in node.body[1:])
        for folder in (PLUGINS / solver / f"shellbench_{solver}", PACKAGE / SOLVERS / solver)
        for path in folder.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef) and len(node.body) > 3
    }
