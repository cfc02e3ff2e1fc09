"""Without the engine, or with one that is too old, the solver says so in one sentence."""

import sys
from importlib.metadata import PackageNotFoundError

import pytest

import shellbench.protocol.engine
from shellbench.bench.plugins.registry import find_solver, load_solver
from shellbench.errors import InputError


@pytest.fixture
def not_yet_imported(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("shellbench_mujoco.")]:
        monkeypatch.delitem(sys.modules, name)


@pytest.mark.usefixtures("not_yet_imported")
def test_a_missing_engine_names_the_plugin(monkeypatch):
    def absent(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(shellbench.protocol.engine, "version", absent)
    with pytest.raises(InputError) as caught:
        load_solver(find_solver("mujoco-flex"))
    assert str(caught.value) == (
        "solver 'mujoco-flex' can't be used: mujoco is not installed: python -m pip install './plugins/mujoco'"
    )


@pytest.mark.usefixtures("not_yet_imported")
def test_an_old_engine_is_refused(monkeypatch):
    monkeypatch.setattr(shellbench.protocol.engine, "version", lambda name: "3.14.0")
    monkeypatch.setattr("importlib.metadata.version", lambda name: "3.14.0")
    with pytest.raises(InputError, match=r"mujoco 3.14.0 is too old.*pip install 'mujoco>=4'"):
        load_solver(find_solver("mujoco-flex"))
