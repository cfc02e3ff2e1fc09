"""The scheme in time: figures that follow from its equations, rates of convergence, what a taut tolerance is worth."""

import numpy as np
import pytest

from shellbench.solvers.rope.placing import move_nodes
from shellbench.solvers.rope.stepping import Moving
from tests.solvers.rope.making import hanging, last, scheme, stepper

ONE = np.ones((1, 1))
TIP = np.array([-0.36838401786864, 0.0, -0.82054309163924])  # of nine links, m, after a second: DOP853


@pytest.mark.parametrize(
    ("angle", "ratio"), [(0.1, 0.99998750), (0.5, 0.99221562), (1.0, 0.88073191), (2.0, 0.30116868), (3.0, 5.0270122)]
)
def test_a_step_along_a_circle_changes_the_speed_by_a_known_ratio(angle, ratio):
    """Without weight one step of angle v dt / l; above 2.38 the scheme speeds up."""
    start = Moving(0.0, np.array([[[0.0, 0.0, -1.0]]]), np.array([[[angle, 0.0, 0.0]]]))
    after = stepper(scheme(), ONE, ONE, 0.0).next_state(start)
    assert np.linalg.norm(after.velocities) / angle == pytest.approx(ratio, abs=1e-7)


@pytest.mark.parametrize("angle", [0.01, 0.4, 1.0, 1.5])
def test_a_rotation_goes_the_whole_arc_and_a_projection_its_tangent(angle):
    start, way = np.array([[0.0, 0.0, -1.0]]), np.array([[angle, 0.0, 0.0]])
    for placing, turned in (("rotation", angle), ("projection", np.arctan(angle))):
        x, _, z = move_nodes(start, way, np.zeros((1, 3)), np.ones(1), 1.0, placing)[0]
        assert np.arctan2(x, -z) == pytest.approx(turned, abs=1e-12)
        assert np.hypot(x, z) == pytest.approx(1.0, abs=1e-14)


def test_a_slack_node_goes_straight_until_its_link_is_taut():
    """From the middle of the sphere along x, one and a half lengths: it leaves by the surface, and stays there."""
    at = move_nodes(
        np.array([[0.0, 0.0, -0.6]]), np.array([[1.5, 0.0, 0.0]]), np.zeros((1, 3)), np.ones(1), 1.0, "rotation"
    )
    out = np.array([0.8, -0.6])  # where x^2 + 0.6^2 = 1
    tangent = np.array([0.6, 0.8])
    turned = 1.5 * 0.6 * (1.0 - 0.8 / 1.5)
    assert at[0, ::2] == pytest.approx(np.cos(turned) * out + np.sin(turned) * tangent, abs=1e-12)


def distance(rate, **changes):
    chosen = scheme(**changes)
    made, moving = stepper(chosen, np.full((9, 1), 0.1), np.ones((9, 1)), 9.81, 1 / rate), hanging(30, [0.1] * 9)
    for _ in range(rate):
        moving = made.next_state(moving)
    return float(np.linalg.norm(moving.places[-1, 0] - TIP)) / 0.9


def test_nine_links_at_sixty_hertz_are_within_six_thousandths_of_their_length():
    assert distance(60) < 0.006


def test_sweeps_damp_and_strict_tautness_costs_an_order():
    """Figure 5 of the paper, in figures: one sweep, ten, the direct solve, and the direct solve with a tolerance."""
    one, ten, strict, tolerant = (
        distance(60, solve="sweeps", sweeps=1, taut=0.0),
        distance(60, solve="sweeps", sweeps=10, taut=0.0),
        distance(60, taut=0.0),
        distance(60),
    )
    assert one > 3 * ten > 3 * strict > 30 * tolerant


def slope(errors):
    """Return the order by which errors fall at doubled rates."""
    return np.log2(np.array(errors[:-1]) / errors[1:])


def test_the_tolerance_makes_the_scheme_of_second_order():
    assert slope([distance(rate, taut=0.0) for rate in (60, 120, 240)]) == pytest.approx([1.0, 1.0], abs=0.35)
    assert distance(60) / distance(240) > 2**1.4**2  # from order 1 to 2: errors cross zero, and fall unevenly


def test_a_catch_is_of_first_order():
    """The time of the jerk is a multiple of the step: the error falls with it."""
    x, z = -0.8063767402428518, -0.5914021920784951
    errors = []
    for rate in (60, 240, 960):
        nodes = last("rope_catch", rate, taut=0.0).nodes[1]
        errors.append(float(np.hypot(nodes[0] - x, nodes[2] - z)))
    assert errors == pytest.approx([0.0319, 0.0106, 0.0027], rel=0.05)


def test_one_step_does_not_stretch_any_link():
    random = np.random.default_rng(8)
    moving = Moving(0.0, hanging(20, [0.1] * 9).places, random.normal(size=(9, 1, 3)))
    made = stepper(scheme(), np.full((9, 1), 0.1), random.uniform(0.2, 3, (9, 1)), 9.81, 1 / 60)
    for _ in range(50):
        moving = made.next_state(moving)
        lengths = made.links(moving.places, np.zeros(3))[1]
        assert lengths.max() <= 0.1 * (1 + 1e-14)


def test_chains_beside_each_other_move_as_alone():
    places = np.concatenate([hanging(a, [0.3, 0.2]).places for a in (10, 50)], axis=1)
    both = Moving(0.0, places, np.zeros_like(places))
    made = stepper(scheme(), np.array([[0.3], [0.2]]) + np.zeros((1, 2)), np.ones((2, 2)), 9.81, 0.01)
    alone = stepper(scheme(), np.array([[0.3], [0.2]]), np.ones((2, 1)), 9.81, 0.01)
    singles = [hanging(a, [0.3, 0.2]) for a in (10, 50)]
    for _ in range(20):
        both, singles = made.next_state(both), [alone.next_state(single) for single in singles]
    for number, single in enumerate(singles):
        assert both.places[:, number] == pytest.approx(single.places[:, 0], abs=1e-12)
