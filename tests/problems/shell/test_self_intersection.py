"""A surface that passes through itself is found where geometry says so, and nothing is found elsewhere."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import linprog

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.kind import SHELL
from shellbench.problems.shell.question.surface import Domain
from shellbench.problems.shell.records import self_intersection
from shellbench.problems.shell.records.self_intersection import (
    crossings,
    lies_over_a_plane,
    sag,
    self_intersection_study,
    triangulated,
    uneven_grid,
)

SQUARE = Domain((0.0, 0.0), (1.0, 1.0), (False, False), (False, False))
TUBE = Domain((0.0, 0.0), (2 * np.pi, 1.0), (True, False), (True, False))
SIZE = (41, 21)


def crossed(domain, position, size=SIZE):
    xi = uneven_grid(domain, size)
    return crossings(position(xi[..., 0], xi[..., 1]).reshape(-1, 3), triangulated(domain, size))


def rolled(angle):
    """Return a strip of unit length that is bent to a spiral of `angle`, whose ends are apart by no radius."""
    return lambda s, w: np.stack([np.sin(angle * s) / angle, w, (1 - np.cos(angle * s)) / angle], axis=-1)


def two_sheets(apart, tilt=0.0):
    """Return a sheet that turns back by a half circle of diameter `apart`; its upper half sinks by `tilt` at its end.

    It lies apart as long as tilt < apart.
    """

    def position(s, w):
        length = 1.0
        turn = np.pi * apart / 2
        t = s * (2 * length + turn)
        back = np.clip(t - length - turn, 0, None)
        phi = np.clip((t - length) / (apart / 2), 0, np.pi)
        x = np.minimum(t, length) + apart / 2 * np.sin(phi) - back
        z = apart / 2 * (1 - np.cos(phi)) - tilt * back / length
        return np.stack([x, w, z], axis=-1)

    return position


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.0])
def test_two_planes_cross_where_they_meet_and_not_before(turn):
    rng = np.random.default_rng(3)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    xi = SQUARE.grid(9, 9)
    one = triangulated(SQUARE, (9, 9))
    flat = np.stack([xi[..., 0], xi[..., 1], 0 * xi[..., 0]], axis=-1).reshape(-1, 3)
    both = np.concatenate([one, one + len(flat)])
    for low, meet in ((-0.51, True), (0.01, False), (-1.01, False)):
        upright = np.stack([0.5 + turn * (xi[..., 0] - 0.5), xi[..., 1], low + xi[..., 0]], axis=-1).reshape(-1, 3)
        pairs = crossings(np.concatenate([flat, upright]) @ frame, both)
        assert (len(pairs) > 0) == meet
        assert np.all(pairs[:, 0] < len(one))
        assert np.all(pairs[:, 1] >= len(one))


def test_crossing_triangles_are_those_through_which_an_edge_passes():
    """Against a linear programme's answer: a point of both triangles, found or not, for random pairs."""
    rng = np.random.default_rng(5)
    triangles = np.array([[0, 1, 2], [3, 4, 5]])
    met = 0
    for _ in range(30):
        points = rng.uniform(-1, 1, (6, 3))
        equal = np.vstack([np.hstack([points[:3].T, -points[3:].T]), [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]])
        common = linprog(np.zeros(6), A_eq=equal, b_eq=[0, 0, 0, 1, 1], bounds=(0, None)).status == 0
        assert (len(crossings(points, triangles)) == 1) == common
        met += common
    assert 5 < met < 25


@pytest.mark.parametrize(("angle", "meets"), [(1.0, False), (0.995 * 2 * np.pi, False), (1.06 * 2 * np.pi, True)])
def test_a_strip_passes_through_itself_from_a_full_turn_on(angle, meets):
    assert (len(crossed(SQUARE, rolled(angle))) > 0) == meets


def test_ends_that_only_meet_do_not_cross():
    assert len(crossed(SQUARE, rolled(2 * np.pi))) == 0


def test_a_closed_surface_does_not_cross_at_its_seam():
    def tube(theta, y):
        return np.stack([np.cos(theta), y, np.sin(theta)], axis=-1)

    def eight(theta, y):
        return np.stack([np.sin(theta), y, np.sin(2 * theta) + 0.1 * y], axis=-1)

    assert len(crossed(TUBE, tube)) == 0
    assert len(crossed(TUBE, eight)) > 0


@pytest.mark.parametrize("apart", [0.2, 0.05])
def test_a_fold_crosses_when_its_upper_half_sinks_through_the_lower_one(apart):
    assert len(crossed(SQUARE, two_sheets(apart), (121, 21))) == 0
    assert len(crossed(SQUARE, two_sheets(apart, tilt=0.9 * apart), (121, 21))) == 0
    assert len(crossed(SQUARE, two_sheets(apart, tilt=1.2 * apart), (121, 21))) > 0


def ramp(turns, rise):
    """Return a flat spiral staircase; over the plane of its steps it lies once, twice where it makes more than a turn."""
    return lambda s, w: np.stack(
        [(1 + w) * np.cos(2 * np.pi * turns * s), (1 + w) * np.sin(2 * np.pi * turns * s), rise * s], axis=-1
    )


@pytest.mark.parametrize(
    ("position", "over"),
    [
        (lambda s, w: np.stack([s, w, 0.3 * np.sin(9 * s) * np.cos(7 * w)], axis=-1), True),
        (lambda s, w: np.stack([s + w**2, w - 0.4 * s**2, 5 * s * w], axis=-1), True),
        (rolled(0.9 * np.pi), True),
        (rolled(1.1 * np.pi), False),
        (ramp(0.95, 0.1), True),
        (ramp(1.05, 0.1), False),
        (ramp(1.05, 0.0), False),
        (two_sheets(0.2), False),
        (lambda s, w: np.stack([s**2, s * (s - 0.5) ** 2, w], axis=-1) * [0, 1, 1], False),
    ],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_sheets_over_a_plane_are_told_from_others(position, over, seed):
    xi = uneven_grid(SQUARE, SIZE)
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]  # some are mirror images
    shape = position(xi[..., 0], xi[..., 1]) @ turn
    assert lies_over_a_plane(shape) == over
    if over:
        assert len(crossings(shape.reshape(-1, 3), triangulated(SQUARE, SIZE))) == 0


def test_the_sag_of_triangles_is_that_of_the_longest_chord():
    """None of a plane, however uneven its grid; 1 - cos(h/2) of a circle of radius one."""
    plane, tube = uneven_grid(SQUARE, SIZE), uneven_grid(TUBE, (101, 21))
    flat = np.stack([plane[..., 0], plane[..., 1], plane[..., 0]], axis=-1)
    assert sag(flat, plane, SQUARE) < 1e-14
    turned = np.stack([np.cos(tube[..., 0]), tube[..., 1], np.sin(tube[..., 0])], axis=-1)
    chord = np.diff(tube[:, 0, 0]).max()
    assert sag(turned, tube, TUBE) == pytest.approx(1 - np.cos(chord / 2), rel=1e-2)


def test_sheets_that_lie_on_each_other_touch_and_do_not_cross():
    assert len(crossed(SQUARE, lambda s, w: np.stack([np.abs(s - 0.5), w, 0 * s], axis=-1))) == 0


@dataclass
class Rolling:
    """The rolled plate of the suites, bent by t times `angle`, and what it was asked for."""

    case: Case
    angle: float
    last: float
    history: tuple = ()

    def displacement(self, points, at=None):
        if at > self.last:
            raise InputError("not reached")
        surface = self.case.surface
        (low, _), (length, _) = surface.domain.lower, surface.domain.size
        angle = self.angle * at
        s = points[..., 0] - low
        bent = np.stack([low + length * np.sin(angle * s / length) / angle, points[..., 1],
                         length * (1 - np.cos(angle * s / length)) / angle], axis=-1)  # fmt: skip
        return bent - surface.position(points)


TURN = 3.9 * np.pi  # a unit of t: a full turn at t = .513


@pytest.fixture
def coarse(monkeypatch):
    monkeypatch.setattr(self_intersection, "POINTS", 2_000)  # quicker


def rolling_case(states):
    case = catalog.named_case("rolled_plate")
    data = case.model_dump(exclude_unset=True) | {"path": {"states": states}}
    return Case.model_validate(data)


@pytest.mark.usefixtures("coarse")
def test_the_first_kept_state_is_told_in_which_a_plate_rolls_through_itself():
    case = rolling_case((0.49, 0.53))
    (found,) = self_intersection_study(Rolling(case, TURN, 1.0), case)
    assert (found.free_until, found.at) == (0.5, 0.53)
    assert "passes through itself at t = 0.53, not yet at t = 0.5" in found.words
    reach = abs(found.places[0][0] - found.places[1][0]) / case.surface.domain.size[0]
    assert reach == pytest.approx(2 * np.pi / (TURN * 0.53), abs=0.03)  # a full turn lies between the two points


@pytest.mark.usefixtures("coarse")
def test_states_that_were_not_reached_are_not_looked_at():
    case = rolling_case((0.49, 0.53))
    (found,) = self_intersection_study(Rolling(case, TURN, 0.51), case)
    assert (found.states, found.free_until, found.at, found.words) == (3, 0.5, None, "")
    assert self_intersection_study(Rolling(case, TURN, 0.1), case) == ()


@pytest.mark.usefixtures("coarse")
def test_triangles_that_are_too_many_to_compare_are_told(monkeypatch):
    monkeypatch.setattr(self_intersection, "MOST_PAIRS", 10_000)
    case = rolling_case((0.49, 0.53))
    (found,) = self_intersection_study(Rolling(case, TURN, 1.0), case)
    assert found.at is None
    assert found.free_until == 0.25  # by a quarter of a turn the strip lies over a plane still
    assert "not known from t = 0.49 on: the surface is stretched" in found.words


def test_a_linear_displacement_has_no_such_state():
    case = catalog.named_case("square_plate")
    assert SHELL.studies["self_intersection"](None, case, {}) == ()
