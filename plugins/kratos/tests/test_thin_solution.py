import numpy as np
import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from shellbench_kratos.thin_solution import ThinSolution
from shellbench_kratos.thin_solver import KratosThinSolver
from thin_shells import cantilever, cylinder, plate

from shellbench.errors import InputError
from shellbench.problems.shell.quantities.measure import area_rule
from tests.alike import alike

SOLVER = KratosThinSolver()
PATH = {
    "theory": "kirchhoff-love-nonlinear",
    "loads": [{"kind": "area", "vector": [0, 0, "-0.01*t"]}],
    "path": {"states": [0.5]},
}


@pytest.fixture(scope="module")
def bent():
    """A cantilever of B = 100 N m under an end moment of 0.2 N m/m: kappa_11 = -w,11 = -0.002."""
    load = {"kind": "moment", "on": ["xi1_max"], "axis": [0, -1, 0], "value": 0.2}
    return SOLVER.solve(cantilever(loads=[load]), {"cells": (8, 2)})


@pytest.fixture(scope="module")
def path():
    return SOLVER.solve(plate(**PATH), {"cells": (6, 6)})


def test_bending_strain_has_the_sign_of_the_theory(bent):
    points = np.random.default_rng(1).random((20, 2)) * [10, 1]
    expected = np.tile([-0.002, 0, 0], (20, 1))
    np.testing.assert_allclose(bent.evaluate("bending_strain", points), expected, atol=1e-9)
    np.testing.assert_allclose(bent.evaluate("bending_energy_density", points), 100 / 2 * 0.002**2, rtol=1e-6)
    assert bent.displacement([10, 0.5])[2] == pytest.approx(0.002 * 100 / 2, rel=1e-6)
    assert bent.energies()[1] == pytest.approx(
        100 / 2 * 0.002**2 * 10, rel=1e-7
    )  # its rotations of 0.02 are small ones


def test_a_clamp_bears_the_moment(bent):
    force, moment = bent.reaction("wall", centre=(3, 1, 2))
    np.testing.assert_allclose(force, 0, atol=1e-9)
    np.testing.assert_allclose(moment, [0, 0.2, 0], atol=1e-9)


def test_a_clamp_bears_force_and_lever():
    solution = SOLVER.solve(cantilever(), {"cells": (4, 2)})
    force, moment = solution.reaction("wall")
    np.testing.assert_allclose(force, [0, 0, -1e-3], atol=1e-12)
    np.testing.assert_allclose(moment, np.cross([10, 0.5, 0], [0, 0, -1e-3]), atol=1e-10)


def test_an_inflated_tube_stretches_around_in_covariant_components():
    """eps_11 = R w and N = p R: w = p R^2 / (E h), nu = 0; away from the ends nothing else."""
    material = {"youngs_modulus": 1e7, "poissons_ratio": 0.0, "thickness": 0.001}
    solution = SOLVER.solve(
        cylinder(material=material, loads=[{"kind": "pressure", "value": -1.0}]), {"cells": (8, 24)}
    )
    strain = solution.evaluate("membrane_strain", [[0.3, 1.5], [2.5, 1.4], [5.0, 1.6]])
    np.testing.assert_allclose(strain[:, 0], 4 * 2 / 1e4, rtol=2e-2)  # the normal points inward
    np.testing.assert_allclose(strain[:, 1:], 0, atol=1e-5)


def test_energy_densities_add_up_to_the_energies():
    solution = SOLVER.solve(cylinder(), {"cells": (12, 12)})
    points, weights = area_rule(solution.case)
    densities = [weights @ solution.evaluate(f"{kind}_energy_density", points) for kind in ("membrane", "bending")]
    np.testing.assert_allclose(densities, solution.energies(), rtol=2e-2)


def test_the_energy_of_a_path_grows_by_the_work_of_the_loads():
    """Between two states close to each other the work is the mean load times the way; the error is of third order."""
    case = plate(**PATH | {"loads": [{"kind": "area", "vector": [0, 0, "-t"]}], "path": {"states": [0.95]}})
    found = SOLVER.solve(case, {"cells": (6, 6)})
    forces = [found.problem.loads.forces(t)[:, :3] for t in (0.95, 1.0)]
    way = found.frames[:, :3, 1] - found.frames[:, :3, 0]
    work = found.part.copies * np.sum((forces[0] + forces[1]) / 2 * way)
    assert np.abs(found.frames[:, 2]).max() > 3 * case.material.thickness
    assert sum(found.energies(1.0)) - sum(found.energies(0.95)) == pytest.approx(work, rel=2e-3)


def test_strains_are_told_however_small_they_are():
    """Kratos' own output puts strains below 1e-12 to zero."""
    factors = (1.0, 2.0**-30)
    one, small = (
        SOLVER.solve(plate(loads=[{"kind": "area", "vector": [0, 1e-6 * f, -1e-4 * f]}]), {"cells": (6, 6)})
        for f in factors
    )
    points = np.random.default_rng(7).random((20, 2)) * 10
    for name in ("membrane_strain", "bending_strain"):
        strain = one.evaluate(name, points)
        assert np.abs(strain).max() < 1e-3
        np.testing.assert_allclose(small.evaluate(name, points) * 2.0**30, strain, atol=1e-9 * np.abs(strain).max())


def test_reactions_balance_the_load_of_a_path(path):
    for at in (0.5, 1.0):
        force, _ = path.reaction("rim", at=at)
        np.testing.assert_allclose(force, [0, 0, 1.0 * at], atol=1e-6)


def test_the_field_is_continuous(path):
    rng = np.random.default_rng(4)
    for axis in (0, 1):
        here = rng.random((30, 2)) * 10
        here[:, axis] = rng.integers(1, 12, 30) * 10 / 12
        there = here.copy()
        there[:, axis] += 1e-9
        np.testing.assert_allclose(path.displacement(here), path.displacement(there), atol=1e-8)


def test_a_saved_solution_answers_as_before(path, tmp_path):
    loaded = SOLVER.load(path.save(tmp_path / "answer"))
    points = np.random.default_rng(5).random((20, 2)) * 10
    assert loaded.history == path.history
    assert loaded.parameters == path.parameters
    assert loaded.storage_bytes == path.storage_bytes
    assert np.array_equal(loaded.frames, path.frames)
    for at in (0.5, 1.0):
        alike(loaded.displacement(points, at), path.displacement(points, at))
        np.testing.assert_allclose(loaded.energies(at), path.energies(at), rtol=1e-12)
        np.testing.assert_allclose(loaded.reaction("rim", at=at)[0], path.reaction("rim", at=at)[0], atol=1e-9)
    np.testing.assert_allclose(
        loaded.evaluate("membrane_strain", points), path.evaluate("membrane_strain", points), rtol=1e-9, atol=1e-15
    )


def test_what_was_solved_whole_is_read_back_whole(tmp_path):
    solution = SOLVER.solve(cylinder(), {"cells": (8, 4), "symmetry": False})
    loaded = ThinSolution.load(solution.save(tmp_path / "whole.npz"))
    assert loaded.part.copies == 1
    alike(loaded.displacement([1.0, 1.0]), solution.displacement([1.0, 1.0]))


@pytest.mark.parametrize("damage", ["missing", "text", "cut"])
def test_a_file_that_is_no_solution_is_said_to_be_none(path, tmp_path, damage):
    file = tmp_path / "answer.npz"
    if damage == "text":
        file.write_text("hello")
    elif damage == "cut":
        file.write_bytes(path.save(file).read_bytes()[:-200])
    with pytest.raises(InputError, match=r"answer\.npz") as error:
        SOLVER.load(file)
    assert "\n" not in str(error.value)


def test_counts_are_honest(path):
    """7 x 7 nodes of six; two edges hold 3 displacements, two planes of symmetry one and two rotations."""
    held = 13 * 3 + 2 * 2 * 7 + (6 + 6)  # rim; rotations on planes, ; displacements across planes off the rim
    overlap = 1  # the corner of both planes shares the rotation about z
    assert path.parameters == 49 * 6 - held + overlap
    assert path.storage_bytes == 49 * 3 * 2 * 8
    short, size = path.rounded("float16")
    assert size * 4 == pytest.approx(path.storage_bytes, abs=16)
    largest = np.abs(path.displacement([5, 5])).max()
    assert 0 < np.abs(short.displacement([5, 5]) - path.displacement([5, 5])).max() < 1e-3 * largest
    assert path.rounded("float64")[0] is path


def test_what_it_does_not_know_it_says(path):
    with pytest.raises(KeyError):
        path.evaluate("temperature", [5, 5])
    with pytest.raises(InputError, match=r"solved at 0\.5, 1, not at 0\.7"):
        path.displacement([5, 5], 0.7)
    with pytest.raises(InputError, match="no support is called 'wall'"):
        path.reaction("wall")


def test_two_solves_give_the_same_numbers(path):
    alike(SOLVER.solve(plate(**PATH), {"cells": (6, 6)}).frames, path.frames, 1e-9)
