"""The strain energy of a deformed mesh: forces and tangent are its derivatives, and predicted stresses meet the true ones."""

import numpy as np
import pytest

from shellbench.problems.shell.case import rotation_matrix
from shellbench.problems.shell.question.conditions import Rotation
from shellbench.solvers.fem.algebra.block_matrix import NODE_DOFS
from shellbench.solvers.fem.mechanics.assembly import stiffness
from shellbench.solvers.fem.mechanics.strain_energy import CELLS, StrainEnergy
from shellbench.solvers.fem.mesh.basis import KINDS
from shellbench.solvers.fem.mesh.mesh import TensorMesh
from shellbench.solvers.fem.mesh.quadrature import Quadrature
from tests.alike import alike
from tests.solvers.fem.shells import SURFACES, PolynomialField, shell

ORDER = 7


def energy_of(name, cells=(5, 4)):
    case = shell(name, theory="kirchhoff-love-nonlinear")
    domain = case.surface.domain
    lines = [np.linspace(low, high, n + 1) for low, high, n in zip(domain.lower, domain.upper, cells, strict=True)]
    mesh = TensorMesh(domain, (lines[0], lines[1]))
    return StrainEnergy(mesh, case.surface, case.material, Quadrature.of_order(mesh, ORDER))


def displacement(energy, size=0.05, seed=0):
    """Return degrees of freedom (nodes, 12) that deform the mesh at random: each is a displacement in metres."""
    return np.random.default_rng(seed).uniform(-size, size, (energy.mesh.node_count, NODE_DOFS))


def interpolant(energy, derivatives):
    """Return the degrees of freedom (nodes, 12) of a field's interpolant; `derivatives(points)` gives what it takes."""
    mesh = energy.mesh
    values = derivatives(mesh.domain.wrap(mesh.node_points))
    nodal = np.stack([values[kind] for kind in KINDS], axis=-1) * mesh.node_scales[:, None, :]
    return nodal.reshape(mesh.node_count, NODE_DOFS)


def slope(of, q, step, h):
    """Return the derivative of a function of q along a step, by differences of fourth order."""
    return (8 * (of(q + h * step) - of(q - h * step)) - (of(q + 2 * h * step) - of(q - 2 * h * step))) / (12 * h)


@pytest.fixture(scope="module", params=SURFACES)
def energy(request):
    return energy_of(request.param)


def test_forces_are_the_energys_gradient(energy):
    q, step = displacement(energy), displacement(energy, 0.3, seed=1)
    forces = energy.deform(q).forces
    expected = slope(lambda x: energy.deform(x).energy, q, step, 1e-4)
    assert np.sum(forces * step) == pytest.approx(expected, rel=1e-8)
    # one by one as well, so that no force hides behind the others
    rng = np.random.default_rng(2)
    for node, dof in zip(rng.integers(len(q), size=6), rng.integers(NODE_DOFS, size=6), strict=True):
        single = np.zeros_like(q)
        single[node, dof] = 1.0
        expected = slope(lambda x: energy.deform(x).energy, q, single, 1e-4)
        assert forces[node, dof] == pytest.approx(expected, rel=1e-7, abs=1e-8 * np.abs(forces).max())


def test_membrane_and_bending_are_its_parts(energy):
    strained = energy.deform(displacement(energy))
    assert strained.membrane > 0
    assert strained.bending > 0
    assert strained.energy == strained.membrane + strained.bending
    stiff = StrainEnergy(
        energy.mesh,
        energy.surface,
        energy.material.model_copy(update={"thickness": 2 * energy.material.thickness}),
        energy.quadrature,
    )
    thicker = stiff.deform(displacement(energy))
    assert thicker.membrane == pytest.approx(2 * strained.membrane, rel=1e-13)
    assert thicker.bending == pytest.approx(8 * strained.bending, rel=1e-13)


def test_the_tangent_is_the_forces_derivative(energy):
    q, step = displacement(energy), displacement(energy, 0.3, seed=1)
    expected = slope(lambda x: energy.deform(x).forces, q, step, 1e-4)
    found = (energy.tangent(energy.deform(q)) @ step[..., None])[..., 0]
    assert np.allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_the_tangent_is_symmetric_with_any_stresses(energy):
    strained = energy.deform(displacement(energy))
    others = tuple(np.random.default_rng(3).normal(size=s.shape) * np.abs(s).max() for s in strained.stresses)
    for stresses in (None, others):
        matrix = energy.tangent(strained, stresses).to_csr()
        assert np.abs(matrix - matrix.T).max() <= 1e-14 * np.abs(matrix).max()


def test_the_tangent_at_rest_is_the_linear_stiffness(energy):
    rest = np.zeros((energy.mesh.node_count, NODE_DOFS))
    found = energy.tangent(energy.deform(rest))
    linear = stiffness(energy.mesh, energy.surface, energy.material, energy.quadrature)
    assert np.array_equal(found.columns, linear.columns)
    assert np.allclose(found.blocks, linear.blocks, rtol=0, atol=1e-13 * np.abs(linear.blocks).max())


def test_the_tangent_is_linear_in_its_stresses(energy):
    """The elastic part does not depend on them; the geometric part is theirs, and nothing is counted twice."""
    strained = energy.deform(displacement(energy))
    none = tuple(np.zeros_like(s) for s in strained.stresses)
    twice = tuple(2 * s for s in strained.stresses)
    elastic, full, more = (energy.tangent(strained, s).blocks for s in (none, strained.stresses, twice))
    assert np.abs(full - elastic).max() > 1e-3 * np.abs(full).max()
    assert np.allclose(more - full, full - elastic, rtol=0, atol=1e-13 * np.abs(more).max())


def test_stresses_predicted_for_no_step_are_the_true_ones(energy):
    strained = energy.deform(displacement(energy))
    predicted = energy.predicted_stresses(strained, np.zeros((energy.mesh.node_count, NODE_DOFS)))
    for found, true in zip(predicted, strained.stresses, strict=True):
        assert np.abs(true).max() > 0
        alike(found, true)


def test_predicted_stresses_miss_the_true_ones_by_the_square_of_the_step(energy):
    """So the mixed integration points change nothing in the order of Newton's method (Magisano et al. 2017)."""
    q, step = displacement(energy), displacement(energy, 0.3, seed=1)
    strained = energy.deform(q)
    misses = []
    for h in (2e-3, 1e-3):
        predicted, true = energy.predicted_stresses(strained, h * step), energy.deform(q + h * step).stresses
        misses.append(max(np.abs(p - t).max() for p, t in zip(predicted, true, strict=True)))
    assert np.log2(misses[0] / misses[1]) == pytest.approx(2.0, abs=0.05)


def test_a_mesh_of_several_portions_is_the_sum_of_its_cells():
    """One portion of cells or several: the energy of a field is its integral."""
    coarse, fine = energy_of("plane", (4, 4)), energy_of("plane", (12, 12))
    assert len(coarse.portions) == 1
    assert len(fine.portions) == -(-144 // CELLS) > 1
    # a bicubic field is its own interpolant on both meshes: its strains are polynomials, and energies differ by
    # the quadrature alone, which is the finer mesh's to lose
    field = PolynomialField(coarse.surface, size=0.05)
    parts = []
    for energy in (coarse, fine, energy_of("plane", (24, 24))):
        strained = energy.deform(interpolant(energy, lambda p: field.derivatives(p)))
        parts.append((strained.membrane, strained.bending))
    assert np.allclose(parts[0], parts[2], rtol=1e-6)
    assert np.allclose(parts[1], parts[2], rtol=1e-9)


def test_a_stretched_plate_has_the_energy_of_plane_stress():
    """u = (s x, 0, 0): eps_11 = s + s^2 / 2, and the energy is E h / 2 (1 - nu^2) eps_11^2 times the area."""
    energy = energy_of("plane")
    s = 0.2
    field = {(0, 0): lambda p: s * p[:, :1] * [1, 0, 0], (1, 0): lambda p: np.tile([s, 0, 0], (len(p), 1))}

    def derivatives(points):
        zero = np.zeros((len(points), 3))
        return {kind: field[kind](points) if kind in field else zero for kind in KINDS}

    strained = energy.deform(interpolant(energy, derivatives))
    strain = s + s**2 / 2
    material = energy.material
    modulus = material.youngs_modulus * material.thickness / (1 - material.poissons_ratio**2)
    assert strained.membrane == pytest.approx(modulus / 2 * strain**2 * 2.0, rel=1e-13)
    assert strained.bending <= 1e-20 * strained.membrane


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("angle", [90.0, 180.0, 333.0])
def test_a_turned_mesh_stores_nothing_beyond_its_interpolation_error(name, angle):
    """The interpolant of a rotation x -> R x is strained only by what the mesh can't follow of the surface itself."""
    energies = []
    for cells in ((6, 6), (12, 12)):
        energy = energy_of(name, cells)
        turn = rotation_matrix(Rotation(kind="rotation", axis=(1, 2, 3), angle=angle), angle, linear=False) - np.eye(3)

        def derivatives(points, energy=energy, turn=turn):
            return {key: x @ turn.T for key, x in energy.surface.derivatives(points, 2).items()}

        energies.append(energy.deform(interpolant(energy, derivatives)).energy)
    if name in {"plane", "hypar"}:  # bilinear: the mesh has them exactly
        assert max(energies) <= 1e-22
    else:
        assert energies[0] / energies[1] > 2**3.5  # second derivatives converge with order 2, energy with their square


@pytest.mark.parametrize("name", ["helicoid", "torus"])
def test_the_energy_is_blind_to_a_rigid_rotation_of_a_deformed_shell(name):
    """Turning a deformed interpolant as a whole is linear in its coefficients: x + u -> R (x + u)."""
    energy = energy_of(name, (10, 10))
    turn = rotation_matrix(Rotation(kind="rotation", axis=(2, -1, 1), angle=130), 130, linear=False)
    field = PolynomialField(energy.surface, size=0.05)
    u = displacement(energy, 0.02) if name == "torus" else interpolant(energy, lambda p: field.derivatives(p))
    position = interpolant(energy, lambda p: energy.surface.derivatives(p, 2))
    turned = (position + u).reshape(-1, 3, 4)
    turned = np.einsum("ij,njk->nik", turn, turned).reshape(u.shape) - position
    before, after = energy.deform(u), energy.deform(turned)
    # the interpolant of the turned surface is not exactly the turned surface, so equal to the mesh's accuracy only
    assert after.energy == pytest.approx(before.energy, rel=2e-3)
