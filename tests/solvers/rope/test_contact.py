"""Collisions: where pushes lead, what a rebound keeps, and how friction errs in print."""

import numpy as np
import pytest

from shellbench.problems.rope.obstacle import HalfSpace, Plate, Sphere
from shellbench.solvers.rope.contact import collided, entered, pushed, rebound
from tests.solvers.rope.making import last

ORIGIN = (0.0, 0.0, 0.0)
FLOOR = HalfSpace(kind="plane", centre=ORIGIN, normal=(0.0, 0.0, 1.0))
HALF = 0.01  # thickness of a plate, m
PLATE = Plate(kind="plate", centre=ORIGIN, normal=(1.0, 0.0, 0.0), half_thickness=HALF)
OFFSETS = np.array([0.05, 0.2, 0.4, 0.6, 0.8, 0.95])


@pytest.mark.parametrize("pushes", [1, 2, 5])
@pytest.mark.parametrize("incidence", [10, 45, 80])
def test_reverse_pushes_leave_a_known_depth(pushes, incidence):
    """Each push by the depth, at an angle a to the normal, leaves 1 - cos a of it."""
    a = np.radians(incidence)
    back = 100 * np.array([[np.sin(a), 0.0, np.cos(a)]])
    left = pushed(FLOOR, np.array([[0.0, 0.0, -1.0]]), back, "reverse", pushes)
    assert -left[0, 2] == pytest.approx((1 - np.cos(a)) ** pushes, rel=1e-9, abs=1e-15)


def test_a_push_does_not_go_behind_the_start_of_the_way():
    back = np.array([[0.1, 0.0, 0.05]])
    left = pushed(FLOOR, np.array([[0.0, 0.0, -1.0]]), back, "reverse", 50)
    assert left[0] == pytest.approx([0.1, 0.0, -0.95])


def behind(ratio, push, pushes=1):
    """Return the share of masses that get through a plate, of evenly spread phases of a step."""
    count, step = 3000, ratio * HALF
    places, velocities = np.zeros((count, 3)), np.zeros((count, 3))
    places[:, 0] = -0.1 - step * (1 - (np.arange(count) + 0.5) / count)
    velocities[:, 0] = step
    for _ in range(60):
        met = collided(PLATE, places, places + velocities, velocities, (0.0, 1.0), push, pushes, "gradient")
        places, velocities = met.places, met.velocities
    return np.mean(places[:, 0] >= HALF * (1 - 1e-9))


@pytest.mark.parametrize("ratio", [1.2, 1.5, 2.0, 3.0, 5.0])
def test_a_thin_plate_is_passed_by_known_shares(ratio):
    """The ratio is the step over half the thickness. Pushed along the gradient, masses past the middle go through."""
    wrong = (ratio - 1) / ratio if ratio <= 2 else 1 / ratio
    unseen = max(0.0, (ratio - 2) / ratio)
    assert behind(ratio, "gradient") == pytest.approx(wrong + unseen, abs=1e-3)
    assert behind(ratio, "reverse", 50) == pytest.approx(unseen, abs=1e-3)
    assert behind(ratio, "history") == 0


def test_a_way_is_followed_to_where_it_enters():
    ball = Sphere(kind="sphere", centre=ORIGIN, radius=1.0)
    start = np.array([[-3.0, 0.0, 0.0], [-3.0, 0.6, 0.0], [-3.0, 1.1, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    way = np.array([[4.0, 0.0, 0.0], [8.0, 0.0, 0.0], [8.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -0.5, 0.0]])
    assert entered(ball, start, way) == pytest.approx([0.5, 2.2 / 8, 1.0, 1.0, 0.0], abs=1e-9)


def ball(steps, push, normal):
    """Return by how much angles about the ball differ from flying off and from sticking, degrees, and the depth."""
    state = last("rope_ball", steps / 1.5, push=push, normal=normal, resting=False)
    angles = np.degrees(np.arctan2(state.nodes[:, 1], state.nodes[:, 0]))
    cosines = np.sqrt(1 - OFFSETS**2)
    flown = np.degrees(np.arctan2(OFFSETS + cosines**2 * OFFSETS, cosines**3))
    stuck = np.degrees(np.arcsin(OFFSETS))
    return np.abs(angles - flown).max(), np.abs(angles - stuck).max(), state.penetration


def test_figure_7_in_figures():
    """Along the gradient masses fly off, as they must without friction; reversed they stick, 25.64 degrees away."""
    assert ball(1536, "gradient", "gradient")[0] == pytest.approx(0.0098, abs=1e-4)
    reversed_ = ball(768, "reverse", "reverse")
    assert reversed_[0] == pytest.approx(25.64, abs=0.01)
    assert reversed_[1] < 0.1
    assert ball(12, "history", "gradient")[0] < 1e-9
    assert ball(12, "reverse", "reverse")[2] == pytest.approx(0.0254, abs=5e-5)


@pytest.mark.parametrize(("rate", "error"), [(60, 0.0421), (240, 0.0106)])
def test_friction_as_printed_comes_after_the_way(rate, error):
    """Of 1.178 m; where the mass should stick it creeps g sin(a) dt a second."""
    slid = np.linalg.norm(last("rope_incline_slides", rate, push="gradient", resting=False).nodes[0])
    assert slid - 1.1781436 == pytest.approx(error, rel=0.01)
    crept = np.linalg.norm(last("rope_incline_sticks", rate, push="gradient", resting=False).nodes[0])
    assert crept == pytest.approx(9.81 * 0.5 / rate, rel=0.02)


def test_a_rebound_keeps_to_the_cone_and_takes_no_energy_from_nowhere():
    random = np.random.default_rng(3)
    velocities, normals = random.normal(size=(500, 3)), random.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    after = rebound(velocities, np.zeros(3), normals, 0.4)
    along, hit = np.einsum("ik,ik->i", velocities, normals), np.einsum("ik,ik->i", after - velocities, normals)
    assert np.einsum("ik,ik->i", after, normals).min() >= -1e-14
    assert np.array_equal(hit > 1e-14, along < 0)
    sideways = np.linalg.norm(after - velocities - hit[:, None] * normals, axis=1)
    assert np.all(sideways <= 0.4 * hit + 1e-12)
    assert np.all(np.linalg.norm(after, axis=1) <= np.linalg.norm(velocities, axis=1) + 1e-12)


def test_a_rebound_is_seen_from_the_obstacle():
    random = np.random.default_rng(6)
    velocities, body, normal = random.normal(size=(50, 3)), random.normal(size=3), np.tile([0.0, 0.6, 0.8], (50, 1))
    moving = rebound(velocities + body, body, normal, 0.3)
    assert moving == pytest.approx(rebound(velocities, np.zeros(3), normal, 0.3) + body, abs=1e-12)
