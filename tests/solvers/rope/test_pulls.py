"""Pulls of links: sweeps and the direct solve agree, impulses keep momentum and give no energy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shellbench.solvers.rope import pulls
from shellbench.solvers.rope.stepping import link_vectors
from tests.solvers.rope.making import scheme, stepper

SEEDS = st.integers(0, 2**32 - 1)


def random_chain(seed, links, chains):
    random = np.random.default_rng(seed)
    directions = random.normal(size=(links, chains, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return random, directions, random.uniform(0.2, 3.0, (links, chains))


@given(SEEDS, st.integers(1, 8), st.sampled_from([1, 3, 40]))
@settings(max_examples=30, deadline=None)
def test_sweeps_converge_to_the_direct_solve(seed, links, chains):
    random, directions, masses = random_chain(seed, links, chains)
    taut = random.uniform(size=(links, chains)) < 0.8
    rows = pulls.mass_rows(directions, masses, random.normal(size=(links, chains)), taut)
    found = pulls.direct_pulls(rows)
    for from_tip in (True, False):
        assert pulls.sweep_pulls(rows, None, 1e-14, from_tip=from_tip) == pytest.approx(found, abs=1e-8)
    assert found.min() >= 0
    assert not found[~taut].any()
    assert pulls.shortfall(rows, found)[taut].max(initial=0.0) < 1e-11
    pulling = found > 0
    assert np.abs(pulls.shortfall(rows, found)[pulling]).max(initial=0.0) < 1e-11


@given(SEEDS, st.integers(2, 9))
@settings(max_examples=40, deadline=None)
def test_impulses_keep_momentum_give_no_energy_and_let_nothing_separate(seed, links):
    random, directions, masses = random_chain(seed, links, 1)
    places, velocities = np.cumsum(directions, axis=0), random.normal(size=(links, 1, 3))
    moved = stepper(scheme(), np.ones((links, 1)), masses, 9.81).apply_impulses(places, velocities, *np.zeros((2, 3)))
    change = masses[..., None] * (moved - velocities)
    assert (
        np.linalg.norm(np.cross(change.sum(axis=0), directions[0])) < 1e-11
    )  # all that the root adds is along its link
    assert pulls.dot(change.sum(axis=0), directions[0]).max() <= 1e-13  # and inward
    before, after = ((masses * pulls.dot(v, v)).sum() / 2 for v in (velocities, moved))
    assert after <= before * (1 + 1e-13)
    assert pulls.dot(link_vectors(moved, np.zeros(3)), directions).max() <= 1e-11


def test_a_pull_turns_with_its_chain():
    random, directions, masses = random_chain(5, 6, 2)
    places, velocities = np.cumsum(directions, axis=0), random.normal(size=(6, 2, 3))
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    made = stepper(scheme(), np.ones((6, 2)), masses, 9.81)
    straight = made.apply_impulses(places, velocities, np.zeros(3), np.zeros(3))
    turned = made.apply_impulses(places @ turn, velocities @ turn, np.zeros(3), np.zeros(3))
    assert turned == pytest.approx(straight @ turn, abs=1e-12)


def test_one_sweep_from_the_tip_carries_no_weight_but_that_of_the_first_mass():
    """Not "the weight of all the virtual bones below it", as section 4 has it; 1 % takes 140 sweeps and more."""
    down, right = np.tile([0.0, 0.0, -1.0], (9, 1, 1)), np.array([[9.81]] + [[0.0]] * 8)
    rows = pulls.printed_rows(down, right, np.ones((9, 1), dtype=bool))
    weights = 9.81 * np.arange(9, 0, -1)
    assert pulls.sweep_pulls(rows, 1, 1e-6, from_tip=True)[:, 0] == pytest.approx([9.81] + [0.0] * 8)
    assert pulls.direct_pulls(rows)[:, 0] == pytest.approx(weights, rel=1e-12)
    errors = [
        np.abs(pulls.sweep_pulls(rows, n, 1e-6, from_tip=True)[:, 0] - weights).max() / weights[0]
        for n in (100, 101, 130, 150)
    ]
    assert errors[1] / errors[0] == pytest.approx(np.cos(np.pi / 18) ** 2, rel=1e-9)
    assert errors[3] < 0.01 < errors[2]


def test_chains_are_solved_beside_each_other_as_alone():
    random, directions, masses = random_chain(7, 9, 40)
    rows = pulls.mass_rows(directions, masses, random.normal(size=(9, 40)), np.ones((9, 40), dtype=bool))
    together = pulls.direct_pulls(rows)
    for chain in range(0, 40, 7):
        part = pulls.Rows(
            *(array[:, chain : chain + 1] for array in (rows.diagonal, rows.lower, rows.upper, rows.right, rows.taut))
        )
        assert pulls.direct_pulls(part)[:, 0] == pytest.approx(together[:, chain], abs=1e-11)
