"""Strains: against rigid motions, and against the exact strains of the deformed surface."""

import numpy as np
import pytest

from shellbench.problems.shell.conditions import Material
from shellbench.problems.shell.rigid import rigid_modes
from shellbench.solvers.fem.kinematics import DERIVATIVES, Midsurface, elasticity, strain_operator, stress_root_operator
from tests.solvers.fem.shells import SURFACES, PolynomialField, shell, surface_points

PAIRS = ((0, 0), (1, 1), (0, 1))


def strains(surface, points, derivatives):
    operator = strain_operator(Midsurface.at(surface.derivatives(points, 2)))
    gradients = np.stack([derivatives[d] for d in DERIVATIVES], axis=2)
    return np.einsum("psct,pct...->ps...", operator, gradients)


@pytest.mark.parametrize("name", SURFACES)
def test_rigid_motions_strain_nothing(name):
    surface = shell(name).surface
    points = surface_points(surface, 50)
    modes = rigid_modes(surface, points, order=2)
    strained = strains(surface, points, modes)
    # what the same displacements would strain if their parts did not cancel
    operator = np.abs(strain_operator(Midsurface.at(surface.derivatives(points, 2))))
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
    flat = Midsurface.at({(1, 0): np.array([[1.0, 0, 0]]), (0, 1): np.array([[0, 1.0, 0]]),
                          (2, 0): np.zeros((1, 3)), (0, 2): np.zeros((1, 3)), (1, 1): np.zeros((1, 3))})  # fmt: skip
    nu = 0.3
    # strain @ H @ strain = e11^2 + e22^2 + 2 nu e11 e22 + 2 (1 - nu) e12^2
    assert np.allclose(elasticity(flat, nu)[0], [[1, nu, 0], [nu, 1, 0], [0, 0, 2 * (1 - nu)]])


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
        geometry = Midsurface.at(surface.derivatives(points, 2))
        assert np.allclose(surface.position(points)[:, 1], [0.5, 1.1, 0.2])
        d = displacement.derivatives(points, 2)
        gradients = np.stack([d[key] for key in DERIVATIVES], axis=-1)
        rooted = np.einsum("psct,pct->ps", stress_root_operator(geometry, material), gradients)
        densities.append(np.stack([np.sum(rooted[:, :3] ** 2, axis=1), np.sum(rooted[:, 3:] ** 2, axis=1)]) / 2)
    assert densities[0].min() > 0
    assert np.allclose(densities[0], densities[1], rtol=1e-11)
