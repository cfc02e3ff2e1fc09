"""Sheets whose whole rim is moved by an affine map: the inside follows it, however far the rim goes."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.bench.store.record import Measured
from shellbench.bench.store.settled import why_uncertain
from shellbench.errors import SolveFailure
from shellbench.problems.field.case import FieldCase
from shellbench.solvers.field.mesh_solver import VertexMeshSolver
from shellbench.solvers.field.solver import GridSolver

RIM = ["u_min", "u_max", "v_min", "v_max"]
POINT = (0.2, 0.33)
SOLVERS = [(GridSolver(), {"resolution": 8}), (VertexMeshSolver(), {"resolution": 16})]


def sheet(displacement, confined=("z",)):
    return FieldCase.model_validate(
        {
            "kind": "field", "name": "moved", "title": "", "theory": "local-structures",
            "cloth": {"side": 1e-3, "strain": 5e-3, "confined": confined},
            "pins": [{"on": RIM, "displacement": displacement}],
            "quantities": [
                {"name": "strain", "kind": "strain", "primary": True},
                {"name": "x", "kind": "value", "point": POINT, "axis": "x"},
            ],
        }
    )  # fmt: skip


def solved(case, solver, settings):
    return solver.solve(case, solver.settings_type.model_validate(settings))


@pytest.mark.parametrize(("solver", "settings"), SOLVERS, ids=["grid", "vertex-mesh"])
@pytest.mark.parametrize(
    ("displacement", "gradient"),
    [
        (["-0.02*v", "0.02*u", 0], [[0, -0.02], [0.02, 0]]),
        (["-0.03*u", "-0.03*v", 0], [[-0.03, 0], [0, -0.03]]),
        (["0.1*v", 0, 0], [[0, 0.1], [0, 0]]),
        (["-u-v", "u-v", 0], [[-1, -1], [1, -1]]),
        (["0.1*u", "-0.05*v", 0], [[0.1, 0], [0, -0.05]]),
    ],
    ids=["turned", "pressed", "sheared", "turned by 90 degrees", "stretched and pressed"],
)
def test_a_sheet_follows_its_rim(solver, settings, displacement, gradient):
    """The strain is 3 (|F e| - 1)^2 in the mean over all directions e (eq. 19)."""
    case = sheet(displacement)
    found = solved(case, solver, settings)
    strain, x = (quantity.measure(found) for quantity in case.quantities)
    angles = np.pi * np.arange(1000) / 1000
    edges = (np.eye(2) + gradient) @ np.stack([np.cos(angles), np.sin(angles)])
    true = 3 * np.mean((np.linalg.norm(edges, axis=0) - 1) ** 2)
    assert strain == pytest.approx(true, rel=1e-3, abs=1e-15)
    assert x == pytest.approx(np.dot(gradient[0], POINT), rel=1e-3)
    assert found.uncertainty["x"] <= 1e-3 * abs(x)


@pytest.mark.parametrize(("solver", "settings"), SOLVERS, ids=["grid", "vertex-mesh"])
def test_a_flat_sheet_that_would_buckle_is_no_answer(solver, settings):
    """Pressed together without stiffness in bending it has no least energy in space."""
    with pytest.raises(SolveFailure, match="rests at a saddle of the energy: the sheet would buckle from there"):
        solved(sheet(["-0.03*u", "-0.03*v", 0], confined=()), solver, settings)


def test_a_mesh_that_is_too_coarse_has_not_settled():
    """An answer that states an uncertainty beyond a hundredth is no settled one."""
    case = catalog.named_case("field_drape")
    found = solved(case, VertexMeshSolver(), {"resolution": 8})
    assert found.uncertainty["corner"] > 0.02 * abs(case.primary.measure(found))
    measured = {
        q.name: Measured(value=q.measure(found), uncertainty=found.uncertainty[q.name]) for q in case.quantities
    }
    assert "corner is uncertain by" in why_uncertain(case, "vertex-mesh", False, measured)
