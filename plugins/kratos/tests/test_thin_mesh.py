import numpy as np
import pytest
from shellbench_kratos.thin_mesh import QuadMesh, bilinear

OPEN = QuadMesh((1.0, -1.0), (3.0, 2.0), (False, False), (4, 3))
TUBE = QuadMesh((0.0, 0.0), (2 * np.pi, 1.0), (True, False), (5, 2))


def test_quadrilaterals_run_round_each_cell_so_that_their_normal_is_along_a1_x_a2():
    corners = OPEN.nodes[OPEN.quads]
    diagonals = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    doubled = diagonals[0][:, 0] * diagonals[1][:, 1] - diagonals[0][:, 1] * diagonals[1][:, 0]
    np.testing.assert_allclose(doubled / 2, 2 / 4 * 3 / 3, rtol=1e-12)


def test_a_closed_coordinate_has_no_seam():
    """Nodes, sides and faces of a tube: its Euler number is 0."""
    quads = TUBE.quads
    sides = {frozenset(pair) for q in quads.tolist() for pair in zip(q, q[1:] + q[:1], strict=True)}
    assert TUBE.node_count == len(np.unique(quads)) == 15
    assert TUBE.node_count - len(sides) + len(quads) == 0


@pytest.mark.parametrize("mesh", [OPEN, TUBE, QuadMesh((0.0, 0.0), (1.0, 6.0), (False, True), (2, 4))])
def test_its_nodes_and_cells_are_those_of_the_shared_grid(mesh):
    np.testing.assert_allclose(mesh.grid.nodes, mesh.nodes, atol=1e-14)
    np.testing.assert_array_equal(mesh.grid.cells, mesh.quads)


def test_what_is_bilinear_is_reproduced_everywhere():
    points = np.random.default_rng(3).random((50, 2)) * [2, 3] + [1, -1]
    points = np.concatenate([points, [[3.0, 2.0], [1.0, -1.0], [2.0, 0.0]]])
    quad, places = OPEN.locate(points)

    def function(xi):
        return 1 + 2 * xi[..., 0] - xi[..., 1] + 3 * xi[..., 0] * xi[..., 1]

    nodal = function(OPEN.nodes)[OPEN.quads[quad]]
    np.testing.assert_allclose(np.sum(bilinear(places) * nodal, axis=1), function(points), rtol=1e-12)
