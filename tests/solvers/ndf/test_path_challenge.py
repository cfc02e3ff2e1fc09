"""Error estimates of paths: changes by challengers in one linear solve at a state, and the stated uncertainty."""

from __future__ import annotations

import pytest

from shellbench.bench.catalogue.catalog import known_values, named_case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.ndf.linear.refinement import SAFETY
from shellbench.solvers.ndf.path import large_displacement, path_challenge
from shellbench.solvers.ndf.path.newton import PathState, equilibrium
from shellbench.solvers.ndf.path.path_challenge import Challenge, _share_of_work, challenge_path
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver

NAME = "square_plate_nonlinear"
FEW = RitzSettings(neurons=12, panels=(3, 3))


@pytest.fixture(scope="module")
def coarse():
    """A path of few features, and all that its challenge was given."""
    given = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(large_displacement, "challenge_path", lambda *args: given.append(args) or challenge_path(*args))
        solution = RitzSolver().solve(named_case(NAME), FEW)
    return solution, given[0]


def test_too_few_features_say_how_wrong_they_are(coarse):
    solution, _ = coarse
    for name, value in measure_all(solution).items():
        known = known_values(NAME).judge(name, solution.case.theory).value
        assert abs(value - known) > 1e-3 * abs(known)  # it is wrong indeed
        assert abs(value - known) <= SAFETY * solution.uncertainty[name]
    assert "may be off" in str(solution.unsettled)


def test_one_step_gains_the_energy_that_it_foretells(coarse):
    _, (problem, states, solution, usual, seed, _) = coarse
    challenge = Challenge.of_path(problem, solution.states[-1], usual, seed)
    weights, before = challenge.start(problem, states[-1])
    assert before.bending == pytest.approx(states[-1].deformed.bending, rel=1e-4)  # the state is the path's own
    change, more, _ = challenge.step(weights, before, states[-1].t, held=False)
    assert more == 0
    small = 1e-3  # so far along the step the energy is quadratic: it falls by that of a parabola
    after = challenge.problem.deform(weights + small * change, states[-1].t)
    foretold = float(before.residual @ change) * (small - small**2 / 2)
    assert foretold > 0
    assert before.potential - after.potential == pytest.approx(foretold, rel=1e-4)


def test_a_change_that_is_small_by_accident_is_found(coarse, monkeypatch):
    solution, given = coarse
    monkeypatch.setattr(path_challenge, "measure", lambda solution, q: 0.4)  # nothing seems to change
    planted = challenge_path(*given)
    for name in ("centre_deflection", "largest_displacement"):
        assert planted.uncertainty[name] > 0.1 * solution.uncertainty[name]


def test_the_work_that_loads_do_on_a_step_is_how_the_gain_grows_with_them(coarse):
    """Of small loads it is twice the gain, and the share of work is that of energy; of large ones it is no longer."""
    _, (problem, states, solution, usual, seed, _) = coarse
    challenge = Challenge.of_path(problem, solution.states[-1], usual, seed)

    def at(state):
        weights, deformed = challenge.start(problem, state)
        change, _, _ = challenge.step(weights, deformed, state.t, held=False)
        gained = float(deformed.residual @ change) / 2
        share = _share_of_work(challenge.problem, deformed, change, state.t, gained)
        return gained, share, deformed

    gained, share, deformed = at(equilibrium(problem, PathState.rest(problem), 1e-3))
    assert share == pytest.approx(gained / (deformed.membrane + deformed.bending), rel=1e-3)
    gained, share, deformed = at(states[-1])
    below, _, _ = at(equilibrium(problem, states[-1], 0.98))
    above, _, _ = at(equilibrium(problem, states[-1], 1.02))
    grows = (above - below) / 0.04  # dW and W at a load factor of 1
    assert grows > 2.2 * gained
    assert share * deformed.work == pytest.approx(grows, rel=2e-2)
