import numpy as np
import pytest

from shellbench.solvers.cst.solver import CstSolver
from shellbench.solvers.cst.solving import step_count
from tests.solvers.cst.shells import CLOTH, cloth

EDGE = {"name": "edge", "on": ["xi1_min"]}


def moved(case, **settings):
    return CstSolver().solve(case, {"cells": (4, 4)} | settings)


def test_free_fall_has_the_error_of_backward_euler_and_no_other():
    """v_n = g t_n and u_n = g t_n (t_n + dt)/2 exactly."""
    dt = 0.01
    solution = moved(cloth(until=0.1), time_step=dt)
    for t in (0.03, 0.1):
        np.testing.assert_allclose(solution.displacement([0.3, 0.8], t), [0, 0, -9.8 * t * (t + dt) / 2], atol=1e-12)
        np.testing.assert_allclose(solution.velocity([0.3, 0.8], t), [0, 0, -9.8 * t], atol=1e-11)
    assert sum(solution.energies(0.1)) < 1e-18


def test_between_frames_displacement_and_velocity_are_linear_in_time():
    solution = moved(cloth(until=0.1), time_step=0.01)
    for ask in (solution.displacement, solution.velocity):
        np.testing.assert_allclose(ask([0.5, 0.5], 0.053), 0.7 * ask([0.5, 0.5], 0.05) + 0.3 * ask([0.5, 0.5], 0.06))


def test_energy_never_grows_where_nothing_acts_any_more():
    """A load that ends leaves cloth in motion, which backward Euler can only damp."""
    loads = [{"kind": "area", "vector": [0, 0, "-5*exp(-(t/0.01)**4)"]}]
    solution = moved(cloth(until=0.2, supports=[EDGE], loads=loads), time_step=0.005, diagonal="alternating")
    mass = solution.problem.loading.mass[:, None]

    def energy(t):
        return np.sum(mass * solution._velocities_of_step(round(t / 0.005)) ** 2) / 2 + solution.problem.strain_energy(
            solution.vertices(t)
        )

    late = [energy(0.005 * k) for k in range(8, 41)]
    assert late[0] > 1e-4
    assert np.all(np.diff(late) <= 1e-9 * late[0])
    assert late[-1] < (1 - 1e-3) * late[0]


def test_the_balance_of_energy_in_the_history_is_what_was_lost():
    solution = moved(cloth(until=0.1, supports=[EDGE]), time_step=0.005)
    lost = [step.energy for step in solution.history]
    assert all(step.phase == "time" for step in solution.history)
    assert np.all(np.diff(lost) < 1e-12)
    assert lost[-1] < -1e-5


def test_a_load_in_time_accelerates_by_newtons_law():
    """rho u'' = 6 t from rest gives rho u = t^3; backward Euler comes near it to first order."""
    errors = []
    for n in (20, 40, 80):
        case = cloth(until=0.2, loads=[{"kind": "area", "vector": ["6*t", 0, 0]}])
        u = moved(case, time_step=0.2 / n).displacement([0.5, 0.5])[0]
        errors.append(abs(u * CLOTH["areal_density"] / 0.2**3 - 1))
    assert np.polyfit(np.log([20, 40, 80]), np.log(errors), 1)[0] == pytest.approx(-1, abs=0.05)


@pytest.mark.long
def test_a_spring_swings_at_its_own_frequency():
    """u = g/w^2 (1 - cos w t), w^2 = k/rho, of cloth that is rigid in this motion; first order in the time step."""
    spring = {"name": "bed", "stiffness": 144.0}  # w^2 = 1000 / s^2
    errors = []
    for n in (100, 200, 400):
        u = moved(cloth(until=0.1, springs=[spring]), time_step=0.1 / n).displacement([0.2, 0.9])[2]
        errors.append(abs(u + 9.8 / 1000 * (1 - np.cos(np.sqrt(1000) * 0.1))))
    assert np.polyfit(np.log([100, 200, 400]), np.log(errors), 1)[0] == pytest.approx(-1, abs=0.1)
    assert errors[-1] < 1e-3


def test_a_moving_support_is_followed_exactly_and_its_force_moves_the_mass():
    motion = {"kind": "translation", "vector": ["t**2", 0, 0]}
    hand = {"name": "hand", "on": ["xi1_min", "xi1_max", "xi2_min", "xi2_max"], "motion": motion}
    case = cloth(until=0.1, supports=[hand], loads=[], material=CLOTH | {"youngs_modulus": 1e7})
    solution = moved(case, cells=(2, 2), time_step=0.001)
    np.testing.assert_allclose(solution.displacement([0.0, 0.3], 0.05), [0.0025, 0, 0], atol=1e-14)
    force, _ = solution.reaction("hand", at=0.1)
    np.testing.assert_allclose(force, [0.144 * 2, 0, 0], rtol=2e-2, atol=1e-9)


def test_plane_motion_stays_in_its_plane():
    plane = {"name": "plane", "on": ["surface"], "components": ["z"]}
    pin = {"name": "pin", "stiffness": "2e3*exp(-(xi1**2 + (xi2 - 1)**2)/0.02)"}
    case = cloth(supports=[plane], springs=[pin], loads=[{"kind": "gravity", "acceleration": [0, -9.8, 0]}])
    solution = moved(case, time_step=0.01)
    u = solution.vertices()
    assert not u[:, 2].any()
    assert u[:, 1].min() < -0.02
    assert solution.parameters == 2 * 25


def test_the_number_of_steps_keeps_them_no_longer_than_asked():
    assert step_count(0.5, 1 / 240) == 120
    assert step_count(0.5, 0.3) == 2
