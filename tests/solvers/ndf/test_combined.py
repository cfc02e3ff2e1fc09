"""Independent combinations of nearly dependent features."""

import numpy as np
import pytest
import torch

from shellbench.errors import SolveFailure
from shellbench.solvers.ndf.field.ansatz import Combined, independent_combinations
from shellbench.solvers.ndf.field.build import build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.network import random_features
from tests.solvers.ndf.shells import inner_points, shell

PLACEMENT = Placement()


def spectrum(values, seed=0):
    """A symmetric matrix with these eigenvalues."""
    generator = torch.Generator().manual_seed(seed)
    q, _ = torch.linalg.qr(torch.randn(len(values), len(values), generator=generator, dtype=torch.float64))
    return q @ torch.diag(torch.tensor(values, dtype=torch.float64)) @ q.T


def test_combinations_have_the_identity_as_stiffness():
    stiffness = spectrum([1e6, 30.0, 1.0, 1e-2])
    combine = independent_combinations(stiffness)
    assert combine.shape == (4, 4)
    torch.testing.assert_close(combine.T @ stiffness @ combine, torch.eye(4, dtype=torch.float64), rtol=0, atol=1e-6)


def test_dependent_features_are_combined_into_fewer_and_nothing_stiff_is_lost():
    """Three features of which one is the sum of the others: the energy of any load is that of two."""
    root = torch.tensor([[1.0, 0.0, 1.0], [0.5, 2.0, 2.5]], dtype=torch.float64)
    stiffness = root.T @ root
    combine = independent_combinations(stiffness)
    assert combine.shape == (3, 2)
    load = root.T @ torch.tensor([0.3, -0.7], dtype=torch.float64)  # one that strains can balance
    least = torch.linalg.pinv(stiffness) @ load
    assert float((combine.T @ load).square().sum()) == pytest.approx(float(load @ least), rel=1e-12)


def test_scales_of_features_do_not_matter():
    """Features in other units span the same fields: as many, and with the same energy under a load."""
    stiffness, load = spectrum([4.0, 1.0, 0.25, 1e-3]), torch.tensor([1.0, -2.0, 0.5, 3.0], dtype=torch.float64)
    units = torch.tensor([1e-8, 1e6, 1.0, 1e3], dtype=torch.float64)
    usual = independent_combinations(stiffness).T @ load
    scaled = independent_combinations(stiffness * units[:, None] * units).T @ (load * units)
    assert usual.shape == scaled.shape
    assert float(scaled.square().sum()) == pytest.approx(float(usual.square().sum()), rel=1e-9)


def test_a_feature_without_stiffness_is_left_out():
    stiffness = torch.diag(torch.tensor([2.0, 0.0, 5.0], dtype=torch.float64))
    combine = independent_combinations(stiffness)
    assert combine.shape == (3, 2)
    assert combine[1].abs().max() == 0


def test_energy_that_is_not_finite_is_a_failure_in_one_sentence():
    with pytest.raises(SolveFailure, match="not finite"):
        independent_combinations(torch.full((2, 2), torch.inf, dtype=torch.float64))


def test_combined_features_are_the_combinations_of_the_features():
    case, spec = shell("hypar"), FieldSpec()
    inputs = build_inputs(case, spec)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, 2.0)), 7, 0)
    features = build_features(case, spec, network, PLACEMENT, inputs)
    generator = torch.Generator().manual_seed(0)
    combine = torch.randn(features.count, 3, generator=generator, dtype=torch.float64)
    points, combined = inner_points(case), Combined(features, combine)
    assert combined.count == 3
    assert combined.placement == features.placement
    torch.testing.assert_close(combined.jets(points), features.jets(points) @ combine)
    torch.testing.assert_close(combined.values(points), combined.jets(points)[0])
