"""The digest of a solver's source changes with all that can change its answers, and with nothing else."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from shellbench import disk
from shellbench.bench.plugins import source
from shellbench.bench.plugins.kinds import module_of
from shellbench.bench.plugins.registry import find_solver, solver_entries
from shellbench.bench.plugins.source import import_closure, locate, source_digest, statements_of
from shellbench.bench.store.identity import MEASURING, current_source
from shellbench.errors import InputError
from shellbench.problems.shell.quantities import measure, quantities
from shellbench.problems.shell.records import sampling


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with imports of all kinds."""
    files = {
        "pack/__init__.py": "",
        "pack/solver.py": "from . import law\nimport numpy\nfrom pack.deep.inner import x\n",
        "pack/law.py": "def f():\n    from .late import g\n    return g\n",
        "pack/late.py": "from __future__ import annotations\nfrom typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from pack import types_only\nelse:\n    from pack import otherwise\n",
        "pack/deep/__init__.py": "from importlib import import_module\nimport_module('pack.dynamic')\n",
        "pack/deep/inner.py": "from ..sibling import *\nx = 1\n",
        "pack/sibling.py": "y = 2\n",
        "pack/dynamic.py": "raise RuntimeError('importing this is a mistake')\n",
        "pack/types_only.py": "",
        "pack/otherwise.py": "",
        "pack/stranger.py": "",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path / "pack"


def test_closure_is_all_that_is_imported_from_the_own_package(package: Path) -> None:
    expected = {"", ".solver", ".law", ".late", ".deep", ".deep.inner", ".sibling", ".dynamic", ".otherwise"}
    assert {name.removeprefix("pack") for name in import_closure("pack.solver")} == expected


def test_closure_is_found_without_importing(package: Path) -> None:
    import_closure("pack.solver")
    assert not any(name.partition(".")[0] == "pack" for name in sys.modules)


@pytest.mark.parametrize("name", ["solver", "law", "late", "deep/inner", "sibling", "dynamic", "__init__"])
def test_any_change_in_the_closure_changes_the_digest(package: Path, name: str) -> None:
    before = source_digest(["pack.solver"])
    path = package / f"{name}.py"
    path.write_text(path.read_text(encoding="utf-8") + "\nz = 3\n", encoding="utf-8")
    assert source_digest(["pack.solver"]) != before


def test_what_looks_the_same_is_not_read_again(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = source_digest(["pack.solver"])
    read = []
    closure = source.import_closure
    monkeypatch.setattr(source, "import_closure", lambda *names: read.append(names) or closure(*names))
    assert source_digest(["pack.solver"]) == before
    assert not read
    (package / "more.py").write_text("", encoding="utf-8")  # a module that came may be what another one imports
    assert source_digest(["pack.solver"]) == before
    assert read == [("pack.solver",)]


def test_a_digest_is_kept_for_later_processes_until_a_file_changes(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(package.parent / "cache"))
    before = source_digest(["pack.solver"])
    assert not (package.parent / "cache").exists()  # the files are as new as the clock's last step

    def later() -> str:
        """Return the digest as another process would see it."""
        monkeypatch.setattr(source, "_DIGESTS", {})
        return source_digest(["pack.solver"])

    monkeypatch.setattr(disk, "SETTLED", 0)
    assert later() == before
    (kept,) = (package.parent / "cache" / "shellbench" / "sources").iterdir()
    with monkeypatch.context() as patched:
        patched.setattr(source, "import_closure", lambda *_: pytest.fail("read again"))
        assert later() == before
    (package / "law.py").write_text((package / "law.py").read_text() + "\nz = 3\n", encoding="utf-8")
    changed = later()
    assert changed != before
    for broken in (b"", b"[]", b'{"digest": 1}', b'{"digest": "' + before.encode() + b'", "places": {}}'):
        kept.write_bytes(broken)
        assert later() == changed


@pytest.mark.parametrize("name", ["stranger", "types_only"])
def test_a_change_outside_of_the_closure_does_not(package: Path, name: str) -> None:
    before = source_digest(["pack.solver"])
    (package / f"{name}.py").write_text("z = 3\n", encoding="utf-8")
    assert source_digest(["pack.solver"]) == before


def move(package: Path, old: str, new: str) -> None:
    """Rename a module, and everything that names it."""
    source, target = (package.parent / f"{name.replace('.', '/')}.py" for name in (old, new))
    target.parent.mkdir(parents=True, exist_ok=True)
    source.rename(target)
    target.parent.joinpath("__init__.py").touch()
    for path in package.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace(old, new), encoding="utf-8")


def test_moving_and_renaming_modules_keeps_the_digest(package: Path) -> None:
    edit(package / "solver.py", "from . import law\n", "from pack.law import f\nF = f\n")
    edit(package / "law.py", "from .late import g\n", "from pack.late import g\n")
    (package / "late.py").write_text("def g():\n    return 1.5e-3\n", encoding="utf-8")
    before = source_digest(["pack.solver"])
    move(package, "pack.law", "pack.laws.hooke")
    move(package, "pack.late", "pack.deep.early")
    assert {"pack.laws.hooke", "pack.deep.early"} <= set(import_closure("pack.solver"))
    assert source_digest(["pack.solver"]) == before
    edit(package / "deep" / "early.py", "1.5e-3", "1.6e-3")
    assert source_digest(["pack.solver"]) != before


def test_moving_a_function_to_another_module_keeps_the_digest(package: Path) -> None:
    definition = "\n\ndef h(a):\n    return a * LENGTH\n"
    (package / "sibling.py").write_text(f"LENGTH = 2.0\n{definition}", encoding="utf-8")
    edit(package / "deep" / "inner.py", "from ..sibling import *\n", "from pack.sibling import h\nH = h\n")
    before = source_digest(["pack.solver"])
    edit(package / "sibling.py", definition, "")
    edit(package / "deep" / "inner.py", "import h\n", f"import LENGTH\n{definition}")
    assert source_digest(["pack.solver"]) == before
    edit(package / "sibling.py", "2.0", "2.5")
    assert source_digest(["pack.solver"]) != before


def test_a_function_of_the_same_name_from_another_distribution_changes_the_digest(package: Path) -> None:
    edit(package / "law.py", "def f", "from scipy.linalg import solve\n\n\ndef f")
    before = source_digest(["pack.solver"])
    edit(package / "law.py", "from scipy.linalg", "from numpy.linalg")
    assert source_digest(["pack.solver"]) != before


def test_a_new_module_that_shadows_nothing_does_not_count_until_it_is_imported(package: Path) -> None:
    before = source_digest(["pack.solver"])
    (package / "more.py").write_text("", encoding="utf-8")
    assert source_digest(["pack.solver"]) == before
    path = package / "law.py"
    path.write_text(path.read_text(encoding="utf-8") + "import pack.more\n", encoding="utf-8")
    assert "pack.more" in import_closure("pack.solver")


def test_unknown_module_is_refused() -> None:
    with pytest.raises(InputError, match=r"source of module 'no_such\.module' can't be found"):
        source_digest(["no_such.module"])
    assert locate("no_such") is None
    assert locate("shellbench.no_such") is None


BASE = 'x = 1\n\n\ndef f(a):\n    """Say."""\n    return "# no comment", a\n'


@pytest.mark.parametrize(
    "prose",
    [
        BASE.replace("Say.", "Say\n    more than that.\n    "),
        BASE.replace("x = 1", "x = 1  # why"),
        BASE.replace("x = 1\n", "# a word\nx = 1\n\n"),
        BASE.replace('    """Say."""\n', ""),
        '"""Module."""\n' + BASE,
        'from shellbench import case\n__all__ = ["f"]\n' + BASE,
        "if TYPE_CHECKING:\n    import pathlib\n" + BASE,
    ],
)
def test_prose_is_no_code(prose: str) -> None:
    assert statements_of(prose) == statements_of(BASE)


@pytest.mark.parametrize(
    "changed",
    [
        BASE.replace("x = 1", "x = 2"),
        BASE.replace("# no comment", "# another"),
        BASE.replace("return", "    return").replace("    return", "if a:\n        return", 1),
        BASE.replace('"""Say."""', '"""Say."""; a += 1'),
        BASE.replace('"# no comment"', '"""\n\n# no comment"""'),
        BASE.replace('"# no comment"', '"""\n# no comment"""'),
        BASE.replace('    """Say."""\n    return', '    t = """Say."""\n    return'),
    ],
)
def test_code_is_code(changed: str) -> None:
    assert statements_of(changed) != statements_of(BASE)


def test_blank_lines_within_a_text_are_code() -> None:
    assert statements_of('x = """a\n\nb"""\n') != statements_of('x = """a\nb"""\n')
    assert statements_of('x = """a  \nb"""\n') != statements_of('x = """a\nb"""\n')


def test_one_line_function_with_a_docstring_is_kept() -> None:
    assert statements_of('def f(): "Say."\n') != statements_of("\n")


def test_solver_counts_with_what_measures_it(plugin: Path) -> None:
    entry = find_solver("toy")
    before = current_source(entry)
    edit(plugin / "toy_shells" / "strip.py", "24", "25")
    assert current_source(entry) != before
    measuring = set(import_closure(module_of("shell"))) | set(import_closure(MEASURING))
    assert {measure.__name__, sampling.__name__, quantities.__name__, MEASURING} <= measuring


def test_version_of_a_plugin_counts(plugin: Path) -> None:
    before = current_source(find_solver("toy"))
    edit(plugin / "toy_shells-1.0.dist-info" / "METADATA", "Version: 1.0", "Version: 1.1")
    assert current_source(find_solver("toy")) != before


def test_own_solvers_count_with_their_own_mechanics_only() -> None:
    fem = set(import_closure(find_solver("fem").module))
    ndf = set(import_closure(find_solver("ndf-ritz").module))
    assert not any(name.startswith("shellbench.solvers.ndf") for name in fem)
    assert not any(name.startswith("shellbench.solvers.fem") for name in ndf)
    assert "shellbench.problems.shell.question.surface" in fem & ndf


def test_the_closure_of_another_package_goes_on_through_ours(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (package / "solver.py").write_text("from shellbench.protocol.spelling import nearest\n", encoding="utf-8")
    assert {"pack.solver", "shellbench.protocol.spelling"} <= import_closure("pack.solver").keys()
    before = source_digest(["pack.solver"])
    changed = package.parent / "nearest.py"
    own = import_closure("pack.solver")["shellbench.protocol.spelling"]
    changed.write_text(own.read_text(encoding="utf-8") + "\nMORE = 1\n", encoding="utf-8")
    found = source.locate
    monkeypatch.setattr(
        source, "locate", lambda name: changed if name == "shellbench.protocol.spelling" else found(name)
    )
    monkeypatch.setattr(source, "_DIGESTS", {})
    assert source_digest(["pack.solver"]) != before


@pytest.mark.parametrize("name", [name for name, entry in solver_entries().items() if entry.own])
def test_the_closure_of_ours_stays_in_our_package(name: str) -> None:
    found = import_closure(find_solver(name).module)
    assert {module.partition(".")[0] for module in found} == {"shellbench"}
