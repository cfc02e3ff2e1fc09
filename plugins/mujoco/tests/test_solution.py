"""A motion once it is followed: any time, any point, kept and read again."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="needs MuJoCo: python -m pip install ./plugins/mujoco")

from shellbench_mujoco.solution import FlexSolution
from shellbench_mujoco.solver import FlexSettings, MujocoFlexSolver

from shellbench.errors import InputError
from shellbench.problem import FIELDS
from tests.alike import alike
from tests.solvers.cst.shells import cloth

POINTS = np.random.default_rng(3).random((5, 4, 2))
CORNER = {"name": "corner", "on": ["xi1_min,xi2_max"]}


@pytest.fixture(scope="module")
def swing():
    return MujocoFlexSolver().solve(cloth(until=0.2, supports=[CORNER]), FlexSettings(cells=(6, 6)))


def coarsely(swing, every):
    frames, rates = swing.frames[::every], swing.rates[::every]
    return FlexSolution(swing.grid, swing.until, frames, rates, swing.parameters)


def test_between_frames_of_a_free_fall_it_falls_freely():
    """A parabola is what Hermite's cubic is exact for, and more."""
    answer = MujocoFlexSolver().solve(cloth(until=0.3), FlexSettings(cells=(2, 2), frame_rate=7, time_step=1e-3))
    for t in (0.0, 0.017, 0.123, 0.2999):
        assert np.allclose(answer.displacement(POINTS, at=t), [0, 0, -4.9 * t**2], atol=1e-12)
        assert np.allclose(answer.velocity(POINTS, at=t), [0, 0, -9.8 * t], atol=1e-11)


def test_interpolation_in_time_is_of_fourth_order(swing):
    times = np.linspace(0.05, 0.15, 23)
    fine = np.array([swing.displacement(POINTS, at=t) for t in times])
    gaps = [
        np.abs(np.array([coarsely(swing, every).displacement(POINTS, at=t) for t in times]) - fine).max()
        for every in (8, 4)
    ]
    assert gaps[0] / gaps[1] > 8
    assert gaps[1] < 1e-5


def test_velocity_is_the_derivative_of_the_displacement(swing):
    for t in (0.0513, 0.1, 0.17):
        ahead, behind = (swing.displacement(POINTS, at=t + dt) for dt in (1e-6, -1e-6))
        assert np.allclose(swing.velocity(POINTS, at=t), (ahead - behind) / 2e-6, atol=1e-6)


def test_velocities_at_frames_are_those_of_the_motion_to_second_order(swing):
    """Central differences over frames err by T^2/6 of the third derivative, as measured by wider ones."""
    k = 24
    near = (swing.frames[k + 1] - swing.frames[k - 1]) * 240 / 2
    wide = (swing.frames[k + 2] - swing.frames[k - 2]) * 240 / 4
    assert np.abs(swing.rates[k] - (4 * near - wide) / 3).max() < 0.1 * np.abs(wide - near).max() + 1e-4


def test_between_vertices_it_is_linear_on_each_triangle(swing):
    corners = np.array([[0.0, 0.0], [1 / 6, 0.0], [1 / 6, 1 / 6]])
    weights = np.array([0.2, 0.5, 0.3])
    at_corners = swing.displacement(corners, at=0.11)
    assert np.allclose(swing.displacement(weights @ corners, at=0.11), weights @ at_corners, atol=1e-14)


def test_no_time_beyond_the_motion(swing):
    for t in (-0.01, 0.201):
        with pytest.raises(InputError, match=r"solved from 0 to 0\.2 s"):
            swing.displacement(POINTS, at=t)
    alike(swing.displacement(POINTS), swing.displacement(POINTS, at=0.2))


def test_energies_are_the_integrals_of_their_densities(swing):
    centres = swing.grid.points[swing.grid.triangles].mean(axis=1)
    membrane, bending = swing.energies(0.2)
    areas = swing.grid.areas
    assert areas @ swing.evaluate("membrane_energy_density", centres, at=0.2) == pytest.approx(membrane, rel=1e-12)
    assert areas @ swing.evaluate("bending_energy_density", centres, at=0.2) == pytest.approx(bending, rel=1e-12)
    assert membrane > bending > 0


def test_fields_have_the_shapes_of_the_points(swing):
    for name in FIELDS:
        shape = (5, 4, 3) if "strain" in name else (5, 4)
        values = swing.evaluate(name, POINTS, at=0.1)
        assert values.shape == shape
        alike(swing.evaluate(name, POINTS[1, 2], at=0.1), values[1, 2])
    with pytest.raises(KeyError):
        swing.evaluate("temperature", POINTS)


def test_storage_is_what_displacement_needs(swing, tmp_path):
    assert swing.storage_bytes == 2 * 49 * 49 * 3 * 8  # positions and velocities of 7 x 7 vertices in 49 frames
    assert swing.save(tmp_path / "swing").stat().st_size >= swing.storage_bytes


def test_what_is_kept_is_read_again(swing, tmp_path):
    read = MujocoFlexSolver().load(swing.save(tmp_path / "swing"))
    for t in (0.0, 0.0731, 0.2):
        alike(read.displacement(POINTS, at=t), swing.displacement(POINTS, at=t))
        alike(read.velocity(POINTS, at=t), swing.velocity(POINTS, at=t))
        alike(read.energies(t), swing.energies(t))
    assert read.case.digest() == swing.case.digest()
    assert (read.history, dict(read.diagnostics)) == (swing.history, dict(swing.diagnostics))


def test_files_that_are_none_of_it_are_refused(swing, tmp_path):
    with pytest.raises(InputError, match="can't be read"):
        FlexSolution.load(tmp_path / "absent.npz")
    (tmp_path / "text.npz").write_text("not an archive")
    with pytest.raises(InputError, match="damaged, or not a solution"):
        FlexSolution.load(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", words=np.asarray('{"format": "other"}'), frames=swing.frames, rates=swing.rates)
    with pytest.raises(InputError, match="damaged, or not a solution"):
        FlexSolution.load(tmp_path / "other.npz")


@pytest.mark.parametrize(("kind", "error", "share"), [("float32", 2**-24, 2), ("float16", 2**-11, 4)])
def test_rounding(swing, kind, error, share):
    short, size = swing.rounded(kind)
    assert size == pytest.approx(swing.storage_bytes / share, abs=8)
    largest = np.abs(swing.frames).max()
    assert np.abs(short.frames - swing.frames).max() <= error * largest
    assert np.abs(short.displacement(POINTS, at=0.123) - swing.displacement(POINTS, at=0.123)).max() < 3 * error
    assert swing.rounded("float64")[1] == swing.storage_bytes


def test_reactions_of_supports_that_are_not_there(swing):
    with pytest.raises(InputError, match="no support is called 'wall'"):
        swing.reaction("wall")
