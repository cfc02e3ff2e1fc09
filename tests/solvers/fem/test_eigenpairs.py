"""The block Lanczos method of fem: multiple eigenvalues, and rigid motions that are nearly free."""

import numpy as np
import pytest

from shellbench.solvers.fem.algebra.eigenpairs import BLOCK, NotFoundError, largest_eigenpairs

PAIRS = np.repeat(1 / np.arange(1.0, 101.0) ** 2, 2)  # every eigenvalue twice


def found(values, count):
    """Return eigenvalues and vectors of A = 1, B = 1 / values, in a basis that is turned at random."""
    size, random = len(values), np.random.default_rng(1)
    turn, _ = np.linalg.qr(random.normal(size=(size, size)))
    inverse = (turn * values) @ turn.T
    found = largest_eigenpairs(lambda x: x, lambda x: inverse @ x, random.normal(size=(size, BLOCK)), count)
    return found, turn / values @ turn.T


def test_both_copies_of_each_eigenvalue_are_found():
    (values, vectors), b = found(PAIRS, 9)
    assert values == pytest.approx(PAIRS[:9], rel=1e-9)
    assert np.abs(vectors.T @ b @ vectors - np.eye(9)).max() < 1e-6


@pytest.mark.parametrize("ratio", [1e4, 1e7])
def test_a_nearly_free_motion_hides_no_copy(ratio):
    (values, _), _ = found(np.r_[ratio, PAIRS], 10)
    assert values[1:] == pytest.approx(PAIRS[:9], rel=1e-6)


def test_fewer_eigenvalues_above_zero_than_asked_for_are_none():
    with pytest.raises(NotFoundError):
        largest_eigenpairs(lambda x: -x, lambda x: x, np.random.default_rng(0).normal(size=(40, BLOCK)), 2)
