"""The multifrontal factorisation, against SciPy's sparse solver and NumPy's eigenvalues."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.linalg import spsolve

from shellbench.problems.shell.question.surface import Domain
from shellbench.solvers.fem.algebra.block_matrix import NEIGHBOURS, BlockMatrix, neighbour_columns
from shellbench.solvers.fem.algebra.dissection import Dissection
from shellbench.solvers.fem.algebra.factor import NotPositiveDefiniteError, factorise
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from tests.alike import alike

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
    found = factorise(matrix, Dissection.from_shape(mesh.shape, mesh.domain.periodic)).solve(right)
    assert np.allclose(found.reshape(-1, 3), spsolve(matrix.to_csr().tocsc(), right.reshape(-1, 3)), atol=1e-12)


@settings(max_examples=25, deadline=None)
@given(SIDES, SIDES, st.booleans(), st.booleans())
def test_every_node_is_eliminated_once_and_rings_come_later(n1, n2, closed1, closed2):
    dissection = Dissection.from_shape((n1, n2), (closed1, closed2))
    assert np.array_equal(np.sort(dissection.order), np.arange(n1 * n2))
    for part in dissection.parts:
        assert np.all(part.ring >= part.own[1])
        for child in part.children:
            mine = np.concatenate([np.arange(*part.own), part.ring])
            assert np.all(np.isin(dissection.parts[child].ring, mine))


def test_dissection_fills_in_less_than_elimination_line_by_line():
    mesh, matrix = random_matrix((40, 40), (False, False))
    factor = factorise(matrix, Dissection.from_shape(mesh.shape, (False, False)))
    filled = sum(kept.size for kept in (*factor.pivots, *factor.coupling))
    line_by_line = 4 * mesh.node_count * 41  # a band of 41 nodes, blocks of 2 x 2
    assert filled < line_by_line


@pytest.mark.parametrize("shift", [-1.0, 0.0, np.nan])
def test_an_indefinite_or_infinite_matrix_is_refused(shift):
    mesh, matrix = random_matrix((6, 7), (False, False), shift)
    with pytest.raises(NotPositiveDefiniteError):
        factorise(matrix, Dissection.from_shape(mesh.shape, (False, False)))


SHIFTS = st.floats(-1.2, 1.2)  # from negative definite over indefinite to positive definite
SMALL = st.integers(4, 9)


def reduced(mesh, matrix, definiteness="reported"):
    return factorise(matrix, Dissection.from_shape(mesh.shape, mesh.domain.periodic), definiteness)


@settings(max_examples=40, deadline=None)
@given(SMALL, SMALL, st.booleans(), st.booleans(), SHIFTS, st.integers(0, 99))
def test_negative_eigenvalues_are_counted(n1, n2, closed1, closed2, shift, seed):
    mesh, matrix = random_matrix((n1, n2), (closed1, closed2), shift, seed=seed)
    values = np.linalg.eigvalsh(matrix.to_csr().toarray())
    if np.abs(values).min() > 1e-6:  # an eigenvalue that is zero has no sign
        assert reduced(mesh, matrix).negative_count == np.count_nonzero(values < 0)


def test_the_count_covers_every_number_of_negative_eigenvalues():
    """Raising a matrix past one eigenvalue after the other takes one off the count each time."""
    mesh, matrix = random_matrix((5, 4), (False, False), 0.0)
    values = np.linalg.eigvalsh(matrix.to_csr().toarray())
    centre = NEIGHBOURS.index((0, 0))
    for below, (low, high) in enumerate(pairwise(values), start=1):
        blocks = matrix.blocks.copy()
        blocks[:, centre] -= (low + high) / 2 * np.eye(2)
        assert reduced(mesh, BlockMatrix(blocks, matrix.columns)).negative_count == below


@settings(max_examples=25, deadline=None)
@given(SIDES, SIDES, st.booleans(), st.booleans(), st.floats(-1.0, 0.4))
def test_indefinite_systems_are_solved(n1, n2, closed1, closed2, shift):
    mesh, matrix = random_matrix((n1, n2), (closed1, closed2), shift)
    factor = reduced(mesh, matrix)
    true = np.random.default_rng(1).normal(size=(mesh.node_count, 2, 3))
    found = factor.solve(matrix @ true)
    # by the residual: a random matrix may be close to singular
    scale = np.abs(matrix.blocks).max() * max(np.abs(found).max(), 1.0)
    assert np.abs(matrix @ (found - true)).max() <= 1e-9 * scale
    assert np.allclose(
        found.reshape(-1, 3), spsolve(matrix.to_csr().tocsc(), (matrix @ true).reshape(-1, 3)), atol=1e-5
    )


def test_a_definite_matrix_has_no_negative_eigenvalues_and_one_factorisation():
    mesh, matrix = random_matrix((9, 8), (True, False))
    right = np.random.default_rng(1).normal(size=(mesh.node_count, 2, 1))
    answers = [reduced(mesh, matrix, d) for d in ("required", "reported", "imposed")]
    assert [a.negative_count for a in answers] == [0, 0, 0]
    for answer in answers[1:]:
        alike(answer.solve(right), answers[0].solve(right))


@pytest.mark.parametrize("shift", [-1.0, -0.1, 0.1])
def test_imposed_definiteness_makes_any_step_a_descent_and_still_counts(shift):
    mesh, matrix = random_matrix((8, 9), (False, True), shift)
    values = np.linalg.eigvalsh(matrix.to_csr().toarray())
    assert values.min() < 0
    imposed, reported = (reduced(mesh, matrix, d) for d in ("imposed", "reported"))
    assert reported.negative_count == np.count_nonzero(values < 0)
    assert 0 < imposed.negative_count <= mesh.node_count * 2
    rights = np.random.default_rng(2).normal(size=(mesh.node_count, 2, 40))
    assert np.all(np.sum(rights * imposed.solve(rights), axis=(0, 1)) > 0)
    assert np.any(np.sum(rights * reported.solve(rights), axis=(0, 1)) < 0)


@pytest.mark.parametrize("definiteness", ["reported", "imposed"])
@pytest.mark.parametrize("fault", [np.nan, np.inf, 0.0])
def test_a_singular_or_infinite_matrix_is_refused_whatever_its_signs(definiteness, fault):
    mesh, matrix = random_matrix((6, 7), (False, False))
    blocks = matrix.blocks.copy()
    if fault == 0.0:  # a node that nothing holds
        node = 17
        blocks[node] = 0.0
        blocks[matrix.columns == node] = 0.0
    else:
        blocks[17, NEIGHBOURS.index((0, 0)), 0, 0] = fault
    with pytest.raises(NotPositiveDefiniteError):
        reduced(mesh, BlockMatrix(blocks, matrix.columns), definiteness)
