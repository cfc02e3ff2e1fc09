"""The direct solvers agree, and refuse what can't be solved in one sentence."""

import sys

import numpy as np
import pytest

from shellbench.errors import InputError, SolveFailure
from shellbench.solvers.fem.algebra import direct_solve
from tests.solvers.fem.test_dissection import random_matrix


def problem(shift=1.0):
    mesh, matrix = random_matrix((9, 7), (True, False), shift)
    return matrix, np.random.default_rng(1).normal(size=(mesh.node_count, 2, 2)), mesh


@pytest.mark.parametrize("method", ["auto", "dissection", "superlu", "pardiso"])
def test_all_methods_solve(method):
    if method == "pardiso":
        pytest.importorskip("pypardiso")
    matrix, right, mesh = problem()
    answer = direct_solve.solve_reduced(matrix, right, mesh, method)
    assert np.allclose(matrix @ answer.unknowns, right, atol=1e-12)
    assert answer.residual < 1e-13


@pytest.mark.parametrize("method", ["dissection", "superlu"])
def test_a_singular_matrix_is_said_to_be_one(method):
    matrix, right, mesh = problem()
    matrix.blocks[...] = 0.0
    with pytest.raises(SolveFailure, match="singular to working precision") as failure:
        direct_solve.solve_reduced(matrix, right, mesh, method)
    assert "\n" not in str(failure.value)


def test_a_bad_residual_is_a_failure(monkeypatch):
    matrix, right, mesh = problem()
    wrong = {**direct_solve._FACTORISATIONS, "auto": lambda *_: lambda f: 0.5 * f}
    monkeypatch.setattr(direct_solve, "_FACTORISATIONS", wrong)
    with pytest.raises(SolveFailure, match="relative residual"):
        direct_solve.solve_reduced(matrix, right, mesh, "auto")


def test_memory_that_does_not_suffice_is_said_in_one_sentence(monkeypatch):
    def exhausted(*_):
        raise MemoryError

    monkeypatch.setattr(direct_solve, "_FACTORISATIONS", {"superlu": exhausted})
    matrix, right, mesh = problem()
    with pytest.raises(SolveFailure, match="does not fit into memory"):
        direct_solve.solve_reduced(matrix, right, mesh, "superlu")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(bad):
    matrix, right, mesh = problem()
    right[3, 1] = bad
    with pytest.raises(SolveFailure, match="not finite"):
        direct_solve.solve_reduced(matrix, right, mesh, "auto")
    matrix, right, mesh = problem()
    matrix.blocks[3, 4] = bad
    with pytest.raises(SolveFailure, match="not finite"):
        direct_solve.solve_reduced(matrix, right, mesh, "auto")


def test_pardiso_is_asked_for_in_vain_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    matrix, right, mesh = problem()
    with pytest.raises(InputError, match="not installed"):
        direct_solve.solve_reduced(matrix, right, mesh, "pardiso")


@pytest.mark.parametrize("stiffer", [(0.1,), (5.0,), tuple(np.linspace(0.1, 3.0, 30))])
def test_what_rounding_makes_of_soft_motions_is_mended_by_the_strains(stiffer, monkeypatch):
    # by their strains some motions are stiffer than by K, or softer: refinement by K goes ever farther, or creeps
    monkeypatch.setattr(direct_solve, "CAREFUL", 0.0)
    matrix, right, mesh = problem()
    given = np.concatenate([right, np.zeros_like(right[..., :1])], axis=-1)  # of which one state has no loads
    motions = np.random.default_rng(2).normal(size=(*right.shape[:2], len(stiffer)))
    energies = np.einsum("nbi,nbj->ij", motions, matrix @ motions)
    motions = np.einsum("nbi,ji->nbj", motions, np.linalg.inv(np.linalg.cholesky(energies)))
    pushed = matrix @ motions

    def product(z):
        along = np.einsum("nbi,nbs->is", pushed, z) * (np.array(stiffer)[:, None] - 1)
        return matrix @ z + np.einsum("nbi,is->nbs", pushed, along)

    careful = direct_solve.StrainSystem(lambda z: given - product(z), product)
    answer = direct_solve.solve_reduced(matrix, given, mesh, "auto", careful)
    assert np.allclose(product(answer.unknowns), given, atol=1e-9)
    assert answer.correction < 1e-9
