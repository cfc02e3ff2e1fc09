"""Lists of a solver that uses an engine, and of one whose engine is not installed."""

import json
from types import SimpleNamespace

import pytest
from pydantic import Field

from shellbench.bench.catalogue import listing
from shellbench.bench.plugins import outside, registry
from shellbench.bench.plugins.registry import SolverEntry
from shellbench.errors import InputError
from shellbench.problem import Settings
from shellbench.protocol.engine import engine_version, need

VERSION = engine_version("numpy")  # a distribution that is surely installed


class WithEngine(Settings):
    cells: int = 4
    engine: str = Field(default_factory=lambda: engine_version("numpy") or "")


def solver_of(settings):
    offers = SimpleNamespace(label="a shell", theories=("kirchhoff-love-linear",), devices=("cpu",))
    return SimpleNamespace(capabilities=offers, settings_type=settings)


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    def load(entry):
        if entry.name == "stranger":
            try:
                need("strange", ["strange-engine", "stranger-engine"])
            except InputError as error:
                raise InputError(f"solver 'stranger' can't be used: {error}") from error
        return solver_of(WithEngine if entry.name == "guest" else Settings)

    entries = {name: SolverEntry(name, f"{name}:S", "package", "1.0") for name in ("guest", "plain", "stranger")}
    monkeypatch.setattr(listing, "solver_entries", lambda: entries)
    monkeypatch.setattr(outside, "load_solver", load)
    monkeypatch.setattr(registry, "loads_here", lambda entry: True)
    monkeypatch.setattr(listing.catalog, "case_names", tuple)
    monkeypatch.setattr(listing.catalog, "suite_names", tuple)


def solvers():
    return {solver["name"]: solver for solver in json.loads(listing.as_json())["solvers"]}


def test_engine_and_version_are_listed():
    assert solvers()["guest"]["engine"] == VERSION
    assert solvers()["plain"]["engine"] is None
    assert {"name": "engine", "default": VERSION, "description": ""} in solvers()["guest"]["settings"]
    assert "guest (package package), plain (package package)" in listing.overview()


def test_a_missing_extra_is_named():
    found = solvers()["stranger"]
    assert found["available"] is False
    assert found["reason"].endswith(
        "strange-engine, stranger-engine are not installed: python -m pip install 'shellbench[strange]'"
    )
    assert found["reason"] in listing.overview()
