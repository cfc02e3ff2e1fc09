"""Cases that MuJoCo's cloth declines or refuses, with the same reasons as other solvers."""

from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="needs MuJoCo: python -m pip install ./plugins/mujoco")

from shellbench_mujoco.solver import MujocoFlexSolver

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from tests.problems.shell.test_solution import CASE

SOLVER = MujocoFlexSolver()


def test_a_solver_without_modes_declines():
    assert "modes" in (SOLVER.declines(catalog.named_case("plate_modes")) or "")


def test_a_start_is_never_ignored():
    with pytest.raises(InputError, match=r"^mujoco-flex can't go on from an earlier solution"):
        SOLVER.solve(CASE, SOLVER.settings_type(), start=Path("earlier.npz"))
