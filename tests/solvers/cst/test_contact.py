"""Obstacles by a penalty: what it presses, and how deep."""

import numpy as np
import pytest

from shellbench.errors import InputError
from shellbench.solvers.cst.contact import STIFFNESS, Obstacles
from shellbench.solvers.cst.solver import CstSolver
from tests.problems.shell.stated_shells import plate
from tests.solvers.cst.shells import CLOTH, cloth

RISING = {"kind": "plane", "centre": [0, 0, "t**2 - 0.001"], "normal": [0, 0, 1]}
BALL = {"kind": "sphere", "centre": [0.4, 0.6, -0.31], "radius": 0.3}


def test_flat_cloth_on_a_rising_floor_bears_its_inertia_and_sinks_in_as_told():
    dt = 0.005
    solution = CstSolver().solve(cloth(obstacles=[RISING]), {"cells": (4, 4), "time_step": dt})
    touch, pull = solution.touch(0.1), 9.8 + 2
    np.testing.assert_allclose(touch.forces.sum(axis=0), [0, 0, CLOTH["areal_density"] * pull], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(np.prod(touch.lengths, axis=1).sum(), 1.0)
    depth = pull * dt**2 / STIFFNESS
    np.testing.assert_allclose(solution.displacement([0.3, 0.7], 0.1)[2], 0.1**2 - 0.001 - depth, atol=1e-3 * depth)


def test_forces_are_the_slope_of_the_energy_and_the_tangent_that_of_forces():
    rng = np.random.default_rng(0)
    points = rng.uniform(0.2, 0.6, (20, 2))
    slope = {"kind": "plane", "centre": [0.4, 0.4, -0.8], "normal": [1, 2, 2]}
    for obstacle, down in ((BALL, 0.05), (slope, 0.8)):
        pressing = Obstacles.in_step(cloth(obstacles=[obstacle]), points, np.ones(20), 0.0, 0.1)
        u, way = np.array([0, 0, -down]) + rng.normal(0, 0.02, (20, 3)), rng.normal(size=(20, 3))
        there = [pressing.energy(u + s * 1e-6 * way) for s in (-1, 1)]
        slope = (there[0] - there[1]) / 2e-6
        assert slope == pytest.approx(np.sum(pressing.forces(u) * way), rel=1e-6)
        assert abs(slope) > 1
    change = (pressing.forces(u - 1e-6 * way) - pressing.forces(u + 1e-6 * way)).ravel() / 2e-6
    np.testing.assert_allclose(pressing.tangent(u, np.arange(60)) @ way.ravel(), change, atol=1e-6 * abs(change).max())


def test_a_support_does_not_bear_what_the_obstacle_does():
    """Held at one side and pushed up by the ball: both together carry the weight and what inertia takes."""
    edge = {"name": "edge", "on": ["xi1_min"]}
    case = cloth(until=0.2, supports=[edge], obstacles=[BALL])
    solution = CstSolver().solve(case, {"cells": (6, 6), "time_step": 0.01})
    force, _ = solution.reaction("edge", at=0.2)
    mass = solution.problem.loading.mass
    gained = mass @ (solution._velocities_of_step(20) - solution._velocities_of_step(19)) / 0.01
    pressed = solution.touch(0.2).forces.sum(axis=0)
    np.testing.assert_allclose(force + pressed + [0, 0, -9.8 * mass.sum()], gained, atol=1e-6)
    assert pressed[2] > 0.1


def test_a_vertex_in_a_corner_is_pushed_by_both_sides():
    """Floor and wall: together with gravity they change momentum as the steps do, and the floor bears the weight."""
    wall = {"kind": "plane", "centre": [-0.001, 0, 0], "normal": [1, 0, 0]}
    floor = {"kind": "plane", "centre": [0, 0, -0.001], "normal": [0, 0, 1]}
    loads = [{"kind": "gravity", "acceleration": [-9.8, 0, -9.8]}]
    case = cloth(until=0.12, obstacles=[floor, wall], loads=loads)
    solution = CstSolver().solve(case, {"cells": (4, 4), "time_step": 0.01})
    mass, force = solution.problem.loading.mass, solution.touch(0.12).forces.sum(axis=0)
    gained = mass @ (solution._velocities_of_step(12) - solution._velocities_of_step(11)) / 0.01
    np.testing.assert_allclose(force + mass.sum() * np.array([-9.8, 0, -9.8]), gained, atol=1e-6)
    assert force[2] == pytest.approx(9.8 * CLOTH["areal_density"], rel=1e-3)
    assert force[0] > 1


@pytest.mark.parametrize(("case", "reason"), [
    (plate(obstacles=[{**RISING, "centre": [0, 0, -1]}]), "at rest"),
    (cloth(obstacles=[{**RISING, "friction": 0.3}]), "friction"),
])  # fmt: skip
def test_declines(case, reason):
    assert reason in CstSolver().declines(case)
    with pytest.raises(InputError, match=reason):
        CstSolver().solve(case, {})
