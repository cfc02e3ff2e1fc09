"""A plug-in with toy solvers, and a catalog with one case of their own."""

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.judge.lock import write_lock
from shellbench.bench.plugins import registry
from shellbench.bench.store.store import Store
from tests.bench import strip
from tests.bench.running import run

PLUGIN = Path(__file__).parent / "plugin"
CACHED = (
    "named_case",
    "find_suite",
    "known_values",
    "tolerances",
    "variants_asked",
    "suites_named_by",
    "_headings",
    "_names_in",
)


@contextmanager
def with_plugin(folder: Path) -> Iterator[Path]:
    """Install a copy of the toy plug-in."""
    shutil.copytree(PLUGIN, folder, ignore=shutil.ignore_patterns("__pycache__"))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.setattr(registry, "loads_here", lambda entry: True)  # a process for each copy would take most of the time
        yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == "toy_shells"]:
        del sys.modules[name]


@contextmanager
def with_toys(folder: Path) -> Iterator[Path]:
    """Have a catalog with the strip only."""
    (folder / "cases" / "suites").mkdir(parents=True)
    (folder / "references" / "tolerances").mkdir(parents=True)
    (folder / "cases" / "strip.toml").write_text(strip.CASE, encoding="utf-8")
    (folder / "cases" / "suites" / "toys.toml").write_text(strip.SUITE, encoding="utf-8")
    (folder / "references" / "strip.toml").write_text(strip.REFERENCES, encoding="utf-8")
    for solver, text in strip.TOLERANCES.items():
        (folder / "references" / "tolerances" / f"{solver}.toml").write_text(text, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(catalog, "data_folder", lambda name: folder / name)
        for name in CACHED:  # what was read of our own cases is kept: reading all of them takes long
            patch.setattr(catalog, name, cache(getattr(catalog, name).__wrapped__))
        write_lock()
        forget()
        yield folder


@pytest.fixture
def plugin(tmp_path: Path) -> Iterator[Path]:
    """A copy of the toy plug-in, installed for this test only; tests may edit it."""
    with with_plugin(tmp_path / "plugin") as folder:
        yield folder


@pytest.fixture
def toys(plugin: Path, tmp_path: Path) -> Iterator[Path]:
    """A catalog with the strip only; its folder."""
    with with_toys(tmp_path / "catalog") as folder:
        yield folder


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Stores with the exact run of a toy, and with all runs of the suite: starting solvers takes its time."""
    return make_stores(tmp_path_factory.getbasetemp())


@cache  # modules that import the fixture have one each
def make_stores(temporary: Path) -> tuple[Path, Path]:
    folder = temporary / "made_once"
    with with_plugin(folder / "plugin"), with_toys(folder / "catalog"):
        one, all_runs = Store(folder / "one"), Store(folder / "all")
        run(one, "strip", solvers=("toy",), apart=True)
        shutil.copytree(one.folder, all_runs.folder)
        run(all_runs, suites=("toys",))
    return one.folder, all_runs.folder


@pytest.fixture
def recorded(made_once: tuple[Path, Path], toys: Path, store: Store) -> Store:
    """A store with the exact run of the strip by a toy."""
    shutil.copytree(made_once[0], store.folder)
    return store


@pytest.fixture
def full(made_once: tuple[Path, Path], toys: Path, store: Store) -> Store:
    """A store with all runs of the suite of toys."""
    shutil.copytree(made_once[1], store.folder)
    return store


def forget() -> None:
    """Have the catalog read its files again."""
    for name in CACHED:
        getattr(catalog, name).cache_clear()


def tolerances_of(solver: str) -> Path:
    """The file of what the catalog allows a solver."""
    return catalog.data_folder("references") / "tolerances" / f"{solver}.toml"


@pytest.fixture
def own_case(tmp_path: Path) -> Path:
    """The strip as a user's own file."""
    path = tmp_path / "own_strip.toml"
    path.write_text(strip.CASE, encoding="utf-8")
    return path


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty store."""
    return Store(tmp_path / "runs")
