"""Geometry and linear strains, on every surface."""

import numpy as np
import pytest
import torch

from shellbench.problems.shell.posed.rigid import rigid_modes
from shellbench.solvers.ndf.field.geometry import (
    apply_rows,
    contravariant_basis_jet,
    energy_rows,
    geometry,
    normal_jet,
    pull_back_rows,
    rigidities,
    strain_rows,
)
from shellbench.solvers.ndf.field.jets import D1, D2, Placement, from_derivatives, matrix_product
from shellbench.solvers.ndf.strains.strain_measures import Undeformed, stresses
from tests.solvers.ndf.shells import SURFACES, differences, inner_points, shell

PLACEMENT = Placement()


def wave(points):
    """A smooth displacement (N, 3)."""
    a, b = points[..., 0], points[..., 1]
    return np.stack([np.sin(a) * b, np.cos(a + b), a * b**2 - np.sin(b)], axis=-1)


@pytest.mark.parametrize("surface", SURFACES)
def test_rigid_motions_strain_nothing(surface):
    case = shell(surface)
    points = inner_points(case)
    rows = energy_rows(
        geometry(case.surface, points, PLACEMENT),
        case.material,
        rigidities(case.surface, case.material, points, PLACEMENT),
    )
    modes = from_derivatives(rigid_modes(case.surface, points, order=2), PLACEMENT)
    stretching = apply_rows(rows, PLACEMENT.tensor(differences(wave, points))).norm()
    for k in range(6):
        assert apply_rows(rows, modes[..., k]).norm() < 1e-12 * stretching


@pytest.mark.parametrize("surface", SURFACES)
def test_strains_are_the_linear_part_of_metric_and_curvature_changes(surface):
    """eps = (a - abar)/2 and kappa = bbar - b of the deformed surface (Kairanda et al. 2023, eqs. (15, 16))."""
    case = shell(surface)
    points = inner_points(case)
    x = from_derivatives(case.surface.derivatives(points, 2), PLACEMENT).numpy()
    u = differences(wave, points)

    def forms(y):
        a1, a2 = y[1], y[2]
        normal = np.cross(a1, a2)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        metric = [(a1 * a1).sum(-1), (a2 * a2).sum(-1), (a1 * a2).sum(-1)]
        curvature = [(y[k] * normal).sum(-1) for k in (3, 5, 4)]
        return np.array(metric), np.array(curvature)

    step = 2e-6
    (a_plus, b_plus), (a_minus, b_minus) = forms(x + step * u), forms(x - step * u)
    expected = np.concatenate([(a_plus - a_minus) / 2, b_minus - b_plus]) / (2 * step)
    rows = strain_rows(geometry(case.surface, points, PLACEMENT))
    found = apply_rows(rows, PLACEMENT.tensor(u)).numpy() * [1, 1, 0.5, 1, 1, 0.5]
    np.testing.assert_allclose(found, expected.T, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("nu_bending", [None, -1 / 3])
def test_energy_density_of_a_stretched_and_bent_plate(nu_bending):
    """W = 1/2 D (e1^2 + e2^2 + 2 nu e1 e2) + 1/2 B (...) in the plane, with shear 1/2 D (1 - nu)/2 gamma^2."""
    case = shell("plane", {"bending_poissons_ratio": nu_bending})
    nu, d, b = case.material.poissons_ratio, case.material.membrane_stiffness, case.material.bending_stiffness
    nu_b = nu if nu_bending is None else nu_bending

    def displacement(p):
        xi1, xi2 = p[..., 0], p[..., 1]
        return np.stack([0.1 * xi1, 0.3 * xi1 - 0.2 * xi2, xi1**2 - 0.5 * xi2**2 + 0.7 * xi1 * xi2], axis=-1)

    points = inner_points(case)
    rows = energy_rows(
        geometry(case.surface, points, PLACEMENT),
        case.material,
        rigidities(case.surface, case.material, points, PLACEMENT),
    )
    strain = apply_rows(rows, PLACEMENT.tensor(differences(displacement, points)))
    membrane = d / 2 * (0.1**2 + 0.2**2 - 2 * nu * 0.02 + (1 - nu) / 2 * 0.3**2)
    bending = b / 2 * (2**2 + 1 - 2 * nu_b * 2 + 2 * (1 - nu_b) * 0.7**2)
    density = 0.5 * strain**2
    undeformed = Undeformed.at_points(case.surface, points, PLACEMENT)
    plain = apply_rows(strain_rows(undeformed.geometry), PLACEMENT.tensor(differences(displacement, points)))
    torch.testing.assert_close(
        (plain * stresses(undeformed.elasticity(case.material), plain)).sum(1) / 2, density.sum(1)
    )
    torch.testing.assert_close(
        density[:, :3].sum(1), torch.full((20,), membrane, dtype=torch.float64), rtol=1e-8, atol=0
    )
    torch.testing.assert_close(
        density[:, 3:].sum(1), torch.full((20,), bending, dtype=torch.float64), rtol=1e-8, atol=0
    )


@pytest.mark.parametrize("surface", SURFACES)
def test_normal_and_contravariant_basis(surface):
    case = shell(surface)
    points = inner_points(case)
    normal = normal_jet(case.surface, points, PLACEMENT)

    def direct(p):
        x = case.surface.derivatives(p, 1)
        n = np.cross(x[1, 0], x[0, 1])
        return n / np.linalg.norm(n, axis=-1, keepdims=True)

    np.testing.assert_allclose(normal.numpy(), differences(direct, points), atol=1e-6)
    x = from_derivatives(case.surface.derivatives(points, 2), PLACEMENT)
    basis = contravariant_basis_jet(case.surface, points, PLACEMENT)
    covariant = torch.stack([x[D1], x[D2], normal[0]], dim=1)
    identity = torch.eye(3, dtype=torch.float64).expand(len(points), 3, 3)
    torch.testing.assert_close(covariant @ basis[0], identity, atol=1e-12, rtol=0)
    shifted = differences(lambda p: contravariant_basis_jet(case.surface, p, PLACEMENT)[0].numpy(), points)
    np.testing.assert_allclose(basis.numpy(), shifted, atol=1e-5)


def test_rows_through_a_matrix_are_rows_of_the_product():
    case = shell("helicoid")
    points = inner_points(case)
    rows = strain_rows(geometry(case.surface, points, PLACEMENT))
    generator = torch.Generator().manual_seed(0)
    matrix = torch.randn(6, len(points), 3, 3, dtype=torch.float64, generator=generator)
    field = torch.randn(6, len(points), 3, dtype=torch.float64, generator=generator)
    direct = apply_rows(rows, matrix_product(matrix, field[..., None])[..., 0])
    torch.testing.assert_close(apply_rows(pull_back_rows(rows, matrix), field), direct, rtol=1e-12, atol=1e-10)
