"""Strains: against rigid motions, and against the exact strains of the deformed surface.

Exact strains of a deformed midsurface: rigid rotations, the deformed surface's own forms, both variations.
"""

from itertools import product

import numpy as np
import pytest
import torch

from shellbench.problems.shell.case import rotation_matrix
from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.problems.shell.question.conditions import Material, Rotation
from shellbench.solvers.fem.mechanics.kinematics import (
    DERIVATIVES,
    Deformation,
    Midsurface,
    cross_matrix,
    elasticities,
    elasticity,
    linear_strains,
    stiffness_moduli,
    strain_operator,
    stress_root_operator,
)
from tests.solvers.fem.shells import SURFACES, PolynomialField, shell, surface_points

PAIRS = ((0, 0), (1, 1), (0, 1))


def strains(surface, points, derivatives):
    operator = strain_operator(Midsurface.from_position(surface.derivatives(points, 2)))
    gradients = np.stack([derivatives[d] for d in DERIVATIVES], axis=2)
    return np.einsum("psct,pct...->ps...", operator, gradients)


@pytest.mark.parametrize("name", SURFACES)
def test_rigid_motions_strain_nothing(name):
    surface = shell(name).surface
    points = surface_points(surface, 50)
    modes = rigid_modes(surface, points, order=2)
    strained = strains(surface, points, modes)
    # what the same displacements would strain if their parts did not cancel
    operator = np.abs(strain_operator(Midsurface.from_position(surface.derivatives(points, 2))))
    gradients = np.stack([np.abs(modes[d]) for d in DERIVATIVES], axis=2)
    scale = np.einsum("psct,pctm->psm", operator, gradients).max()
    assert np.abs(strained).max() <= 1e-12 * scale


def forms(x):
    """Return the metric (n, 3) and the curvature (n, 3) of a surface: components 11, 22, 12."""
    a = (x[1, 0], x[0, 1])
    second = (x[2, 0], x[0, 2], x[1, 1])
    normal = np.cross(*a)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    metric = np.stack([np.sum(a[i] * a[j], axis=-1) for i, j in PAIRS], axis=-1)
    return metric, np.stack([np.sum(s * normal, axis=-1) for s in second], axis=-1)


@pytest.mark.parametrize("name", SURFACES)
def test_strains_are_the_derivative_of_the_exact_ones(name):
    surface = shell(name).surface
    points = surface_points(surface, 20, seed=1)
    x, field = surface.derivatives(points, 2), PolynomialField(surface, seed=2)
    u = field.derivatives(points)
    step = 1e-4

    def exact(factor):
        metric, curvature = forms({key: x[key] + factor * u[key] for key in x})
        return np.concatenate([metric / 2, -curvature], axis=-1)

    difference = (8 * (exact(step) - exact(-step)) - (exact(2 * step) - exact(-2 * step))) / (12 * step)
    linear = strains(surface, points, {key: d[..., None] for key, d in u.items()})[..., 0]
    assert np.abs(linear).max() > 1e-3
    assert np.allclose(linear, difference, atol=1e-8 * np.abs(linear).max())


def test_elasticity_of_an_orthonormal_basis_is_plane_stress():
    flat = Midsurface.from_position({(1, 0): np.array([[1.0, 0, 0]]), (0, 1): np.array([[0, 1.0, 0]]),
                          (2, 0): np.zeros((1, 3)), (0, 2): np.zeros((1, 3)), (1, 1): np.zeros((1, 3))})  # fmt: skip
    nu = 0.3
    # strain @ H @ strain = e11^2 + e22^2 + 2 nu e11 e22 + 2 (1 - nu) e12^2
    assert np.allclose(elasticity(flat, nu)[0], [[1, nu, 0], [nu, 1, 0], [0, 0, 2 * (1 - nu)]])


def test_bending_has_a_ratio_of_its_own():
    """B/2 (k1^2 + k2^2 + 2 nu_b k1 k2 + 2 (1 - nu_b) k12^2); stretching keeps nu. `fem` has it in two forms."""
    material = Material(youngs_modulus=3.0, poissons_ratio=0.3, bending_poissons_ratio=-0.4, thickness=0.2)
    flat = Midsurface.from_position({(1, 0): np.array([[1.0, 0, 0]]), (0, 1): np.array([[0, 1.0, 0]]),
                          (2, 0): np.zeros((1, 3)), (0, 2): np.zeros((1, 3)), (1, 1): np.zeros((1, 3))})  # fmt: skip
    gradients = np.random.default_rng(0).normal(size=(3, len(DERIVATIVES)))
    moduli = np.array([[material.membrane_stiffness, material.bending_stiffness]])
    rooted = np.einsum("sct,ct->s", stress_root_operator(flat, material, moduli)[0], gradients)
    (e1, e2, e12), k = np.einsum("sct,ct->s", strain_operator(flat)[0], gradients).reshape(2, 3)
    stretched = moduli[0, 0] / 2 * (e1**2 + e2**2 + 0.6 * e1 * e2 + 1.4 * e12**2)
    bent = moduli[0, 1] / 2 * (k[0] ** 2 + k[1] ** 2 - 0.8 * k[0] * k[1] + 2.8 * k[2] ** 2)
    assert np.sum(rooted[:3] ** 2) / 2 == pytest.approx(stretched)
    assert np.sum(rooted[3:] ** 2) / 2 == pytest.approx(bent)
    assert k @ elasticities(flat, material)[0, 1] @ k * moduli[0, 1] / 2 == pytest.approx(bent)


def test_energy_density_does_not_depend_on_the_coordinates():
    """The same cylinder in sheared coordinates, eta2 = xi2 + 0.4 xi1, stores the same energy in the same field."""
    material = Material(youngs_modulus=3.0, poissons_ratio=0.3, thickness=0.2)
    field = ("0.1*sin(s)*z**2", "0.05*s*z", "0.02*cos(2*s) + 0.03*z**3")
    densities = []
    for z in ("xi2", "(xi2 - 0.4*xi1)"):
        names = {"kind": "expression", "xi1": [0, 1], "xi2": [0, 2]}
        x = {"x": "2*cos(xi1)", "y": f"1*{z}", "z": "2*sin(xi1)"}
        u = dict(
            zip("xyz", (f.replace("z", z).replace("s)", "xi1)").replace("*s*", "*xi1*") for f in field), strict=True)
        )
        u = {key: text.replace("sin(s", "sin(xi1").replace("cos(2*s", "cos(2*xi1") for key, text in u.items()}
        surface = shell(names | x).surface
        displacement = surface.model_copy(update=u)
        points = np.array([[0.3, 0.5], [0.8, 1.1], [0.5, 0.2]])
        if z != "xi2":
            points[:, 1] += 0.4 * points[:, 0]
        geometry = Midsurface.from_position(surface.derivatives(points, 2))
        assert np.allclose(surface.position(points)[:, 1], [0.5, 1.1, 0.2])
        d = displacement.derivatives(points, 2)
        gradients = np.stack([d[key] for key in DERIVATIVES], axis=-1)
        operator = stress_root_operator(geometry, material, stiffness_moduli(surface, material, points))
        rooted = np.einsum("psct,pct->ps", operator, gradients)
        densities.append(np.stack([np.sum(rooted[:, :3] ** 2, axis=1), np.sum(rooted[:, 3:] ** 2, axis=1)]) / 2)
    assert densities[0].min() > 0
    assert np.allclose(densities[0], densities[1], rtol=1e-11)


AXES = [(0, 0, 1), (1, 0, 0), (1, 2, 3), (-0.3, 0.9, 0.1)]
ANGLES = [1e-6, 10, 90, 180, 271, 360]  # degrees


def at_points(name, count=20, seed=1):
    """Return a surface's position (and derivatives) at some points, and the reference midsurface there."""
    surface = shell(name).surface
    points = surface_points(surface, count, seed)
    x = surface.derivatives(points, 2)
    return surface, points, x, Midsurface.from_position(x)


def gradients_of(u):
    return np.stack([u[d] for d in DERIVATIVES], axis=1)


def deformed(name, size=0.1, seed=2):
    """Return a deformation by a random polynomial, and the position's derivatives before and after."""
    surface, points, x, reference = at_points(name)
    u = PolynomialField(surface, seed=seed, size=size).derivatives(points)
    return Deformation.from_gradients(reference, gradients_of(u)), x, {key: x[key] + u[key] for key in x}


def random_step(deformation, seed=3):
    return np.random.default_rng(seed).normal(size=deformation.gradients.shape)


def torch_strains(x, gradients):
    """Return the strains (6,) at one point from the fundamental forms, nothing rearranged, for differentiation."""
    base, second = torch.as_tensor(x[:2]), torch.as_tensor(x[2:])

    def of(base, second):
        normal = torch.linalg.cross(base[0], base[1])
        normal = normal / torch.linalg.norm(normal)
        return torch.stack([base[a] @ base[b] for a, b in PAIRS]), second @ normal

    metric, curvature = of(base, second)
    after = gradients.reshape(5, 3)
    deformed_metric, deformed_curvature = of(base + after[:2], second + after[2:])
    return torch.cat([(deformed_metric - metric) / 2, curvature - deformed_curvature])


def differentiated(deformation, x):
    """Return value (n, 6), first (n, 6, 15) and second derivative (n, 6, 15, 15) of the strains by torch."""
    rows = np.concatenate([gradients_of(x)], axis=0)
    values, firsts, seconds = [], [], []
    for geometry, gradients in zip(rows, deformation.gradients, strict=True):

        def strains(g, geometry=geometry):
            return torch_strains(geometry, g)

        at = torch.as_tensor(gradients.ravel())
        values.append(strains(at))
        firsts.append(torch.func.jacrev(strains)(at))
        seconds.append(torch.func.jacfwd(torch.func.jacrev(strains))(at))
    return (torch.stack(v).numpy() for v in (values, firsts, seconds))


@pytest.mark.parametrize("name", SURFACES)
def test_rigid_rotations_strain_nothing(name):
    _, _, x, reference = at_points(name)
    metric, _ = forms(x)
    lengths = np.sqrt(metric[:, :2])
    products = np.stack([lengths[:, a] * lengths[:, b] for a, b in PAIRS], axis=-1)
    second = np.linalg.norm(reference.second, axis=-1)
    assert second.max() > 0 or name == "plane"
    for axis, angle in product(AXES, ANGLES):
        turn = rotation_matrix(Rotation(kind="rotation", axis=axis, angle=angle), angle, linear=False) - np.eye(3)
        deformation = Deformation.from_gradients(reference, gradients_of({key: d @ turn.T for key, d in x.items()}))
        strains, words = deformation.strains, f"{angle} degrees about {axis}"
        assert np.all(np.abs(strains[:, :3]) <= 1e-14 * products), words
        assert np.all(np.abs(strains[:, 3:]) <= 1e-14 * second.max() + 1e-300), words
        # the normal is carried along
        assert np.allclose(deformation.rise, reference.normal @ turn.T, atol=1e-14), words
        assert np.allclose(deformation.current.normal, reference.normal @ (turn + np.eye(3)).T, atol=1e-14), words


@pytest.mark.parametrize("size", [0.02, 0.4])
@pytest.mark.parametrize("name", SURFACES)
def test_strains_are_the_difference_of_the_fundamental_forms(name, size):
    deformation, before, after = deformed(name, size)
    (metric, curvature), (deformed_metric, deformed_curvature) = forms(before), forms(after)
    expected = np.concatenate([(deformed_metric - metric) / 2, curvature - deformed_curvature], axis=-1)
    assert np.abs(expected).max() > size  # a large deformation
    scale = np.abs(np.concatenate([deformed_metric, deformed_curvature])).max()
    assert np.allclose(deformation.strains, expected, rtol=0, atol=1e-14 * scale)
    current = deformation.current
    assert np.allclose(current.normal, Midsurface.from_position(after).normal, rtol=0, atol=1e-14)
    assert np.allclose(current.area, Midsurface.from_position(after).area, rtol=1e-13)
    assert np.allclose(deformation.rise, current.normal - Midsurface.from_position(before).normal, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", SURFACES)
def test_small_strains_lose_no_digits(name):
    """At a displacement of 1e-9 the strains are the linear ones to 1e-7, where the forms' difference has no digit."""
    surface, points, x, reference = at_points(name)
    amplitude = 1e-9
    u = {key: amplitude * d for key, d in PolynomialField(surface, seed=2, size=1.0).derivatives(points).items()}
    linear = np.einsum("psct,pct->ps", strain_operator(reference), np.stack([u[d] for d in DERIVATIVES], axis=2))
    strains = Deformation.from_gradients(reference, gradients_of(u)).strains
    scale = np.abs(linear).max(axis=0)
    assert np.all(np.abs(strains - linear).max(axis=0) <= 1e-7 * scale)
    assert np.all(np.abs(linear_strains(reference, gradients_of(u)) - linear).max(axis=0) <= 1e-13 * scale)

    (metric, curvature), (after_metric, after_curvature) = forms(x), forms({key: x[key] + u[key] for key in x})
    naive = np.concatenate([(after_metric - metric) / 2, curvature - after_curvature], axis=-1)
    if name != "plane":  # whose curvature is zero: nothing large is subtracted there
        assert np.abs(naive - linear)[:, 3:].max() > 1e-8 * scale[3:].max()  # the test can tell


def test_quadratic_part_of_the_membrane_strain_survives_at_small_displacements():
    """A plate that is tilted by w = a x stretches by a^2 / 2, also where a^2 is below the rounding of 1."""
    _, _, _, reference = at_points("plane")
    for slope in (1e-3, 1e-9, 1e-12):
        gradients = np.zeros((len(reference.area), 5, 3))
        gradients[:, 0, 2] = slope
        strains = Deformation.from_gradients(reference, gradients).strains
        assert np.allclose(strains[:, 0], slope**2 / 2, rtol=1e-14, atol=0)
        assert not strains[:, 1:].any()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SURFACES)
def test_both_variations_by_automatic_differentiation(name):
    deformation, x, _ = deformed(name, size=0.3)
    values, firsts, seconds = differentiated(deformation, x)
    assert np.allclose(deformation.strains, values, rtol=0, atol=1e-13 * np.abs(values).max())
    assert np.allclose(deformation.operator, firsts, rtol=0, atol=1e-13 * np.abs(firsts).max())
    resultants = np.random.default_rng(4).normal(size=(len(values), 6))
    expected = np.einsum("ns,nsij->nij", resultants, seconds)
    found = deformation.second_variation(resultants)
    assert np.abs(expected).max() > 0.1
    assert np.allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert np.allclose(found, np.swapaxes(found, 1, 2), rtol=0, atol=1e-15 * np.abs(expected).max())


@pytest.mark.parametrize("name", SURFACES)
def test_both_variations_by_differences(name):
    deformation, _, _ = deformed(name, size=0.3)
    step, h = random_step(deformation), 1e-4
    resultants = np.random.default_rng(4).normal(size=(len(step), 6))

    def moved(factor):
        return Deformation.from_gradients(deformation.reference, deformation.gradients + factor * h * step)

    def difference(of):
        return (8 * (of(moved(1)) - of(moved(-1))) - (of(moved(2)) - of(moved(-2)))) / (12 * h)

    flat = step.reshape(len(step), -1)
    first = np.einsum("nsi,ni->ns", deformation.operator, flat)
    assert np.allclose(first, difference(lambda d: d.strains), rtol=0, atol=1e-8 * np.abs(first).max())
    second = np.einsum("nij,nj->ni", deformation.second_variation(resultants), flat)
    expected = difference(lambda d: np.einsum("ns,nsi->ni", resultants, d.operator))
    assert np.allclose(second, expected, rtol=0, atol=1e-8 * np.abs(second).max())


@pytest.mark.parametrize("name", SURFACES)
def test_the_turning_of_the_normal_by_differences(name):
    deformation, _, _ = deformed(name, size=0.3)
    step, h = random_step(deformation), 1e-4
    vectors = np.random.default_rng(5).normal(size=(len(step), 3))
    first = np.zeros_like(step)
    first[:, :2] = step[:, :2]

    def normals(factor):
        return Deformation.from_gradients(deformation.reference, deformation.gradients + factor * h * first).rise

    flat = first[:, :2].reshape(len(step), 6)
    slope = (8 * (normals(1) - normals(-1)) - (normals(2) - normals(-2))) / (12 * h)
    assert np.allclose(np.einsum("nci,ni->nc", deformation.normal_change, flat), slope, atol=1e-8 * np.abs(slope).max())
    bend = (16 * (normals(1) + normals(-1)) - (normals(2) + normals(-2)) - 30 * normals(0)) / (12 * h**2)
    expected = np.sum(vectors * bend, axis=-1)
    found = np.einsum("ni,nij,nj->n", flat, deformation.second_normal_change(vectors), flat)
    assert np.allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_the_cross_matrix_is_the_cross_product():
    v, w = np.random.default_rng(0).normal(size=(2, 7, 3))
    assert np.allclose((cross_matrix(v) @ w[..., None])[..., 0], np.cross(v, w), rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", SURFACES)
def test_the_first_variation_is_that_of_the_operator(name):
    deformation, *_ = deformed(name)
    resultants = np.random.default_rng(5).normal(size=(len(deformation.rise), 6))
    expected = np.einsum("ns,nsg->ng", resultants, deformation.operator)
    assert np.allclose(deformation.first_variation(resultants), expected, rtol=0, atol=1e-13 * np.abs(expected).max())
