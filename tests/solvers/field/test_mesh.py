"""The mesh of `vertex-mesh`: its triangles cover the square, its losses are the limits of structures' losses."""

import numpy as np
import pytest

from shellbench.bench.catalogue import catalog
from shellbench.problems.field.case import Disc, FieldCase
from shellbench.solvers.field.basis import matrix
from shellbench.solvers.field.direct import free_map, pinned_coefficients, span_of
from shellbench.solvers.field.mesh import Lattice, Mesh, Triangulation
from shellbench.solvers.field.mesh_solver import VertexMeshSolver
from shellbench.solvers.field.solver import GridSolver
from shellbench.solvers.field.symmetry import fold_orbits, maps

RANDOM = np.random.default_rng(4)
DRAPE = catalog.named_case("field_drape")


def test_points_lie_in_their_triangles():
    lattice = Lattice.of(8)
    points = np.concatenate([RANDOM.random((200, 2)), [[0, 0], [1, 1], [0, 1], [0.5, 1]]])
    found, shares = lattice.within(points)
    assert shares.min() >= -1e-12
    assert np.einsum("nk,nka->na", shares, lattice.points[lattice.triangles[found]]) == pytest.approx(points, abs=1e-14)


def test_hinges_have_the_bending_limit_of_structures():
    """s^2 (3/4 tr^2 k - 2 det k), inside: hinges across edges of the square are missing."""
    mesh, curvature = Mesh(DRAPE, 104), np.array([[2e-2, 5e-3], [5e-3, -1e-2]])
    places = mesh.rest.copy()
    places[:, 2] = np.einsum("ni,ij,nj->n", mesh.lattice.points, curvature, mesh.lattice.points) / 2
    inside = np.all((mesh.lattice.points > 0.1) & (mesh.lattice.points < 0.9), axis=1)
    mesh.sizes = mesh.sizes * inside[mesh.hinges].all(axis=1)
    exact = 1e-4 * (0.75 * np.trace(curvature) ** 2 - 2 * np.linalg.det(curvature))
    assert mesh.means(places)["bend"] == pytest.approx(exact * mesh.sizes.sum() / 3, rel=2e-3)


def test_slopes_of_the_mesh_are_limits_of_differences():
    mesh = Mesh(DRAPE, 8)
    places = mesh.rest + 0.05 * RANDOM.normal(size=mesh.rest.shape) - [0, 0, 0.1]
    way, step = RANDOM.normal(size=places.shape), 1e-6
    gradient, _ = mesh.slopes(places, convex=False)
    up, down = (mesh.energy(places + sign * step * way) for sign in (1, -1))
    assert np.sum(gradient * way) == pytest.approx((up - down) / (2 * step), rel=1e-6)


def test_unknowns_of_a_grid_are_symmetric_and_meet_the_pinned_point():
    given, start = pinned_coefficients(DRAPE, 6, 3)
    same = maps(DRAPE)
    assert len(same) == 8
    span = free_map(DRAPE, 6, 3, given, start, span_of(9, [0, 1, 2], same))
    field = start + (span @ RANDOM.normal(size=span.shape[1])).reshape(3, -1).T
    at = np.array([[0.2, 0.1], [0.8, 0.1], [0.1, 0.2], [0.5, 0.5]])
    places = matrix(at, 6, 3) @ field
    assert places[1] == pytest.approx(places[0] * [-1, 1, 1], abs=1e-12)
    assert places[2] == pytest.approx(places[0][[1, 0, 2]], abs=1e-12)
    assert places[3] == pytest.approx(0, abs=1e-12)


def test_what_is_not_symmetric_has_no_maps_but_one():
    data = {key: value for key, value in DRAPE.data().items() if key != "name"}
    turned = FieldCase.model_validate(data | {"name": "turned", "body": data["body"] | {"centre": [0.4, 0.55, -0.202]}})
    assert len(maps(turned)) == 1
    points, weights = fold_orbits(RANDOM.random((5, 2)), np.ones(5), maps(turned))
    assert weights.sum() == 5 == len(points)


@pytest.mark.parametrize("disc", [None, Disc(radius=0.4)])
def test_a_turned_lattice_covers_the_cloth_and_has_its_middle(disc):
    lattice = Triangulation.of(16, 22.5, disc)
    sides = lattice.points[lattice.triangles[:, 1:]] - lattice.points[lattice.triangles[:, :1]]
    areas = np.linalg.det(sides) / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(np.pi * disc.radius**2 if disc else 1, rel=5e-3 if disc else 1e-12)
    assert np.linalg.norm(lattice.points - 0.5, axis=1).min() < 1e-15
    points = 0.5 + 0.27 * (2 * RANDOM.random((100, 2)) - 1)
    found, shares = lattice.within(points)
    assert shares.min() >= -1e-12
    assert np.einsum("nk,nka->na", shares, lattice.points[lattice.triangles[found]]) == pytest.approx(points, abs=1e-14)


@pytest.mark.long
def test_folds_of_a_coarse_mesh_turn_with_it_and_those_of_a_grid_prefer_no_edges():
    """The claim of figure 13: the sixth harmonic is largest along the angle of the mesh."""
    case = catalog.named_case("field_folds")
    for turn, own in ((0.0, "six"), (22.5, "six_22"), (45.0, "six_45")):
        found = VertexMeshSolver().solve(case, {"resolution": 24, "turn": turn})
        waves = {quantity.name: quantity.measure(found) for quantity in case.quantities}
        assert max(("six", "six_22", "six_45"), key=waves.get) == own
        assert waves[own] > 0.1
    found = GridSolver().solve(case, {"resolution": 24, "symmetric": False})
    assert max(abs(quantity.measure(found)) for quantity in case.quantities) < 0.01
