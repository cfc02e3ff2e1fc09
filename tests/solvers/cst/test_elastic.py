import numpy as np
import pytest

from shellbench.solvers.cst.mesh import TriangleMesh
from shellbench.solvers.cst.problem import TriangleProblem
from tests.problems.shell.stated_shells import RIM, plate
from tests.solvers.cst.shells import cloth, cylinder

PIN = {"name": "pin", "stiffness": "100*(1 + xi1)", "components": ["x", "z"]}


def problem(case, cells=(5, 4), diagonal="alternating"):
    return TriangleProblem.from_case(case, TriangleMesh(case.surface.domain, cells, diagonal))


def test_an_area_load_that_varies_has_its_force_and_its_moment():
    found = problem(plate(loads=[{"kind": "area", "vector": ["xi1", 0, "2 + xi2*t"]}]))
    force = found.loading.forces(3.0)
    np.testing.assert_allclose(force.sum(axis=0), [1 / 2, 0, 2 + 3 / 2], rtol=1e-12)
    x, y, _ = found.elastic.rest.T
    # the integral of (2 + 3 y) x and of (2 + 3 y) y over the unit square
    np.testing.assert_allclose([force[:, 2] @ x, force[:, 2] @ y], [1 / 2 * (2 + 3 / 2), 2 / 2 + 3 / 3], rtol=1e-12)


@pytest.mark.parametrize("point", [[0.5, 0.5], [0.37, 0.61], [1.0, 0.2]])
def test_a_point_load_keeps_its_force_and_moment_wherever_it_acts(point):
    load = {"kind": "point", "on": ["there"], "force": [1, -2, "3*t"]}
    found = problem(plate(points={"there": point}, loads=[load]))
    force = found.loading.forces(2.0)
    np.testing.assert_allclose(force.sum(axis=0), [1, -2, 6])
    np.testing.assert_allclose(found.elastic.rest[:, :2].T @ force[:, 2], 6 * np.array(point), atol=1e-12)


def test_an_edge_load_is_per_length():
    load = {"kind": "edge", "on": ["xi2_max"], "vector": ["xi1", 0, 1]}
    found = problem(plate(surface={"kind": "plane", "xi1": [0, 3], "xi2": [0, 1]}, loads=[load]))
    force = found.loading.forces(1.0)
    np.testing.assert_allclose(force.sum(axis=0), [9 / 2, 0, 3], rtol=1e-12)
    assert not force[found.elastic.rest[:, 1] < 1 - 1e-9].any()


def test_an_edge_load_on_a_closed_rim_goes_all_around():
    loads = [
        {"kind": "edge", "on": ["xi2_max"], "vector": [0, 1, 0]},
        {"kind": "edge", "on": ["xi2_min"], "vector": [0, -1, 0]},
    ]
    found = problem(cylinder(loads=loads), (12, 4))
    polygon = 2 * 2 * 12 * np.sin(np.pi / 12)
    upper = found.elastic.rest[:, 1] > 2
    assert found.loading.forces(1.0)[upper, 1].sum() == pytest.approx(polygon, rel=1e-12)


def test_pressure_pushes_along_the_normal():
    """a3 = a1 x a2 of this cylinder points inward: (-R sin, 0, R cos) x (0, 1, 0) = -R (cos, 0, sin)."""
    found = problem(cylinder(), (40, 4))
    force, inward = found.loading.forces(1.0), -found.elastic.rest * [1, 0, 1] / 2
    assert np.sum(force * inward) == pytest.approx(2 * np.pi * 2 * 3, rel=5e-3)  # the area of the cylinder


def test_springs_are_lumped_with_their_whole_stiffness():
    found = problem(cloth(springs=[PIN]))
    np.testing.assert_allclose(found.loading.springs.sum(axis=0), [150, 0, 150], rtol=1e-12)


def test_mass_is_that_of_the_flat_triangles():
    assert problem(cloth()).loading.mass.sum() == pytest.approx(0.144, rel=1e-12)


def test_held_and_free_displacements_are_all_there_are():
    found = problem(plate())
    assert len(found.pattern.free) == 3 * (5 - 1) * (4 - 1)
    assert found.supports.held.shape == (6 * 5, 3)
    assert found.supports.held.sum() == 3 * (6 * 5 - 4 * 3)
    assert RIM["name"] == found.case.supports[0].name
