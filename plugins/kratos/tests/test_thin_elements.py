import numpy as np
import pytest

pytest.importorskip("KratosMultiphysics", reason="needs Kratos: python -m pip install ./plugins/kratos")

from scipy.spatial.transform import Rotation
from shellbench_kratos.thin_solution import Gauge, mesh_on
from shellbench_kratos.thin_static import ThinProblem
from thin_shells import cylinder, plate

from shellbench.problems.shell.symmetry.symmetry import part_of, whole_of

TURN = Rotation.from_rotvec([1.0, -2.0, 0.7])


def problem(case, cells=(3, 2)):
    return ThinProblem(whole_of(case), mesh_on(whole_of(case), cells))


def stiffness(shell):
    shell.elements.begin()
    return shell.elements.assemble()[0].toarray()


def rigid_motions(positions):
    modes = []
    for unit in np.eye(3):
        modes += [np.concatenate([np.tile(unit, (len(positions), 1)), np.zeros_like(positions)], axis=1)]
        modes += [np.concatenate([np.cross(unit, positions), np.tile(unit, (len(positions), 1))], axis=1)]
    return np.array([mode.ravel() for mode in modes]).T


@pytest.mark.parametrize("case", [plate(), cylinder()])
def test_the_stiffness_at_rest_is_symmetric_and_only_rigid_motions_strain_nothing(case):
    """Drilling rotations of a flat plate resist too: there is no seventh motion, and nothing needs to be fixed."""
    shell = problem(case)
    matrix = stiffness(shell)
    largest = np.abs(matrix).max()
    assert np.abs(matrix - matrix.T).max() < 1e-12 * largest
    assert np.abs(matrix @ rigid_motions(shell.positions)).max() < 1e-9 * largest
    values = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    assert np.all(np.abs(values[:6]) < 1e-10 * values[-1])
    assert values[6] > 1e-8 * values[-1]


def test_a_large_rigid_motion_leaves_no_force_and_no_strain():
    case = cylinder(theory="kirchhoff-love-nonlinear", loads=[], remove_rigid_motions=["translation_y"])
    shell = problem(case)
    moved = TURN.apply(shell.positions) - shell.positions + np.array([3.0, -1.0, 2.0])
    values = np.concatenate([moved, np.tile(TURN.as_rotvec(), (len(moved), 1))], axis=1)
    shell.elements.begin()
    shell.elements.move(values[:, :3], values[:, 3:])
    matrix, inside = shell.elements.assemble()
    assert np.abs(inside).max() < 1e-12 * np.abs(matrix).max()
    strains = Gauge(shell).measure(values)
    assert max(np.abs(strains.membrane).max(), np.abs(strains.bending).max()) < 1e-11
    assert max(Gauge(shell).energies(values)) < 1e-11


def test_forces_turn_with_the_shell():
    """A deformed shell that is turned as a whole has the same forces, turned."""
    case = plate(theory="kirchhoff-love-nonlinear", loads=[])
    shell = problem(case)
    rng = np.random.default_rng(5)
    small = np.concatenate([0.02 * rng.normal(size=(12, 3)), 0.05 * rng.normal(size=(12, 3))], axis=1)
    inside = []
    for turn in (Rotation.identity(), TURN):
        now = turn.apply(shell.positions + small[:, :3])
        turned = turn * Rotation.from_rotvec(small[:, 3:])
        shell.elements.begin()
        shell.elements.move(now - shell.positions, turned.as_rotvec())
        inside.append(shell.elements.assemble()[1].reshape(-1, 2, 3))
    expected = TURN.apply(inside[0].reshape(-1, 3)).reshape(-1, 2, 3)
    np.testing.assert_allclose(inside[1], expected, atol=1e-9 * np.abs(expected).max())


def test_forces_are_the_derivative_of_the_energy():
    """The energy of a state far from rest, by Kratos' strains in our frame, against Kratos' own forces.

    Kratos takes the deformational rotations in its forces, not in its stiffness, for small: they are 1e-3 here.
    """
    case = plate(theory="kirchhoff-love-nonlinear", loads=[])
    shell = problem(case)
    gauge = Gauge(shell)
    rng = np.random.default_rng(6)
    strained = np.concatenate([1e-3 * rng.normal(size=(12, 3)), 1e-3 * rng.normal(size=(12, 3))], axis=1)
    axes = TURN * Rotation.from_rotvec(strained[:, 3:])
    moved = TURN.apply(shell.positions + strained[:, :3]) - shell.positions
    direction, size = rng.normal(size=(12, 6)), 1e-6

    def energy(amount):
        turned = (Rotation.from_rotvec(amount * direction[:, 3:]) * axes).as_rotvec()
        return sum(gauge.energies(np.concatenate([moved + amount * direction[:, :3], turned], axis=1)))

    shell.elements.begin()
    shell.elements.move(moved, axes.as_rotvec())
    work = shell.elements.assemble()[1] @ direction.ravel()
    assert (energy(size) - energy(-size)) / (2 * size) == pytest.approx(work, rel=2e-3)


def test_the_symmetric_part_is_in_the_whole_as_often_as_it_says():
    part = part_of(cylinder())
    shell = ThinProblem(part, mesh_on(part, (4, 4)))
    assert part.copies * shell.loads.areas.sum() == pytest.approx(2 * np.pi * 2 * 3, rel=1e-12)
