"""Steps in time: their lengths, their stability, and that the engine keeps its warnings to itself."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="needs MuJoCo: python -m pip install ./plugins/mujoco")

from shellbench_mujoco.elasticity import Elasticity
from shellbench_mujoco.grid import Grid, Loading
from shellbench_mujoco.solver import FlexSettings, MujocoFlexSolver
from shellbench_mujoco.solving import Pace, highest_frequency

from shellbench.errors import InputError, SolveFailure
from tests.solvers.cst.shells import cloth

CORNER = {"name": "corner", "on": ["xi1_min,xi2_max"]}
PULL = {"kind": "gravity", "acceleration": [0.1, -0.3, 0.2]}


def limit(case, cells):
    """The longest stable step of leapfrog, from the eigenvalues of the full stiffness matrix at rest."""
    grid = Grid(case, cells)
    elastic, loading = Elasticity(grid), Loading(grid)
    free = ~grid.held
    mass = np.broadcast_to(loading.masses[:, None], free.shape)[free]
    columns = []
    for place in np.argwhere(free):
        step = np.zeros(free.shape)
        step[tuple(place)] = 1e-7
        columns.append((elastic.forces(grid.rest + step) - elastic.forces(grid.rest - step))[free] / 2e-7)
    stiffness = np.array(columns) + np.diag(loading.springs[free])
    return 2 / np.sqrt(np.linalg.eigvals(stiffness / mass[:, None]).real.max())


def test_the_highest_frequency_is_that_of_the_whole_matrix():
    spring = {"name": "s", "stiffness": "2e4*exp(-xi1**2/0.01)"}
    for case in (cloth(supports=[CORNER]), cloth(springs=[spring])):
        grid = Grid(case, (5, 4))
        found = highest_frequency(Elasticity(grid), Loading(grid))
        assert 2 / found == pytest.approx(limit(case, (5, 4)), rel=5e-3)


def test_the_smallest_grids():
    """One free corner of a single cell, which has its two unknowns; and none at all."""
    flat = {"name": "plane", "on": ["surface"], "components": ["z"]}
    sides = [{"name": "sides", "on": ["xi1_min", "xi2_min"], "components": ["x", "y"]}]
    case = cloth(supports=[flat, *sides])
    grid = Grid(case, (1, 1))
    assert 2 / highest_frequency(Elasticity(grid), Loading(grid)) == pytest.approx(limit(case, (1, 1)), rel=1e-6)
    rim = [{"name": "rim", "on": ["xi1_min", "xi1_max"]}]
    with pytest.raises(InputError, match="supports hold all vertices"):
        MujocoFlexSolver().solve(cloth(supports=rim), FlexSettings(cells=(1, 1)))


def test_leapfrog_is_stable_to_its_limit_and_no_further():
    case = cloth(until=1.0, supports=[CORNER], loads=[PULL])
    longest = limit(case, (5, 4))

    def followed(step):
        return MujocoFlexSolver().solve(case, FlexSettings(cells=(5, 4), time_step=step, frame_rate=20))

    assert abs(followed(0.9 * longest).diagnostics["energy_drift"]) < 1e-3
    with pytest.raises(SolveFailure, match=r"steps of 0.0.* s are too long for the integrator Euler"):
        followed(1.15 * longest)


def test_nothing_is_kept_that_has_more_energy_than_loads_have_given():
    """A little beyond the limit a motion grows for many frames before numbers run out."""
    step = 1.03 * limit(cloth(supports=[CORNER]), (5, 4))
    case = cloth(until=400 * step, supports=[CORNER], loads=[PULL])
    settings = FlexSettings(cells=(5, 4), time_step=step, frame_rate=1 / step)
    with pytest.raises(SolveFailure) as caught:
        MujocoFlexSolver().solve(case, settings)
    partial = caught.value.partial
    assert partial is not None
    most_work = 0.144 * np.linalg.norm(PULL["acceleration"]) * np.linalg.norm(partial.frames, axis=-1).max()
    assert max(sum(partial.energies(kept.at)) for kept in partial.history) < 2 * most_work


def test_a_diverging_motion_comes_with_what_was_reached():
    case = cloth(until=1.0, supports=[CORNER])
    with pytest.raises(SolveFailure, match="diverges after") as caught:
        MujocoFlexSolver().solve(case, FlexSettings(cells=(10, 10), time_step=0.006, frame_rate=160))
    partial = caught.value.partial
    assert partial is not None
    assert 0 < partial.until < 1
    assert partial.history[-1].at == partial.until
    fall = 9.8 * partial.until**2 / 2
    assert np.abs(partial.frames).max() < 2 * fall  # nothing of the blow-up is kept


def test_a_motion_that_is_lost_within_a_frame_leaves_nothing_and_writes_no_file(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SolveFailure, match="diverges after 0 s") as caught:
        MujocoFlexSolver().solve(
            cloth(until=1.0, supports=[CORNER]), FlexSettings(cells=(10, 10), time_step=0.01, frame_rate=1)
        )
    assert caught.value.partial is None
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


def test_pace():
    pace = Pace.from_rates(0.5, 240, 0.001)
    assert (pace.frames, pace.steps) == (120, 5)
    assert pace.time_step <= 0.001
    assert pace.time(600) == 0.5
    assert Pace.from_rates(0.1, 1, 1.0).time_step == 0.1
    with pytest.raises(InputError, match="makes more than"):
        Pace.from_rates(1.0, 240, 1e-12)
