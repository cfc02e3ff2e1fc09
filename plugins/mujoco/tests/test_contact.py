"""Cloth that the engine lays on obstacles."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="needs MuJoCo: python -m pip install ./plugins/mujoco")

from shellbench_mujoco.solution import FlexSolution
from shellbench_mujoco.solver import MujocoFlexSolver

from shellbench.problems.shell.question.contact import gaps
from tests.solvers.cst.shells import CLOTH, cloth

SETTINGS = {"cells": (6, 6), "damping": 1e-3}
TOP = -0.002
OBSTACLES = {
    "plane": {"kind": "plane", "centre": [0.5, 0.5, TOP], "normal": [0, 0, 2]},
    "box": {"kind": "box", "centre": [0.5, 0.5, TOP - 0.1], "half_sides": [0.7, 0.8, 0.1]},
    "sphere": {"kind": "sphere", "centre": [0.5, 0.5, TOP - 0.4], "radius": 0.4},
    "capsule": {"kind": "capsule", "centre": [0.5, 0.5, TOP - 0.2], "half_axis": [0.3, 0, 0], "radius": 0.2},
}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_an_obstacle_pushes_along_its_own_normal_and_is_not_entered(kind):
    """Compare with the distance of the case: the cloth would enter an obstacle that is built or turned differently."""
    case = cloth(until=0.15, obstacles=[OBSTACLES[kind]])
    solution = MujocoFlexSolver().solve(case, SETTINGS)
    forces, points = solution.touch(0.15).forces, solution.grid.points
    gap, normal = gaps(case, points, solution.vertices(0.15), 0.15)
    pressed = np.linalg.norm(forces, axis=1) > 1e-3 * np.abs(forces).max()
    assert pressed.sum() >= 3
    assert np.all(gap[pressed] < 0.036)  # triangles touch before their corners: a diagonal's sag on the capsule
    assert gap.min() > -0.01
    assert np.sum(forces * normal) > 0.8 * np.linalg.norm(forces, axis=1).sum()


def test_a_plane_bears_the_weight_of_what_lies_on_it():
    solution = MujocoFlexSolver().solve(cloth(until=0.3, obstacles=[OBSTACLES["plane"]]), SETTINGS)
    force = np.mean([solution.touch(at).forces.sum(axis=0) for at in np.linspace(0.2, 0.3, 13)], axis=0)
    np.testing.assert_allclose(force, [0, 0, 9.8 * CLOTH["areal_density"]], atol=0.02)
    depth = -(solution.displacement([0.4, 0.7], 0.3)[2] - TOP)
    assert -1e-6 < depth < 9.8 * (2 * solution.diagnostics["time_step"]) ** 2  # as hard as it was asked to be


def test_a_tilted_plane_pushes_along_its_own_normal():
    slope = {"kind": "plane", "centre": [0.5, 0.5, -0.352], "normal": [0.3, 0.4, 1]}
    solution = MujocoFlexSolver().solve(cloth(until=0.1, obstacles=[slope]), SETTINGS)
    force = solution.touch(0.1).forces.sum(axis=0)
    np.testing.assert_allclose(force / force[2], [0.3, 0.4, 1], rtol=1e-3)


def test_forces_come_back_from_the_file(tmp_path):
    solution = MujocoFlexSolver().solve(cloth(until=0.05, obstacles=[OBSTACLES["plane"]]), SETTINGS)
    path = solution.save(tmp_path / "flex")
    np.testing.assert_array_equal(FlexSolution.load(path).touch(0.05).forces, solution.touch(0.05).forces)


@pytest.mark.parametrize(("obstacle", "reason"), [
    (OBSTACLES["sphere"] | {"friction": 0.3}, "friction"),
    (OBSTACLES["sphere"] | {"centre": [0.5, 0.5, "-1 - t"]}, "formula of time"),
    ({"kind": "formula", "phi": "z + 1"}, "kind 'formula'"),
])  # fmt: skip
def test_declines(obstacle, reason):
    assert reason in MujocoFlexSolver().declines(cloth(obstacles=[obstacle]))
