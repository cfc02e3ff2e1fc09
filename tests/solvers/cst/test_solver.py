import numpy as np
import pytest

from shellbench.bench.plugins import registry
from shellbench.solvers.cst.settings import CstSettings
from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.cst.solving import usual_cells
from tests.alike import alike
from tests.problems.shell.stated_shells import STEEL, plate
from tests.solvers.cst.shells import cloth, cylinder


def test_it_is_found_like_any_solver():
    assert isinstance(registry.load_solver(registry.find_solver("cst-hinge")), CstSolver)


@pytest.mark.parametrize(
    ("surface", "points", "cells"),
    [
        ({"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}, {"centre": [0.5, 0.5]}, (32, 32)),
        ({"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.1]}, {"tip": [1, 0.05]}, (32, 4)),
        ({"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}, {"third": [1 / 3, 0.5]}, (33, 32)),
        ({"kind": "plane", "xi1": [0, 1], "xi2": [0, 1]}, {"nowhere": [1 / np.pi, 0.5]}, (32, 32)),
    ],
)
def test_cells_are_square_and_put_vertices_on_named_points_where_they_can(surface, points, cells):
    assert usual_cells(cloth(surface=surface, points=points)) == cells


def test_a_load_between_vertices_is_felt_where_it_acts():
    """On 33 cells the middle lies within a cell: the answer differs little from that on 32."""
    loads = [{"kind": "point", "on": ["centre"], "force": [0, 0, -1e-3]}]
    even, odd = (
        CstSolver().solve(plate(loads=loads), {"cells": (n, n), "diagonal": "alternating"}).displacement([0.5, 0.5])[2]
        for n in (32, 33)
    )
    assert odd == pytest.approx(even, rel=2e-2)


def test_a_mesh_that_is_turned_gives_the_answer_turned():
    """A plate twice as long as wide, with its coordinates exchanged; exchanging them keeps each diagonal."""
    first = plate(surface={"kind": "plane", "xi1": [0, 2], "xi2": [0, 1]}, points={})
    second = plate(surface={"kind": "plane", "xi1": [0, 1], "xi2": [0, 2]}, points={})
    points = np.random.default_rng(1).random((5, 2)) * [2, 1]
    one = CstSolver().solve(first, {"cells": (8, 5)}).displacement(points)
    other = CstSolver().solve(second, {"cells": (5, 8)}).displacement(points[:, ::-1])
    np.testing.assert_allclose(one[:, 2], other[:, 2], rtol=1e-9)


def test_thickness_and_modulus_scale_the_answer_as_they_must():
    """Bending goes with 1/(E h^3)."""
    thick = STEEL | {"thickness": 0.02, "youngs_modulus": 3e7}
    one, other = (
        CstSolver().solve(plate(material=m), {"cells": (6, 6)}).displacement([0.5, 0.5])[2] for m in (STEEL, thick)
    )
    assert one / other == pytest.approx(3 * 2**3, rel=1e-9)


@pytest.mark.parametrize(
    "bad", [{"diagonal": "both"}, {"time_step": 0}, {"tolerance": -1}, {"cells": [4]}, {"mesh": 3}]
)
def test_settings_that_make_no_sense_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        CstSettings.model_validate(bad)


def test_progress_is_told_step_by_step():
    told = []
    CstSolver().solve(cloth(until=0.05), {"cells": (2, 2), "time_step": 0.01}, progress=told.append)
    assert [p.step for p in told] == [1, 2, 3, 4, 5]
    assert {p.total for p in told} == {5}


def test_the_answer_is_the_same_every_time():
    one, other = (CstSolver().solve(cylinder(), {"cells": (8, 4)}).frames for _ in range(2))
    alike(one, other, 1e-9)
