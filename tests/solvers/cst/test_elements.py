"""Energies of triangles and hinges, their derivatives, and what they say of known shapes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from shellbench.solvers.cst.elastic import Elastic, Pattern
from shellbench.solvers.cst.elements import fold_angle, fold_gradient, fold_hessian
from shellbench.solvers.cst.mesh import TriangleMesh
from tests.problems.shell.stated_shells import UNIT, plate
from tests.solvers.cst.shells import CLOTH, cloth, cylinder

STEP = 1e-6


def made(case, cells=(5, 4), diagonal="alternating"):
    mesh = TriangleMesh(case.surface.domain, cells, diagonal)
    return mesh, Elastic.from_case(case, mesh)


def crumpled(elastic, amount=0.05):
    return amount * np.random.default_rng(3).normal(size=elastic.rest.shape)


def total(elastic, u):
    return sum(elastic.energies(u))


TUBE = {"kind": "cylinder", "radius": 2, "closed": True, "xi1": [0, 360], "xi2": [0, 3]}


@pytest.mark.parametrize("surface", [UNIT, TUBE])
def test_a_finite_rigid_motion_strains_nothing(surface):
    _, elastic = made(cloth(surface=surface))
    turn = Rotation.from_rotvec([1.0, -2.0, 0.7]).as_matrix()
    u = elastic.rest @ turn.T + [3.0, -1.0, 2.0] - elastic.rest
    np.testing.assert_allclose(elastic.strain(u), 0, atol=1e-13)
    np.testing.assert_allclose(elastic.hinge_changes(u), 0, atol=1e-12)


def test_a_linearised_rigid_motion_strains_nothing_in_linear_theory():
    _, elastic = made(cylinder())
    u = np.cross([1.0, -2.0, 0.7], elastic.rest) + np.array([3.0, -1.0, 2.0])
    np.testing.assert_allclose(elastic.strain(u), 0, atol=1e-13)
    np.testing.assert_allclose(elastic.hinge_changes(u), 0, atol=1e-12)


@pytest.mark.parametrize("make", [cloth, plate, cylinder])
def test_the_gradient_is_that_of_the_energy(make):
    _, elastic = made(make())
    u = crumpled(elastic)
    direction = np.random.default_rng(4).normal(size=u.shape)
    numeric = (total(elastic, u + STEP * direction) - total(elastic, u - STEP * direction)) / (2 * STEP)
    assert np.sum(elastic.gradient(u) * direction) == pytest.approx(numeric, rel=1e-7)


@pytest.mark.parametrize("make", [cloth, plate, cylinder])
def test_the_tangent_is_that_of_the_gradient(make):
    _, elastic = made(make())
    u = crumpled(elastic)
    free = np.arange(u.size)
    matrix = Pattern.from_elastic(elastic, free).matrix(elastic.tangent_values(u), np.zeros(u.size))
    direction = np.random.default_rng(4).normal(size=u.shape)
    numeric = (elastic.gradient(u + STEP * direction) - elastic.gradient(u - STEP * direction)) / (2 * STEP)
    np.testing.assert_allclose(
        (matrix @ direction.ravel()).reshape(u.shape), numeric, atol=1e-6 * np.abs(numeric).max()
    )
    assert abs(matrix - matrix.T).max() < 1e-12 * abs(matrix).max()


def test_the_definite_tangent_has_no_negative_curvature_where_the_exact_one_has():
    _, elastic = made(cloth())
    squeezed = -0.3 * elastic.rest + crumpled(elastic, 1e-3)
    pattern = Pattern.from_elastic(elastic, np.arange(squeezed.size))

    def lowest(definite):
        values = elastic.tangent_values(squeezed, definite)
        return np.linalg.eigvalsh(pattern.matrix(values, np.zeros(squeezed.size)).toarray())[0]

    scale = CLOTH["youngs_modulus"] * CLOTH["thickness"]
    assert lowest(False) < -1e-3 * scale
    assert lowest(True) > -1e-12 * scale


def test_the_fold_and_its_derivatives():
    """The roof of two triangles at right angles, and finite differences around shapes of no symmetry."""
    right = np.array([[[0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, -1]]], dtype=float)
    assert fold_angle(right)[0] == pytest.approx(np.pi / 2)  # the normal turns from z to x, about y
    x = np.random.default_rng(0).normal(size=(6, 4, 3))
    ways = STEP * np.eye(12).reshape(12, 4, 3)
    slope = np.stack([(fold_angle(x + d) - fold_angle(x - d)) / (2 * STEP) for d in ways], axis=-1)
    np.testing.assert_allclose(fold_gradient(x), slope, rtol=1e-5, atol=1e-6)
    curve = np.stack([(fold_gradient(x + d) - fold_gradient(x - d)) / (2 * STEP) for d in ways], axis=-1)
    np.testing.assert_allclose(fold_hessian(x), curve, rtol=1e-4, atol=1e-4 * np.abs(curve).max())


def test_patch_of_constant_membrane_strain():
    """An affine map of the plane: every triangle has its strain, and no vertex inside is loaded."""
    mesh, elastic = made(cloth())
    gradient = np.array([[0.02, 0.05, 0], [-0.03, 0.04, 0], [0, 0, 0]])
    u = elastic.rest @ gradient.T
    f = (np.eye(3) + gradient)[:, :2]
    strain = (f.T @ f - np.eye(2)) / 2
    expected = np.broadcast_to([strain[0, 0], strain[1, 1], strain[0, 1]], (len(mesh.triangles), 3))
    np.testing.assert_allclose(elastic.membrane.covariant_strain(elastic.strain(u)), expected, atol=1e-14)
    forces = elastic.gradient(u).reshape(*mesh.shape, 3)
    assert np.abs(forces[1:-1, 1:-1]).max() < 1e-13 * np.abs(forces).max()
    e, nu, h = CLOTH["youngs_modulus"], CLOTH["poissons_ratio"], CLOTH["thickness"]
    density = e * h / (1 - nu**2) / 2 * ((1 - nu) * np.sum(strain**2) + nu * np.trace(strain) ** 2)
    assert elastic.energies(u)[0] == pytest.approx(density, rel=1e-12)


def test_covariant_strain_of_a_cylinder_that_widens():
    """u = w a3: eps_11 = R w on the coordinate of an angle, and the inscribed polygon comes near it."""
    case = cylinder()
    _, elastic = made(case, (64, 4))
    radial = elastic.rest * [1, 0, 1] / 2
    strain = elastic.membrane.covariant_strain(elastic.strain(0.01 * radial))
    np.testing.assert_allclose(strain, np.broadcast_to([2 * 0.01, 0, 0], strain.shape), rtol=2e-3, atol=1e-12)


def bent(elastic, p, q, r):
    """w = (p x^2 + q y^2)/2 + r x y, whose b is (p, q, r) in linear theory."""
    x, y, _ = elastic.rest.T
    u = np.zeros_like(elastic.rest)
    u[:, 2] = (p * x**2 + q * y**2) / 2 + r * x * y
    return u


@pytest.mark.parametrize("diagonal", ["right", "left", "alternating"])
def test_bending_strain_of_a_quadratic_surface_is_exact_inside(diagonal):
    """kappa = bbar - b on each triangle, or in the mean over pairs of cells where diagonals alternate."""
    _, elastic = made(plate(), (6, 8), diagonal)
    p, q, r = 0.3, -0.7, 0.45
    change = elastic.hinge_changes(bent(elastic, p, q, r))
    kappa = elastic.membrane.covariant_strain(elastic.hinges.curvature(change, elastic.membrane))
    kappa = kappa.reshape(6, 8, 2, 3)[1:-1, 1:-1]
    if diagonal == "alternating":
        kappa = kappa.reshape(2, 2, 3, 2, 2, 3).mean(axis=(1, 3, 4))
    np.testing.assert_allclose(kappa, np.broadcast_to([-p, -q, -r], kappa.shape), atol=1e-12)


@pytest.mark.parametrize(("diagonal", "s"), [("right", 1), ("left", -1), ("alternating", 0)])
def test_hinges_have_the_energy_of_the_folds_of_a_quadratic_surface(diagonal, s):
    """Edges along xi2 fold by k11 + s k12, those along xi1 by k22 + s k12, diagonals by sqrt(2) k12, times the cell."""
    case = plate(surface={"kind": "plane", "xi1": [0, 6], "xi2": [0, 6]}, points={})
    _, elastic = made(case, (6, 6), diagonal)
    p, q, r = 0.3, -0.7, 0.45
    u = bent(elastic, p, q, r)
    middle = elastic.rest[elastic.hinges.vertices[:, :2], :2].mean(axis=1)
    inside = np.all((middle > 1.9) & (middle < 3.9), axis=1)  # the edges of 2 x 2 cells
    energy = elastic.hinges.energy(elastic.hinge_changes(u))[inside].sum() / 4
    b = case.material.bending_stiffness
    assert energy == pytest.approx(b / 2 * ((p + s * r) ** 2 + (q + s * r) ** 2 + 4 * r**2), rel=1e-12)


@pytest.mark.parametrize("diagonal", ["right", "left", "alternating"])
def test_a_rolled_strip_has_the_energy_of_bending(diagonal):
    """Folds of the inscribed polygon are kappa h: B kappa^2/2 per area, but for half a fold at each rim."""
    n = 16
    _, elastic = made(cloth(surface={"kind": "plane", "xi1": [0, 1], "xi2": [0, 0.25]}), (n, 4), diagonal)
    s, y, _ = elastic.rest.T
    rolled = np.stack([np.sin(np.pi * s) / np.pi, y, (1 - np.cos(np.pi * s)) / np.pi], axis=-1)
    stiffness = CLOTH["youngs_modulus"] * CLOTH["thickness"] ** 3 / 12 / (1 - CLOTH["poissons_ratio"] ** 2)
    expected = stiffness / 2 * np.pi**2 * 0.25
    assert elastic.energies(rolled - elastic.rest)[1] == pytest.approx(expected * (1 - 1 / n), rel=1e-9)


def test_a_cylinder_that_unrolls_has_the_energy_of_its_curvature():
    """The rest angle counts: a quarter of a cylinder flattened has B/(2 R^2) per area."""
    radius, n = 2.0, 16
    surface = {"kind": "cylinder", "radius": radius, "xi1": [0, 90], "xi2": [0, 1]}
    mesh, elastic = made(cloth(surface=surface), (n, 3), "right")
    chord = 2 * radius * np.sin(np.pi / 4 / n)
    flat = np.stack([0 * mesh.points[:, 0], mesh.points[:, 1], chord * n * mesh.points[:, 0] / (np.pi / 2)], axis=-1)
    membrane, bending = elastic.energies(flat - elastic.rest)
    stiffness = CLOTH["youngs_modulus"] * CLOTH["thickness"] ** 3 / 12 / (1 - CLOTH["poissons_ratio"] ** 2)
    expected = stiffness / (2 * radius**2) * radius * np.pi / 2
    assert membrane < 1e-20
    assert bending == pytest.approx(expected * (1 - 1 / n), rel=2e-3)  # chord against arc


SIDES = ("xi1_min", "xi1_max", "xi2_min", "xi2_max")


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("diagonal", ["right", "left"])
def test_a_clamped_edge_has_the_half_of_a_hinge(side, diagonal):
    """The mesh of w = kappa s^2 / 2, s from the wall, has the energy of all but the last half of a row of cells."""
    cells, kappa = (6, 5), 0.3
    case = plate(supports=[{"name": "wall", "on": [side], "clamped": True}])
    _, elastic = made(case, cells, diagonal)
    axis = int(side[2]) - 1
    s = elastic.rest[:, axis] - elastic.rest[:, axis].min()
    length = s.max()
    s = s if side.endswith("min") else length - s
    u = np.zeros_like(elastic.rest)
    u[:, 2] = kappa * s**2 / 2
    area = np.ptp(elastic.rest[:, 0]) * np.ptp(elastic.rest[:, 1])
    share = 1 - 1 / (2 * cells[axis])
    assert elastic.energies(u)[1] == pytest.approx(case.material.bending_stiffness * kappa**2 / 2 * area * share)


@pytest.mark.parametrize(
    ("make", "edges", "sides"), [(cloth, ["xi1_min", "xi2_max"], 4 + 5), (cylinder, ["xi2_max"], 5)]
)
def test_walls_have_the_derivatives_of_their_energy(make, edges, sides):
    free = made(make())[1]
    _, elastic = made(make(supports=[{"name": "walls", "on": edges, "clamped": True}], remove_rigid_motions=[]))
    assert len(elastic.hinges.vertices) == len(free.hinges.vertices) + sides
    u = crumpled(elastic)
    d = np.random.default_rng(4).normal(size=u.shape)
    numeric = (total(elastic, u + STEP * d) - total(elastic, u - STEP * d)) / (2 * STEP)
    assert np.sum(elastic.gradient(u) * d) == pytest.approx(numeric, rel=1e-6)
    pattern = Pattern.from_elastic(elastic, np.arange(u.size))
    steps = (elastic.gradient(u + STEP * d) - elastic.gradient(u - STEP * d)) / (2 * STEP)
    tangent = pattern.matrix(elastic.tangent_values(u), np.zeros(u.size)) @ d.ravel()
    np.testing.assert_allclose(tangent, steps.ravel(), rtol=0, atol=1e-5 * np.abs(steps).max())


def test_a_wall_at_rest_strains_nothing_and_feels_a_turn_about_its_edge():
    case = cylinder(supports=[{"name": "wall", "on": ["xi2_min"], "clamped": True}], remove_rigid_motions=[])
    _, elastic = made(case)
    np.testing.assert_allclose(elastic.hinge_changes(np.zeros_like(elastic.rest)), 0, atol=1e-13)
    turned = np.cross([1.0, 0.0, 0.0], elastic.rest)
    assert elastic.energies(1e-3 * turned)[1] > 0
