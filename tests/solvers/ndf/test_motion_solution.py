"""A motion between its time steps, and in its file."""

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from shellbench.errors import InputError
from shellbench.problem import FIELDS
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.ndf.motion.integration import RTOL
from shellbench.solvers.ndf.motion.motion_solution import Course, quintic
from shellbench.solvers.ndf.trainer_solver import NdfSolver, TrainerSettings
from tests.alike import alike, same_tensors
from tests.solvers.ndf.test_motion import GRID, PIN, moving, solve

TIMES = (0.0, 0.037, 0.1, 0.153, 0.2)


@pytest.fixture(scope="module")
def swung():
    return solve(moving(springs=[PIN], loads=[{"kind": "gravity", "acceleration": [0, -9.8, 2.0]}]), 36)


def sampled(function, times):
    """The course (1, 1) of a function that returns value, rate and second derivative."""
    rows = [torch.tensor([function(t)[k] for t in times], dtype=torch.float64).view(-1, 1, 1) for k in range(3)]
    return Course(np.asarray(times), *rows)


def test_polynomials_of_the_fifth_degree_are_met_exactly():
    polynomial = np.polynomial.Polynomial([0.3, -1, 2, 0.5, -0.7, 1.1])
    rates = [polynomial.deriv(k) if k else polynomial for k in range(3)]
    course = sampled(lambda t: [rate(t) for rate in rates], [0.0, 0.3, 1.1])
    for t in np.linspace(0, 1.1, 23):
        for order in range(3):
            assert float(course.at(t, order)) == pytest.approx(rates[order](t), abs=1e-12)


def test_interpolation_errs_by_the_sixth_power_of_the_step():
    def sine(t):
        return np.sin(5 * t), 5 * np.cos(5 * t), -25 * np.sin(5 * t)

    errors = []
    for count in (4, 8, 16):
        course = sampled(sine, np.linspace(0, 1, count + 1))
        errors.append(max(abs(float(course.at(t)) - sine(t)[0]) for t in np.linspace(0, 1, 201)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(rates - 6) < 0.5)


def test_weights_of_interpolation_are_those_of_its_conditions():
    for side in (0, 1):
        conditions = np.array([quintic(float(side), order) for order in range(3)])
        expected = np.zeros((3, 6))
        expected[:, 3 * side : 3 * side + 3] = np.eye(3)
        np.testing.assert_allclose(conditions, expected, atol=1e-12)


def test_a_motion_answers_at_any_time_and_is_continuous(swung):
    steps = swung.course.times[1:-1]
    for t in steps[:: max(1, len(steps) // 5)]:
        before, after = (swung.displacement(GRID, t + side * 1e-9) for side in (-1, 1))
        assert np.abs(after - before).max() < 1e-7
        before, after = (swung.velocity(GRID, t + side * 1e-9) for side in (-1, 1))
        assert np.abs(after - before).max() < 1e-6
    for t in (0.041, 0.133):
        difference = (swung.displacement(GRID, t + 1e-5) - swung.displacement(GRID, t - 1e-5)) / 2e-5
        np.testing.assert_allclose(swung.velocity(GRID, t), difference, atol=1e-5)
    assert np.all(swung.displacement(GRID, 0.0) == 0)
    assert np.all(swung.velocity(GRID, 0.0) == 0)


def test_energy_is_conserved_between_steps_as_well(swung):
    """Interpolated states obey Newton's law nearly as well as computed ones."""
    times = swung.course.times
    middle = (times[len(times) // 2] + times[len(times) // 2 + 1]) / 2
    nodes, w = np.polynomial.legendre.leggauss(24)
    points = np.stack(np.meshgrid((nodes + 1) / 2, 0.4 * (nodes + 1), indexing="ij"), axis=-1)
    weights = np.multiply.outer(w, w) * 0.2
    found = swung.balance(float(middle))
    u, v = swung.displacement(points, middle), swung.velocity(points, middle)
    assert found.kinetic == pytest.approx(0.1 * float(np.sum(weights[..., None] * v**2)), rel=1e-6)
    work = 0.2 * float(np.sum(weights[..., None] * u * [0, -9.8, 2.0]))
    assert found.total == pytest.approx(work, rel=1e-4)
    assert swung.energies(float(middle)) == (found.membrane, found.bending)


def test_times_beyond_the_motion_are_refused_in_one_sentence(swung):
    for ask in (
        lambda at: swung.displacement(GRID, at),
        lambda at: swung.velocity(GRID, at),
        lambda at: swung.evaluate("membrane_strain", GRID, at),
        swung.energies,
        lambda at: swung.reaction("none", at=at),
    ):
        for at in (-0.1, 0.21):
            with pytest.raises(InputError) as caught:
                ask(at)
            assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"solved from 0 to 0\.2 s, not at 0\.21 s"):
        swung.displacement(GRID, 0.21)
    with pytest.raises(KeyError):
        swung.evaluate("stress", GRID, 0.1)


def test_a_motion_survives_its_file(swung, tmp_path):
    path = swung.save(tmp_path / "motion")
    back = NdfSolver().load(path)
    same_tensors(back.tensors(), swung.tensors())
    for t in TIMES:
        alike(back.displacement(GRID, t), swung.displacement(GRID, t))
        alike(back.velocity(GRID, t), swung.velocity(GRID, t))
        assert back.energies(t) == pytest.approx(swung.energies(t), rel=1e-12)
    for name in FIELDS:
        alike(back.evaluate(name, GRID, 0.1), swung.evaluate(name, GRID, 0.1))
    assert measure_all(back) == pytest.approx(measure_all(swung), rel=1e-12)
    assert back.history == swung.history
    assert back.diagnostics == swung.diagnostics
    assert back.parameters == swung.parameters
    assert back.storage_bytes == swung.storage_bytes == sum(t.nbytes for t in load_file(path).values())


def test_a_damaged_file_is_told_in_one_sentence(swung, tmp_path):
    path = swung.save(tmp_path / "motion")
    tensors = load_file(path)
    with safe_open(path, framework="pt") as file:
        metadata = file.metadata()
    broken = {
        "not whole": {k: v for k, v in tensors.items() if k != "rates"},
        "do not fit": {**tensors, "output": tensors["output"][1:].clone()},
        "do not increase": {**tensors, "times": tensors["times"].flip(0).contiguous()},
    }
    for reason, kept in broken.items():
        save_file(kept, path, metadata=metadata)
        with pytest.raises(InputError, match=reason) as caught:
            NdfSolver().load(path)
        assert "\n" not in str(caught.value)


def test_a_wrong_mass_and_a_dropped_spring_are_seen():
    """Twice the areal density at the same load takes sqrt(2) of the time; without its spring a napkin falls freely.

    Held against each other at the end, where nothing is interpolated between steps: what is left are the errors of the
    time steps, whose tolerance is `RTOL`. They add up over the motion.
    """
    load, slow = [{"kind": "area", "vector": [0, -2.0, 0]}], np.sqrt(2)
    light = moving(until=0.1, springs=[PIN], loads=load)
    heavy = moving(until=0.1 * slow, material={"areal_density": 0.4}, springs=[PIN], loads=load)
    loose = moving(until=0.1, loads=load)
    first, second, third = (NdfSolver().solve(case, TrainerSettings(widths=(16,))) for case in (light, heavy, loose))
    alike(second.displacement(GRID), first.displacement(GRID), 10 * RTOL)
    alike(slow * second.velocity(GRID), first.velocity(GRID), 10 * RTOL)
    held = first.displacement([0, 0], 0.1)[1] / third.displacement([0, 0], 0.1)[1]
    assert held < 0.5
    np.testing.assert_allclose(third.displacement(GRID, 0.1)[..., 1], -2.0 / 0.2 * 0.1**2 / 2, rtol=1e-9)
