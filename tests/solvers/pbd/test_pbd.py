"""Position-based dynamics: what its projections keep, what they converge to, and by which order."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problem import why_declined
from shellbench.problems.rope.case import RopeCase
from shellbench.solvers.pbd.solver import PbdSolver, XpbdSolver, put_right

HANGING = 0.025  # s: six steps
RIGID = -1.0  # softness of the form without compliance


def zigzag(seed, stretched):
    random = np.random.default_rng(seed)
    steps = random.normal(size=(7, 3))
    nodes = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return nodes, np.linalg.norm(steps, axis=1) / stretched, random.uniform(0.2, 3.0, 8)


@pytest.mark.parametrize("softness", [RIGID, 0.0, 0.5])
def test_loose_links_are_put_right_without_moving_the_centre_of_mass_or_turning(softness):
    nodes, lengths, masses = zigzag(1, 1.3)
    moved, pulls = nodes.copy(), np.zeros(7)
    before = np.linalg.norm(np.diff(nodes, axis=0), axis=1) - lengths
    put_right(moved, lengths, 1 / masses, pulls, 1.0, softness)
    change = masses[:, None] * (moved - nodes)
    assert np.abs(change.sum(axis=0)).max() < 1e-13
    odd = nodes.copy()  # links with odd numbers alone turn nothing about the centre: their pushes are along them
    put_right(odd[:2], lengths[:1], 1 / masses[:2], np.zeros(1), 1.0, softness)
    assert np.abs(np.cross(nodes[:2], masses[:2, None] * (odd[:2] - nodes[:2])).sum(axis=0)).max() < 1e-13
    assert np.linalg.norm(np.diff(odd[:2], axis=0)) - lengths[0] < before[0]


def test_many_projections_leave_no_link_too_long_and_do_not_touch_slack_ones():
    nodes, lengths, masses = zigzag(2, 1.2)
    lengths[3] *= 10
    inverse = np.concatenate([[0.0], 1 / masses[1:]])
    pulls = np.zeros(7)
    for _ in range(2000):
        put_right(nodes, lengths, inverse, pulls, 1.0, 0.0)
    assert (np.linalg.norm(np.diff(nodes, axis=0), axis=1) - lengths).max() < 1e-9
    assert pulls[3] == 0
    assert np.abs(nodes[0]).max() < 1e-12  # the root stays


def hung(solver, **settings):
    """Return unequal masses that hang straight down, after a fortieth of a second."""
    data = {key: value for key, value in catalog.named_case("rope_static").data().items() if key != "name"}
    for quantity in data["quantities"]:
        quantity["at"] = HANGING
    return solver().solve(RopeCase.build(data, "hung", "test"), settings)


@pytest.mark.parametrize("solver", [PbdSolver, XpbdSolver])
def test_links_carry_the_weight_below_them(solver):
    solution = hung(solver, substeps=1, iterations=3000, steps_per_second=60.0)
    weights = 9.81 * np.cumsum(solution.case.masses[::-1])[::-1]
    assert solution.state(HANGING).tensions == pytest.approx(weights, rel=1e-6)
    assert np.abs(solution.state(HANGING).velocities).max() < 1e-9


def test_a_mass_bobs_on_its_compliance():
    """One link of compliance a: released at its length it falls by a M g (1 - cos(t / sqrt(a M)))."""
    compliance, period = 1e-3, 2 * np.pi * np.sqrt(1e-3)
    data = {key: value for key, value in catalog.named_case("rope_circle").data().items() if key != "name"}
    data["rope"] = {"link_lengths": [1.0], "masses": [1.0], "angle": 0.0}
    data["quantities"] = [{"name": "z", "kind": "position", "node": 1, "axis": "z", "at": period / 2, "primary": True}]
    case = RopeCase.build(data, "bob", "test")
    falls = [
        -1.0
        - float(
            XpbdSolver().solve(case, {"compliance": compliance, "steps_per_second": rate}).state(period / 2).nodes[1, 2]
        )
        for rate in (1000.0, 4000.0)
    ]
    exact = 2 * compliance * 9.81
    assert abs(falls[1] - exact) < 0.3 * abs(falls[0] - exact)  # of first order
    assert falls[1] == pytest.approx(exact, rel=5e-3)


@pytest.mark.parametrize("solver", [PbdSolver, XpbdSolver])
def test_it_converges_to_the_pendulum_by_the_first_order(solver):
    case, known = catalog.named_case("rope_pendulum"), catalog.known_values("rope_pendulum")
    errors = [
        abs(case.primary.measure(solver().solve(case, {"steps_per_second": rate, "substeps": 1, "iterations": 2}))
            - known.judge(case.primary.name, case.theory).value)
        for rate in (120.0, 240.0, 480.0)
    ]  # fmt: skip
    assert np.log2(errors[:-1] / np.array(errors[1:])) == pytest.approx([1.0, 1.0], abs=0.1)


def test_small_steps_are_better_than_iterations_at_the_same_cost():
    """Macklin et al. (2019): twenty small steps with one projection, or one step with twenty."""
    case, known = catalog.named_case("rope_nine_links"), catalog.known_values("rope_nine_links")
    truth = known.judge("tip_x", case.theory).value
    one, many = (
        abs(case.quantity("tip_x").measure(solver().solve(case, {"steps_per_second": 60.0})) - truth)
        for solver in (PbdSolver, XpbdSolver)
    )
    assert many < one / 3


@pytest.mark.parametrize("solver", [PbdSolver, XpbdSolver])
def test_friction_slides_by_the_first_order_and_sticks(solver):
    case, known = catalog.named_case("rope_incline_slides"), catalog.known_values("rope_incline_slides")
    errors = [
        abs(case.primary.measure(solver().solve(case, {"steps_per_second": rate, "substeps": 1, "iterations": 1}))
            - known.judge(case.primary.name, case.theory).value)
        for rate in (60.0, 120.0)
    ]  # fmt: skip
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.05)
    stays = solver().solve(catalog.named_case("rope_incline_sticks"), {"steps_per_second": 60.0, "substeps": 2})
    assert np.abs(stays.state(1.0).nodes).max() < 1e-12


def test_a_chain_is_laid_over_a_ball():
    data = {key: value for key, value in catalog.named_case("rope_drop").data().items() if key != "name"}
    data["rope"] = {"link_lengths": [0.2] * 4, "masses": [1.0] * 4, "angle": 80.0}
    data["obstacles"] = [{"kind": "sphere", "centre": [0.3, 0.0, -0.5], "radius": 0.3, "friction": 0.2}]
    data["quantities"] = [{"name": "x", "kind": "position", "node": 4, "axis": "x", "at": 0.6, "primary": True}]
    state = XpbdSolver().solve(RopeCase.build(data, "laid", "test"), {"steps_per_second": 60.0}).state(0.6)
    assert state.penetration < 1e-12
    assert state.nodes[4, 0] > 0.3  # without the ball it swings to x < 0
    lengths = np.linalg.norm(np.diff(state.nodes, axis=0), axis=1)
    assert (lengths - 0.2).max() < 0.01


@pytest.mark.parametrize(
    ("name", "words"),
    [("hanging_chain", "in motion only"), ("rope_static", "after a step only"), ("square_plate", "in motion only")],
)  # fmt: skip
def test_it_declines(name, words):
    assert words in why_declined(PbdSolver(), catalog.named_case(name))


def test_a_motion_that_diverges_keeps_what_came_before():
    """A drag that turns the relative velocity round in each step, and makes it larger."""
    data = {key: value for key, value in catalog.named_case("rope_wind").data().items() if key != "name"}
    data["wind"] = data["wind"] | {"drag": 5000.0}
    data["quantities"] = [{"name": "early", "kind": "speed", "node": 1, "at": 0.02}, *data["quantities"]]
    with pytest.raises(SolveFailure, match="diverges at t = ") as failure:
        PbdSolver().solve(RopeCase.build(data, "storm", "test"), {"steps_per_second": 100.0})
    assert len(failure.value.partial.kept) == 1
