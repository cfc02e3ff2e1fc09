"""Meshes and their grading."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.solvers.fem.mesh.grading import axis_lines, graded_mesh, graded_segment, singular_points
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from tests.solvers.fem.shells import CYLINDER, EVERY_EDGE, MEAN, shell

POINTS = {"a": [1.2, 0.5], "b": [0.3, 0.25]}


def point_load(*names):
    return {"kind": "point", "on": list(names), "force": [0, 0, -1]}


def test_a_smooth_case_has_a_uniform_mesh():
    case = shell(supports=[{"name": "rim", "on": EVERY_EDGE}])
    assert np.allclose(axis_lines(case, 0, 3, 2.0), np.linspace(0, 2, 7))


def test_lines_pass_through_point_loads_and_point_supports_and_shrink_toward_them():
    supports = [{"name": "rim", "on": EVERY_EDGE}, {"name": "pin", "on": ["b"]}]
    case = shell(points=POINTS, supports=supports, loads=[point_load("a")])
    assert singular_points(case) == [(0.3, 0.25), (1.2, 0.5)]
    for axis, marks in ((0, (0.3, 1.2)), (1, (0.25, 0.5))):
        lines = axis_lines(case, axis, 8, 2.0)
        sizes = np.diff(lines)
        assert np.all(sizes > 0)
        for mark in marks:
            (at,) = np.flatnonzero(np.isclose(lines, mark))
            assert sizes[at] < sizes[at + 1] < sizes[at + 2]
            assert sizes[at - 1] < sizes[at - 2]
            assert 0.5 < sizes[at] / sizes[at - 1] < 2  # alike on both sides


def test_quantities_grade_nothing():
    case = catalog.named_case("square_plate")
    assert singular_points(case) == []


def test_both_ends_need_an_even_number():
    assert np.allclose(graded_segment(4, (2.0, 2.0)), [0, 0.125, 0.5, 0.875, 1])
    assert np.allclose(graded_segment(4, (2.0, 3.0)), [0, 0.125, 0.5, 0.9375, 1])  # each end by its own power
    assert np.allclose(graded_segment(2, (1.0, 3.0)), [0, 0.875, 1])
    with pytest.raises(ValueError, match="even"):
        graded_segment(3, (2.0, 2.0))


def test_an_edge_is_graded_without_a_point_on_it():
    case = shell(points=POINTS, supports=[{"name": "rim", "on": EVERY_EDGE}], loads=[point_load("a")])
    lines = axis_lines(case, 0, 8, 2.0, (4.0, 1.0))
    sizes = np.diff(lines)
    assert sizes[0] == pytest.approx(0.6 / 7**4)  # half the way to the point at 1.2, of which 7 cells are the share
    assert np.all(np.diff(sizes[:7]) > 0)
    assert np.all(np.diff(sizes[np.searchsorted(lines, 1.2) :]) > 0)


@pytest.mark.parametrize("angles", [(90, 270), (0, 180), (360, 180), (10, 350)])
def test_a_closed_cylinder_is_graded_across_its_seam(angles):
    case = shell(CYLINDER, points={"p": [angles[0], 1], "q": [angles[1], 1]}, loads=[point_load("p", "q")],
                 quantities=[MEAN], supports=[{"name": "ends", "on": ["xi2_min", "xi2_max"]}])  # fmt: skip
    mesh = graded_mesh(case, (6, 4), 2.0)
    lines = mesh.lines[0]
    assert np.all(np.diff(lines) > 0)
    assert lines[-1] - lines[0] == pytest.approx(2 * np.pi)
    nodes = {mesh.node_at(case.places[name].xi) for name in "pq"}
    assert len(nodes) == 2
    for name in "pq":
        point = mesh.into_period(np.array(case.places[name].xi))
        assert np.isclose(np.abs(lines - point[0]).min(), 0)


def test_closed_meshes_number_their_seam_once():
    domain = shell("torus").surface.domain
    mesh = TensorMesh(domain, (np.linspace(0, 2 * np.pi, 6), np.linspace(0, 2 * np.pi, 5)))
    assert mesh.shape == (5, 4)
    assert np.array_equal(np.bincount(mesh.nodes.ravel()), np.full(20, 4))
    with pytest.raises(ValueError, match="at least"):
        TensorMesh(domain, (np.linspace(0, 2 * np.pi, 4), np.linspace(0, 2 * np.pi, 5)))


def test_points_are_found_in_their_cells():
    domain = shell("cylinder").surface.domain
    mesh = TensorMesh(domain, (0.7 + np.linspace(0, 1, 8) ** 1.5 * 2 * np.pi, np.linspace(0, 3, 4)))
    points = np.random.default_rng(0).uniform(-9, 9, (50, 2))
    points[:, 1] = np.abs(points[:, 1]) / 3
    nodes, unit, sizes = mesh.locate(points)
    assert unit.min() >= 0
    assert unit.max() <= 1
    corner = mesh.node_points[nodes[:, 0]]
    assert np.allclose(domain.wrap(corner + unit * sizes), domain.wrap(points))
    assert np.allclose(mesh.node_scales[:, 0], 1)
