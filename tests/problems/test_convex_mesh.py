"""Obstacles from the corners of a mesh: exact distances, as those of a box, and from any side of any convex body."""

from itertools import product

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial import ConvexHull

from shellbench.problems.obstacle import Box, ConvexMesh

HALF = (0.3, 0.2, 0.5)
PLACES = np.random.default_rng(0).uniform(-1, 1, (5000, 3))


CORNERS = np.array(HALF) * [*product((-1, 1), repeat=3)]
FOUR = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
CLOSED = (0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)


def mesh(corners, triangles=None):
    if triangles is None:
        hull = ConvexHull(corners)
        ways = [np.linalg.det(hull.points[face] - hull.points.mean(0)) for face in hull.simplices]
        triangles = [face if way > 0 else face[::-1] for face, way in zip(hull.simplices, ways, strict=True)]
    return ConvexMesh(
        kind="mesh", centre=(0, 0, 0), corners=np.array(corners).tolist(), triangles=np.array(triangles).tolist()
    )


def test_a_block_is_a_box():
    box, block = Box(kind="box", centre=(0, 0, 0), half_sides=HALF), mesh(CORNERS)
    np.testing.assert_allclose(block.distance(PLACES), box.distance(PLACES), atol=1e-15)
    np.testing.assert_allclose(block.gradient(PLACES), box.gradient(PLACES), atol=1e-13)


def test_distances_lead_to_the_surface_and_have_slope_one():
    body = mesh(np.random.default_rng(1).normal(size=(20, 3)) / 4)
    distance, direction = body.distance(PLACES), body.gradient(PLACES)
    assert (distance < 0).any()
    np.testing.assert_allclose(body.distance(PLACES - distance[:, None] * direction), 0, atol=1e-14)
    step = 1e-6 * np.array([1.0, -2.0, 2.0]) / 3
    slope = (body.distance(PLACES + step) - body.distance(PLACES - step)) / 2e-6
    assert np.quantile(np.abs(slope - direction @ step * 1e6), 0.99) < 1e-5  # all but places at an edge's plane


@pytest.mark.parametrize(
    ("corners", "triangles", "reason"),
    [
        (FOUR, CLOSED[:3], "must close"),
        (FOUR, [face[::-1] for face in CLOSED], "must be convex"),
        (FOUR, [*CLOSED[:3], (1, 2, 4)], "name corners by 0 to 3"),
        ([*FOUR[:3], (1.0, 1.0, 0.0)], CLOSED, "must be convex"),
    ],
)
def test_a_mesh_that_encloses_no_convex_body_is_refused(corners, triangles, reason):
    with pytest.raises(ValidationError, match=reason):
        mesh(corners, triangles)
