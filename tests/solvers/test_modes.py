"""Modes by both mechanics: coarse and quick, by properties."""

import math

import numpy as np
import pytest

from shellbench.bench import catalog
from shellbench.solvers.fem.solver import FemSolver
from shellbench.solvers.ndf.ritz_solver import RitzSolver


@pytest.mark.long
@pytest.mark.parametrize(("solver", "settings"), [(FemSolver(), {"cells": (4, 4)}), (RitzSolver(), {"neurons": 60})])
def test_a_file_keeps_modes_and_shapes(solver, settings, tmp_path):
    case = catalog.named_case("plate_modes")
    found = solver.solve(case, settings)
    kept = solver.load(found.save(tmp_path / "modes"))
    points = case.surface.domain.grid(5, 5)
    assert kept.mode_values == found.mode_values
    assert np.abs(kept.displacement(points, at=3.0) - found.displacement(points, at=3.0)).max() < 1e-12
    # the second mode has two half waves along the plate: odd about its middle
    one, other = found.displacement(np.array([[0.75, 1.0], [2.25, 1.0]]), at=2.0)[:, 2]
    assert one == pytest.approx(-other, rel=1e-3)
    assert found.mode_values[1] == pytest.approx(
        math.pi / 2 * (1 / 9 + 1 / 4) * math.sqrt(2e5 / 12 / 0.91 / 80), rel=1e-4
    )
