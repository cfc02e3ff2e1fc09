"""Collisions: where pushes lead, what a rebound keeps, and how friction errs in print."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.errors import SolveFailure
from shellbench.problems.obstacle import FormulaBody, HalfSpace, Plate, Sphere
from shellbench.problems.rope.case import RopeCase
from shellbench.solvers.rope.contact import collide, entry_share, push_out, rebound
from shellbench.solvers.rope.solver import ExactSolver
from tests.solvers.rope.making import followed_last, last

ORIGIN = (0.0, 0.0, 0.0)
FLOOR = HalfSpace(kind="plane", centre=ORIGIN, normal=(0.0, 0.0, 1.0))
HALF = 0.01  # thickness of a plate, m
PLATE = Plate(kind="plate", centre=ORIGIN, normal=(1.0, 0.0, 0.0), half_thickness=HALF)
OFFSETS = np.array([0.05, 0.2, 0.4, 0.6, 0.8, 0.95])


@pytest.mark.parametrize("pushes", [1, 2, 5])
@pytest.mark.parametrize("incidence", [10, 45, 80])
@pytest.mark.parametrize("floor", [FLOOR, FormulaBody(kind="formula", phi="3*z")], ids=lambda body: body.kind)
def test_reverse_pushes_leave_a_known_depth(floor, pushes, incidence):
    """Each push by the depth, at an angle a to the normal, leaves 1 - cos a of it."""
    a = np.radians(incidence)
    back = 100 * np.array([[np.sin(a), 0.0, np.cos(a)]])
    left = push_out(floor, np.array([[0.0, 0.0, -1.0]]), back, "reverse", pushes)
    assert -left[0, 2] == pytest.approx((1 - np.cos(a)) ** pushes, rel=1e-9, abs=1e-15)


def test_a_push_does_not_go_behind_the_start_of_the_way():
    back = np.array([[0.1, 0.0, 0.05]])
    left = push_out(FLOOR, np.array([[0.0, 0.0, -1.0]]), back, "reverse", 50)
    assert left[0] == pytest.approx([0.1, 0.0, -0.95])


def behind(ratio, push, pushes=1):
    """Return the share of masses that get through a plate, of evenly spread phases of a step."""
    count, step = 3000, ratio * HALF
    places, velocities = np.zeros((count, 3)), np.zeros((count, 3))
    places[:, 0] = -0.1 - step * (1 - (np.arange(count) + 0.5) / count)
    velocities[:, 0] = step
    for _ in range(60):
        met = collide(PLATE, places, places + velocities, velocities, (0.0, 1.0), push, pushes, "gradient")
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
    assert entry_share(ball, start, way) == pytest.approx([0.5, 2.2 / 8, 1.0, 1.0, 0.0], abs=1e-9)


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


BALLS = ("sqrt(x**2 + y**2 + z**2) - 1", "x**2 + y**2 + z**2 - 1")
DESCRIBED = [("rope_ball", BALLS[0]), ("rope_ball", BALLS[1]), ("rope_incline_slides", "0.5*x + 0.75**0.5*z")]


@pytest.mark.parametrize(("name", "formula"), DESCRIBED)
def test_what_a_formula_describes_is_met_as_the_body_itself(name, formula):
    """Ways are followed to the surface, which is exact though the formula be no distance."""
    case = catalog.named_case(name)
    (body,) = case.obstacles
    described = FormulaBody(kind="formula", centre=body.centre, friction=body.friction, phi=formula)
    found, known = followed_last(case.model_copy(update={"obstacles": (described,)}), 8), last(name, 8)
    assert found.nodes == pytest.approx(known.nodes, abs=1e-9)
    assert found.velocities == pytest.approx(known.velocities, abs=1e-9)


def test_where_a_formula_ends_the_motion_fails_with_what_came_before():
    asked = [{"name": f"x_{1000 * at:.0f}", "kind": "position", "node": 0, "axis": "x", "at": at} for at in (0.25, 1.0)]
    data = {
        "kind": "rope", "title": "End", "description": "A formula that ends.", "theory": "rigid-links",
        "particles": {"start": [[0.0, 0.0, 0.0]], "velocity": [1.0, 0.0, 0.0]},
        "obstacles": [{"kind": "formula", "phi": "z + 1 + 0*log(0.5 - x)"}],
        "quantities": [asked[0] | {"primary": True}, asked[1]],
    }  # fmt: skip
    with pytest.raises(SolveFailure, match=r"has no gradient, or no value, at x, y, z = 0\.5") as caught:
        ExactSolver().solve(RopeCase.build(data, "end", "end.toml"), {"steps_per_second": 40.0})
    (state,) = caught.value.partial.kept
    assert state.nodes[0] == pytest.approx([0.25, 0.0, 0.0])


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
