"""The published boundary functions in motion: where they vanish, their shape, and how they move supports."""

import numpy as np
import pytest

from shellbench.bench.catalogue.catalog import named_case
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.published.published_motion_field import SoftSupports
from tests.solvers.ndf.motions import NAPKIN, SLEEVE, moving
from tests.solvers.ndf.shells import differences, inner_points, support
from tests.solvers.ndf.trainings import small, trained

HERE = Placement()
SIGMA = 0.01  # Kairanda et al. 2023, section 5.2
THETA = 3 * np.pi / 4  # eq. (72)


def turned(name, edge, sign):
    """A rim that turns about y: eq. (72) turns it by theta t, here by theta t^2, which starts from rest."""
    motion = {"kind": "rotation", "axis": [0, 1, 0], "angle": f"{sign * float(np.degrees(THETA))}*t**2"}
    return support(name, edge, clamped=True, motion=motion)


# with x = (R cos xi1, y, R sin xi1) a rotation about +y by an angle takes xi1 to xi1 - angle
TWIST = moving(SLEEVE, supports=[turned("bottom", "xi2_min", 1), turned("top", "xi2_max", -1)])
CORNERS = moving(
    NAPKIN,
    supports=[
        support("left", "xi1_min,xi2_max", motion={"kind": "translation", "vector": ["0.2*t**2", 0, 0]}),
        support("right", "xi1_max,xi2_max", motion={"kind": "translation", "vector": ["-0.2*t**2", 0, 0]}),
    ],
)


def factor(case, points):
    return SoftSupports(case).factor(np.asarray(points, dtype=float).reshape(-1, 2), HERE)[0].numpy()


def test_the_factor_of_a_corner_is_equation_68():
    points = inner_points(CORNERS, 50)
    case = named_case("napkin_corner")
    xi1, xi2 = points.T
    expected = 1 - np.exp(-(xi1**2 + (xi2 - 1) ** 2) / SIGMA)
    np.testing.assert_allclose(factor(case, points), np.repeat(expected[:, None], 3, axis=1), rtol=1e-12)
    assert not np.any(factor(case, [0, 1]))
    assert np.all(factor(case, [[0, 0], [1, 1], [1, 0]]) == 1)


def test_the_factor_of_two_edges_is_equation_70():
    case, points = named_case("napkin_fixed_edges"), inner_points(CORNERS, 50)
    xi1, xi2 = points.T
    expected = (1 - np.exp(-(xi1**2) / SIGMA)) * (1 - np.exp(-(xi2**2) / SIGMA))
    np.testing.assert_allclose(factor(case, points)[:, 0], expected, rtol=1e-12)
    assert not np.any(factor(case, [[0, 0.3], [0.7, 0], [0, 0]]))


def test_a_factor_holds_only_the_components_of_its_support():
    case = moving(NAPKIN, supports=[support("a", "xi1_min", components=["x"]), support("plane", "surface",
                                                                                      components=["z"])])  # fmt: skip
    found = factor(case, [[0, 0.5], [0.1, 0.5], [1, 0.5]])
    np.testing.assert_allclose(found[:, 0], [0, 1 - np.exp(-1), 1], rtol=1e-12)
    assert np.all(found[:, 1] == 1)
    assert np.all(found[:, 2] == 0)


@pytest.mark.parametrize("case", [named_case("napkin_fixed_edges"), CORNERS, TWIST], ids=["edges", "corners", "rims"])
def test_the_derivatives_of_factors_and_motions_are_those_of_their_values(case):
    supports = SoftSupports(case)
    near = np.asarray(case.surface.domain.lower) + inner_points(case, 15) * [1, 0.2]
    for points in (inner_points(case, 15), near):
        jet = differences(lambda xi: supports.factor(xi, HERE)[0].numpy(), points)
        np.testing.assert_allclose(supports.factor(points, HERE), jet, rtol=1e-6, atol=1e-5)
        motion = differences(lambda xi: supports.motion(xi, 0.6, HERE)[0].numpy(), points)
        np.testing.assert_allclose(supports.motion(points, 0.6, HERE)[:6], motion, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("t", [0.0, 1e-4, 0.5, 0.9999, 1.0])
def test_the_velocity_of_a_motion_is_exact_for_polynomials(t):
    points = inner_points(CORNERS, 10)
    xi1, xi2 = points.T
    left, right = (np.exp(-((xi1 - corner) ** 2 + (xi2 - 1) ** 2) / SIGMA) for corner in (0, 1))
    found = SoftSupports(CORNERS).motion(points, t, HERE).numpy()
    np.testing.assert_allclose(found[6, :, 0], 0.4 * t * (left - right), atol=1e-11)
    np.testing.assert_allclose(found[0, :, 0], 0.2 * t**2 * (left - right), atol=1e-15)


def test_the_rims_of_a_twisted_sleeve_turn_against_each_other_as_they_should():
    """Eq. (72) with its first sign repaired: rims at xi1 -+ theta t; as printed the bottom rim is moved by -m."""
    solution = trained(TWIST, small(iterations=1, cells=(3, 3), times=2, dtype="float64"))
    angles, radius = np.linspace(0, 2 * np.pi, 13), 0.25
    for t in (0.3, 1.0):
        for height, sign in ((0.0, -1), (1.0, 1)):
            after = angles + sign * THETA * t**2
            wanted = np.stack([radius * np.cos(after), np.full(13, height), radius * np.sin(after)], axis=-1)
            rim = np.stack([angles, np.full(13, height)], axis=-1)
            found = TWIST.surface.position(rim) + solution.displacement(rim, at=t)
            np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_moved_corners_arrive_where_they_should_and_middles_are_not_carried():
    solution = trained(CORNERS, small(iterations=1, cells=(3, 3), times=2, dtype="float64"))
    np.testing.assert_allclose(solution.displacement([[0, 1], [1, 1]]), [[0.2, 0, 0], [-0.2, 0, 0]], atol=1e-14)
    assert not np.any(np.abs(SoftSupports(CORNERS).motion(np.array([[0.5, 0.5]]), 1.0, HERE).numpy()) > 1e-12)
