"""The multifrontal factorisation, against SciPy's sparse solver."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import spsolve

from shellbench.fem.assembly import NEIGHBOURS, BlockMatrix, neighbour_columns
from shellbench.fem.dissection import Dissection, NotPositiveDefiniteError, factorise
from shellbench.fem.mesh import TensorMesh
from shellbench.surface import Domain

SIDES = st.integers(4, 17)


def random_matrix(shape, periodic, shift=1.0, block=2, seed=0):
    """Return a symmetric matrix on a mesh with this many nodes, diagonally dominant for a positive shift."""
    domain = Domain((0.0, 0.0), (1.0, 1.0), periodic, (False, False))
    mesh = TensorMesh(domain, tuple(np.linspace(0, 1, n + closed) for n, closed in zip(shape, periodic, strict=True)))
    columns = neighbour_columns(mesh)
    blocks = np.random.default_rng(seed).uniform(-1, 1, (mesh.node_count, 9, block, block))
    for slot, (i, j) in enumerate(NEIGHBOURS):
        back = NEIGHBOURS.index((-i, -j))
        rows = np.flatnonzero(columns[:, slot] >= 0)
        if back > slot:
            blocks[columns[rows, slot], back] = np.swapaxes(blocks[rows, slot], -1, -2)
    blocks[columns < 0] = 0.0
    centre = NEIGHBOURS.index((0, 0))
    blocks[:, centre] += np.swapaxes(blocks[:, centre], -1, -2)
    blocks[:, centre] += shift * 9 * block * np.eye(block)
    return mesh, BlockMatrix(blocks, columns)


@settings(max_examples=25, deadline=None)
@given(SIDES, SIDES, st.booleans(), st.booleans())
def test_it_solves_what_a_sparse_solver_solves(n1, n2, closed1, closed2):
    mesh, matrix = random_matrix((n1, n2), (closed1, closed2))
    right = np.random.default_rng(1).normal(size=(mesh.node_count, 2, 3))
    found = factorise(matrix, Dissection.of(mesh.shape, mesh.domain.periodic)).solve(right)
    assert np.allclose(found.reshape(-1, 3), spsolve(matrix.to_csr().tocsc(), right.reshape(-1, 3)), atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(SIDES, SIDES, st.booleans(), st.booleans())
def test_every_node_is_eliminated_once_and_rings_come_later(n1, n2, closed1, closed2):
    dissection = Dissection.of((n1, n2), (closed1, closed2))
    assert np.array_equal(np.sort(dissection.order), np.arange(n1 * n2))
    for part in dissection.parts:
        assert np.all(part.ring >= part.own[1])
        for child in part.children:
            mine = np.concatenate([np.arange(*part.own), part.ring])
            assert np.all(np.isin(dissection.parts[child].ring, mine))


def test_dissection_fills_in_less_than_elimination_line_by_line():
    mesh, matrix = random_matrix((40, 40), (False, False))
    filled = factorise(matrix, Dissection.of(mesh.shape, (False, False))).nonzeros
    line_by_line = 4 * mesh.node_count * 41  # a band of 41 nodes, blocks of 2 x 2
    assert filled < line_by_line


@pytest.mark.parametrize("shift", [-1.0, 0.0, np.nan])
def test_an_indefinite_or_infinite_matrix_is_refused(shift):
    mesh, matrix = random_matrix((6, 7), (False, False), shift)
    with pytest.raises(NotPositiveDefiniteError):
        factorise(matrix, Dissection.of(mesh.shape, (False, False)))
