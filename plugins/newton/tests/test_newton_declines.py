"""Cases that newton's cloth declines, and the sentence without the package."""

import sys
from importlib.metadata import PackageNotFoundError

import pytest

import shellbench.protocol.engine
from shellbench.bench.catalogue import catalog
from shellbench.bench.plugins.registry import find_solver, load_solver
from shellbench.errors import InputError


def test_a_missing_engine_names_the_plugin(monkeypatch):
    def absent(name):
        raise PackageNotFoundError(name)

    for name in [name for name in sys.modules if name.startswith("shellbench_newton.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(shellbench.protocol.engine, "version", absent)
    with pytest.raises(InputError) as caught:
        load_solver(find_solver("newton-vbd"))
    assert str(caught.value) == (
        "solver 'newton-vbd' can't be used: newton, warp-lang are not installed: python -m pip install './plugins/newton'"
    )


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("swatch", "does not solve the theory"),
        ("strip_on_edge_1_20", "does not solve the theory"),
        ("cylinder_pull_out", "no plane"),
    ],
)
def test_reasons(case, words):
    pytest.importorskip("newton", reason="needs newton: python -m pip install ./plugins/newton")
    from shellbench_newton.solver import VbdSolver, reason

    problem = catalog.named_case(case)
    found = VbdSolver().declines(problem) if "theory" in words else reason(problem)
    assert words in (found or "")
