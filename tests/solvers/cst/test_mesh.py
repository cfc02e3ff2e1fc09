import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.cst.mesh import TriangleMesh

OPEN = Domain((1.0, -2.0), (4.0, 2.0), (False, False), (False, False))
CLOSED = Domain((0.0, 0.0), (2 * np.pi, 3.0), (True, False), (True, False))
DIAGONALS = ["right", "left", "alternating"]
counts = st.integers(4, 7)


@given(counts, counts, st.sampled_from(DIAGONALS), st.booleans(), st.integers(0, 1000))
def test_every_point_lies_in_the_triangle_that_is_found(n1, n2, diagonal, closed, seed):
    mesh = TriangleMesh(CLOSED if closed else OPEN, (n1, n2), diagonal)
    rng = np.random.default_rng(seed)
    points = np.asarray(mesh.domain.lower) + rng.random((20, 2)) * mesh.domain.size
    triangle, weights = mesh.locate(points)
    assert weights.min() > -1e-12
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    np.testing.assert_allclose(np.einsum("na,nak->nk", weights, mesh.corners[triangle]), points, atol=1e-12)


@pytest.mark.parametrize("diagonal", DIAGONALS)
@pytest.mark.parametrize("domain", [OPEN, CLOSED])
def test_triangles_cover_the_rectangle_once_and_turn_alike(domain, diagonal):
    mesh = TriangleMesh(domain, (5, 4), diagonal)
    first, second = mesh.corners[:, 1] - mesh.corners[:, 0], mesh.corners[:, 2] - mesh.corners[:, 0]
    twice = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    np.testing.assert_allclose(twice, np.prod(domain.size) / 20)
    at_corners = (mesh.corners - np.asarray(domain.lower)) / mesh.steps
    wrapped = (mesh.points[mesh.triangles] - np.asarray(domain.lower)) / mesh.steps
    difference = np.mod(at_corners - wrapped, [5 if domain.periodic[0] else 1000, 1000])
    np.testing.assert_allclose(difference, 0, atol=1e-12)


@pytest.mark.parametrize("diagonal", DIAGONALS)
@pytest.mark.parametrize(("domain", "euler"), [(OPEN, 1), (CLOSED, 0)])
def test_hinges_are_the_interior_edges(domain, euler, diagonal):
    """Euler: vertices - edges + triangles is 1 for a disk and 0 for a cylinder."""
    mesh = TriangleMesh(domain, (6, 4), diagonal)
    vertices, sides = mesh.hinges
    rim = 2 * 6 if domain.periodic[0] else 2 * (6 + 4)
    assert len(vertices) == mesh.vertex_count + len(mesh.triangles) - euler - rim
    for edge, own in zip(vertices, sides, strict=True):
        start, end, left, right = edge
        for opposite, (a, b), triangle in ((left, (start, end), own[0]), (right, (end, start), own[1])):
            corners = list(mesh.triangles[triangle])
            turned = corners[corners.index(opposite) :] + corners[: corners.index(opposite)]
            assert turned == [opposite, a, b]


def test_a_seam_is_one_line_of_vertices():
    mesh = TriangleMesh(CLOSED, (6, 4))
    assert mesh.vertex_at((0.0, 1.5)) == mesh.vertex_at((2 * np.pi, 1.5))
    assert mesh.vertex_count == 6 * 5


def test_a_point_off_the_grid_is_no_vertex():
    mesh = TriangleMesh(OPEN, (6, 4))
    assert mesh.vertex_at((1.5, -2.0)) == 5
    assert mesh.vertex_at((1.6, -2.0)) is None


def test_too_few_cells_around_are_refused():
    with pytest.raises(ValueError, match="at least 4"):
        TriangleMesh(CLOSED, (3, 4))
