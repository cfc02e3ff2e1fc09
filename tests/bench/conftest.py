"""A plug-in with toy solvers, and a catalog with one case of their own."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from shellbench import catalog
from shellbench.bench.store import Store
from tests.bench import strip

PLUGIN = Path(__file__).parent / "plugin"


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the toy plug-in, installed for this test only; tests may edit it."""
    folder = tmp_path / "plugin"
    shutil.copytree(PLUGIN, folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.syspath_prepend(folder)
    yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == "toy_shells"]:
        del sys.modules[name]


@pytest.fixture
def toys(plugin: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A catalog with the strip only; its folder."""
    folder = tmp_path / "catalog"
    (folder / "cases" / "suites").mkdir(parents=True)
    (folder / "references").mkdir()
    (folder / "cases" / "strip.toml").write_text(strip.CASE, encoding="utf-8")
    (folder / "cases" / "suites" / "toys.toml").write_text(strip.SUITE, encoding="utf-8")
    (folder / "references" / "strip.toml").write_text(strip.REFERENCES, encoding="utf-8")
    monkeypatch.setattr(catalog, "data_folder", lambda name: folder / name)
    forget()
    yield folder
    forget()


def forget() -> None:
    """Have the catalog read its files again."""
    for cached in (catalog.named_case, catalog.find_suite, catalog.known_values):
        cached.cache_clear()


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
