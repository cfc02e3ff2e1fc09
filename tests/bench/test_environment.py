"""The recorded facts about the machine of a run."""

from importlib.metadata import version

import pytest

from shellbench.bench.store import environment as environments
from shellbench.bench.store.environment import engine_distribution, environment


@pytest.mark.parametrize(
    ("settings", "distribution"),
    [
        ({"engine": "mujoco 4.0.0"}, "mujoco"),
        ({"engine": "KratosMultiphysics 10.4.4"}, "KratosMultiphysics"),
        ({"engine": ""}, None),
        ({"engine": None}, None),
        ({"engine": "gelu"}, None),  # a plug-in may call something else its engine
        ({"engine": "fast marching"}, None),
        ({"engine": 3}, None),
        ({}, None),
    ],
)
def test_the_engine_is_read_from_its_setting(settings: dict[str, object], distribution: str | None) -> None:
    assert engine_distribution(settings) == distribution


def test_versions_are_those_of_the_solver_and_its_engine_too() -> None:
    known = environment().versions
    assert "psutil" not in known
    assert "pytest" not in known
    found = environment(distribution="psutil", engine="pytest").versions
    assert found == {**known, "psutil": version("psutil"), "pytest": version("pytest")}
    assert environment(engine="no-such-engine").versions == known


def test_threads_are_those_of_each_run(monkeypatch: pytest.MonkeyPatch) -> None:
    assert environment(threads_each=7).threads == 7
    monkeypatch.setattr(environments, "cores", lambda: 8)
    assert environment().threads == environments.threads() == environments.THREADS
    monkeypatch.setattr(environments, "cores", lambda: 1)
    assert environment().threads == 1
