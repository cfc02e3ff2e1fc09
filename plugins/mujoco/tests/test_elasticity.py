"""The energy of a flex agrees with the engine's forces and with the theory."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="needs MuJoCo: python -m pip install ./plugins/mujoco")

import mujoco
from shellbench_mujoco.elasticity import Elasticity
from shellbench_mujoco.grid import Grid, Loading
from shellbench_mujoco.solving import Cloth

from shellbench.problems.shell.question.loads import PointLoad
from tests.solvers.cst.shells import CLOTH, cloth

E, NU, H = CLOTH["youngs_modulus"], CLOTH["poissons_ratio"], CLOTH["thickness"]
D, B = E * H / (1 - NU**2), E * H**3 / 12 / (1 - NU**2)


def elasticity(cells=(6, 4), **changes):
    return Elasticity(Grid(cloth(**changes), cells))


def shaken(grid, size=0.02):
    return size * np.random.default_rng(1).standard_normal(grid.rest.shape)


@pytest.mark.parametrize("factor", [1.0, 400.0])
def test_the_engines_forces_are_the_derivative_of_this_energy(factor):
    grid = Grid(cloth(material=CLOTH | {"bending_factor": factor}), (6, 4))
    model = Cloth.from_grid(grid, Loading(grid), "Euler", 1e-3, 0.0)
    displacement = shaken(grid)
    model.data.qpos[:] = displacement.ravel()
    mujoco.mj_forward(model.model, model.data)
    forces = Elasticity(grid).forces(grid.rest + displacement)
    assert np.abs(model.data.qfrc_passive.reshape(-1, 3) + forces).max() < 1e-11 * np.abs(forces).max()
    bending = np.abs(forces - Elasticity(Grid(cloth(), (6, 4))).forces(grid.rest + displacement)).max()
    assert (bending > 0) == (factor > 1)


def test_forces_are_the_derivative_of_the_energies():
    elastic = elasticity()
    positions, direction = elastic.grid.rest + shaken(elastic.grid), shaken(elastic.grid, 1.0)
    ahead, behind = (sum(elastic.energies(positions + step * direction)) for step in (1e-6, -1e-6))
    assert np.sum(elastic.forces(positions) * direction) == pytest.approx((ahead - behind) / 2e-6, rel=1e-6)


@pytest.mark.parametrize("gradient", [[[0.1, 0.0], [0.0, 0.0]], [[0.0, 0.2], [0.0, -0.1]], [[0.05, -0.3], [0.2, 0.1]]])
def test_a_uniform_stretch_has_the_energy_of_a_membrane_of_stiffness_d(gradient):
    elastic, f = elasticity(), np.eye(2) + np.array(gradient)
    positions = elastic.grid.rest.copy()
    positions[:, :2] = positions[:, :2] @ f.T
    strain = (f.T @ f - np.eye(2)) / 2
    density = D / 2 * ((1 - NU) * np.sum(strain**2) + NU * np.trace(strain) ** 2)
    membrane, bending = elastic.energies(positions)
    assert membrane == pytest.approx(density, rel=1e-12)  # of one square metre
    assert bending < 1e-20
    components = elastic.covariant(elastic.strain(positions))
    assert np.allclose(components, [strain[0, 0], strain[1, 1], strain[0, 1]], atol=1e-14)


def test_rigid_motions_cost_nothing():
    elastic = elasticity()
    c, s = np.cos(2.0), np.sin(2.0)
    moved = elastic.grid.rest @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) + [3.0, -1.0, 2.0]
    assert sum(elastic.energies(moved)) < 1e-24
    assert np.abs(elastic.forces(moved)).max() < 1e-10


@pytest.mark.parametrize("axis", [0, 1])
def test_a_cylinder_has_the_bending_energy_of_a_plate_but_for_a_strip_along_its_rim(axis):
    """n cells across have n - 1 folds, each by curvature times cell; sin(theta/2) is within 1e-5 of theta/2."""
    elastic, curvature = elasticity((20, 20)), 0.3
    positions = elastic.grid.rest.copy()
    along = positions[:, axis].copy()
    positions[:, axis] = np.sin(curvature * along) / curvature
    positions[:, 2] = (1 - np.cos(curvature * along)) / curvature
    bending = elastic.energies(positions)[1]
    assert bending == pytest.approx(19 / 20 * B / 2 * curvature**2, rel=1e-4)


@pytest.mark.parametrize("kappa", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.7, -0.4, 0.2)])
def test_curvature_and_energy_of_quadratic_surfaces(kappa):
    """Away from the rim: bbar - b = -(w,11 w,22 w,12), and the energy of hinges on cells cut to the right."""
    elastic, (k11, k22, k12) = elasticity((8, 8)), 1e-4 * np.array(kappa)
    x, y, _ = elastic.grid.rest.T
    positions = elastic.grid.rest.copy()
    positions[:, 2] = k11 * x**2 / 2 + k22 * y**2 / 2 + k12 * x * y
    inner, _ = elastic.grid.locate([[0.41, 0.46], [0.46, 0.41]])
    found = elastic.covariant(elastic.curvature(positions))[inner]
    assert np.allclose(found, [-k11, -k22, -k12], atol=1e-9)
    density = (elastic.bending(positions) / elastic.grid.areas)[inner].mean()
    assert density == pytest.approx(B / 2 * ((k11 + k12) ** 2 + (k22 + k12) ** 2 + 4 * k12**2), rel=1e-6)


def test_strain_components_belong_to_the_surfaces_coordinates():
    """x = 2 xi1: a stretch by e along x has the component 4 e in xi1."""
    surface = {"kind": "expression", "x": "2*xi1", "y": "xi2", "z": "0", "xi1": [0, 1], "xi2": [0, 1]}
    elastic = elasticity(surface=surface)
    positions = elastic.grid.rest * [1.01, 1.0, 1.0]
    assert np.allclose(elastic.covariant(elastic.strain(positions))[:, 0], 4 * (1.01**2 - 1) / 2)


def test_masses_springs_and_loads_add_up_to_their_integrals():
    spring = {"name": "s", "stiffness": "3*xi1*xi2", "components": ["y"]}
    case = cloth(springs=[spring], loads=[{"kind": "area", "vector": ["xi1**2", 0, "t"]}])
    loading = Loading(Grid(case, (5, 4)))
    assert loading.masses.sum() == pytest.approx(0.144)
    assert loading.springs.sum(axis=0) == pytest.approx([0, 3 / 4, 0])
    assert loading.forces(2.0).sum(axis=0) == pytest.approx([1 / 3, 0, 2])


def test_a_point_load_between_vertices_keeps_its_moment():
    load = PointLoad(kind="point", on=("here",), force=(0, 0, 2))  # of which no case may ask at finite strain
    grid = Grid(cloth(points={"here": [0.37, 0.61]}).model_copy(update={"loads": (load,)}), (4, 4))
    forces = Loading(grid).forces(0.0)
    assert forces[:, 2].sum() == pytest.approx(2)
    assert forces[:, 2] @ grid.rest[:, :2] == pytest.approx([0.74, 1.22])
