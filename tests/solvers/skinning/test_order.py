"""Results that do not depend on luck: floors, the order of methods on clips that were not seen, and the loss's effect."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.solvers.skinning import solver

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def found():
    case = catalog.named_case("cape_clips")
    asked = {
        "held-out modes": (solver.FloorSolver, {"of": "held out"}),
        "floor": (solver.FloorSolver, {}),
        "blend": (solver.BlendSolver, {}),
        "bilinear": (solver.BilinearSolver, {}),
        "ridge": (solver.RidgeSolver, {}),
        "network": (solver.NetworkSolver, {"collision": False}),
        "collision": (solver.NetworkSolver, {}),
        "pose": (solver.QuasistaticSolver, {}),
        "chains": (solver.ChainsSolver, {"skin_epochs": 40}),
    }
    made = {name: of().solve(case, settings) for name, (of, settings) in asked.items()}
    values = {name: {q.name: q.measure(one) for q in case.quantities} for name, one in made.items()}
    return case, made["floor"].clips, values


def test_the_floor_is_what_eckart_and_young_say(found):
    case, clips, values = found
    moved = clips.moved[case.held_out]
    left = np.linalg.svd(moved - moved.mean(axis=0), compute_uv=False)[100:]
    vertices = case.cape.rows * case.cape.columns
    assert values["held-out modes"]["error"] == pytest.approx(
        np.sqrt((left**2).sum() / len(moved) / vertices), rel=1e-6
    )


def test_methods_come_in_their_order(found):
    """The nearest two differ by a third; another seed moves a network by a twentieth."""
    errors = {name: each["error"] for name, each in found[2].items()}
    assert errors["held-out modes"] < 0.1 * errors["floor"]
    assert max(errors["blend"], errors["bilinear"], errors["floor"]) < errors["ridge"]
    assert errors["ridge"] < errors["network"] < errors["collision"] < errors["chains"] < errors["pose"]


def test_the_collision_loss_keeps_vertices_out(found):
    assert found[2]["collision"]["inside"] < 0.5 * found[2]["network"]["inside"]
    assert found[2]["collision"]["inside"] < 0.01
    assert found[2]["network"]["inside"] > 0.02


def test_units_infer_bones_that_are_far_off_on_motions_that_are_new(found):
    """Figure 14. The mesh on top does not jitter less than its bones, other than figure 13 says; that is not tested."""
    assert found[2]["chains"]["bone_error"] > 0.05
    assert found[2]["network"]["bone_error"] == 0
