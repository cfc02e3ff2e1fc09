"""The stiffness matrix, against the energy of the field that it stands for."""

import numpy as np
import pytest

from shellbench.solvers.fem.linear.equilibrium import nodal_rigid_motions
from shellbench.solvers.fem.mechanics.assembly import stiffness
from shellbench.solvers.fem.mechanics.solution import FemSolution
from shellbench.solvers.fem.mesh.grading import graded_mesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from tests.solvers.fem.shells import SURFACES, shell


def assembled(name, cells=(3, 3)):
    case = shell(name)
    mesh = graded_mesh(case, cells, 2.0)
    return case, mesh, stiffness(mesh, case.surface, case.material, Quadrature.of_order(mesh, 7))


def field(case, mesh, q):
    coefficients = q.reshape(-1, 3, 4, 1) / mesh.node_scales[:, None, :, None]
    empty = np.zeros(0, dtype=np.int64)
    return FemSolution(case, mesh, coefficients, (1.0,), empty, np.zeros((0, 0, 3, 4, 1)), 7, q.size)


@pytest.mark.parametrize("name", SURFACES)
def test_stiffness_is_the_derivative_of_the_energy(name):
    case, mesh, matrix = assembled(name)
    rng = np.random.default_rng(0)
    u, v = rng.normal(size=(2, mesh.node_count, 12, 1))
    # the energy is quadratic, so that its central difference is exact
    difference = (sum(field(case, mesh, u + v).energies()) - sum(field(case, mesh, u - v).energies())) / 2
    assert np.sum(v * (matrix @ u)) == pytest.approx(difference, rel=1e-9)
    assert np.sum(u * (matrix @ u)) / 2 == pytest.approx(sum(field(case, mesh, u).energies()), rel=1e-12)


@pytest.mark.parametrize("name", SURFACES)
def test_translations_cost_nothing_and_rotations_next_to_nothing(name):
    costs = []
    for n in (4, 8):
        case, mesh, matrix = assembled(name, (n, n))
        motions = nodal_rigid_motions(case, mesh)
        costs.append(np.einsum("ndm,ndm->m", motions, matrix @ motions) / np.abs(matrix.blocks).max())
    assert np.abs(costs[0][:3]).max() < 1e-12
    # a rotation is interpolated; the energy of its error falls with the fourth power of the mesh size at least
    assert np.all(costs[1][3:] <= costs[0][3:] / 14 + 1e-12)


@pytest.mark.parametrize("name", ["plane", "cylinder", "torus"])
def test_blocks_and_sparse_matrix_are_one(name):
    _, mesh, matrix = assembled(name)
    sparse = matrix.to_csr()
    assert abs(sparse - sparse.T).max() <= 1e-14 * abs(sparse).max()
    q = np.random.default_rng(0).normal(size=(mesh.node_count, 12, 2))
    assert np.allclose(sparse @ q.reshape(-1, 2), (matrix @ q).reshape(-1, 2), rtol=1e-12)
    assert np.linalg.eigvalsh(sparse.toarray()).min() >= -1e-12 * abs(sparse).max()


def test_four_gauss_points_a_direction_are_enough():
    case = shell("helicoid")
    mesh = graded_mesh(case, (4, 4), 2.0)
    rules = [stiffness(mesh, case.surface, case.material, Quadrature.of_order(mesh, n)) for n in (7, 15)]
    u = nodal_rigid_motions(shell("helicoid"), mesh)[..., :1] * mesh.node_points[:, :1, None] ** 2
    coarse, fine = (float(np.sum(u * (m @ u))) for m in rules)
    assert coarse == pytest.approx(fine, rel=1e-5)
