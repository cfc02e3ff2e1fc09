"""MuJoCo's chain: a third origin of nine links, the engine's own forces, and what it declines."""

import numpy as np
import pytest

pytest.importorskip("mujoco")

from shellbench_mujoco.chain_solver import MujocoChainSolver

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.rope.case import RopeCase


def errors(name, **settings):
    case, known = catalog.named_case(name), catalog.known_values(name)
    solution = MujocoChainSolver().solve(case, settings)
    return {q.name: abs(q.measure(solution) - known.judge(q.name, case.theory).value) for q in case.quantities}


def test_it_swings_nine_links_to_the_same_tip():
    """The rate is chosen by its own uncertainty: halving the step of 960 a second changes less than 1e-9 m."""
    found = errors("rope_nine_links", steps_per_second=960.0)
    assert max(found["tip_x"], found["tip_z"]) < 1e-8
    assert found["tension_1"] < 1e-5
    assert found["energy"] < 1e-8


@pytest.mark.parametrize(("integrator", "order"), [("Euler", 1), ("RK4", 4)])
def test_its_rules_have_their_orders(integrator, order):
    coarse, fine = (
        errors("rope_pendulum", integrator=integrator, steps_per_second=rate)["x_1s"] for rate in (60.0, 120.0)
    )
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.3)


def test_links_carry_the_weight_below_them():
    assert max(errors("rope_static").values()) < 1e-12


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("rope_falling_root", "its root moves"),
        ("rope_wind", "wind"),
        ("rope_drop", "slack"),
        ("rope_jerk", "plane"),
        ("rope_ball", "ropes in motion only"),
        ("square_plate", "ropes in motion only"),
    ],
)
def test_it_declines_what_hinges_do_not_know(name, words):
    assert words in MujocoChainSolver().declines(catalog.named_case(name))


def test_a_chain_that_must_push_has_no_answer():
    data = {key: value for key, value in catalog.named_case("rope_static").data().items() if key != "name"}
    upright = RopeCase.build(data | {"rope": data["rope"] | {"angle": 150.0}}, "upright", "test")
    with pytest.raises(SolveFailure, match="lets go"):
        MujocoChainSolver().solve(upright)
