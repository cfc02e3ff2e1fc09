"""The published functional of motion: samples, value and gradient, and its stationary point for a free fall."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue.catalog import named_case
from shellbench.solvers.ndf.field.geometry import geometry
from shellbench.solvers.ndf.field.jets import Placement
from shellbench.solvers.ndf.field.quadrature import RuleSpec, area_rule
from shellbench.solvers.ndf.published.published_motion import MotionSampler, SpaceTime, stratified_times
from shellbench.solvers.ndf.published.published_motion_field import Ansatz, MotionField
from shellbench.solvers.ndf.published.published_network import initial_siren
from shellbench.solvers.ndf.published.published_samples import stratified_samples
from tests.alike import alike
from tests.solvers.ndf.motions import NAPKIN, G, gravity, moving
from tests.solvers.ndf.shells import inner_points, support

HERE = Placement()
FALL = named_case("free_fall")
HUNG = moving(
    "roof",
    supports=[support("edge", "xi2_max"), support("side", "xi1_min", components=["z"])],
    loads=[gravity(0, -G, 1.0), {"kind": "pressure", "value": "20*t*xi2"}],
    springs=[{"name": "bed", "stiffness": "3 + xi2", "components": ["y"]}],
)


def sampler_of(case, strain="published", dtype=torch.float64, **settings):
    """A network at its start, and the samples that it would be trained on."""
    placement, ansatz = Placement(dtype=dtype), Ansatz.from_case(case, True)
    siren = initial_siren(ansatz.count, 2, 8, 15.0, 0, placement)
    given = {"cells": (3, 4), "times": 5, "seed": 0, **settings}
    return siren, MotionSampler(ansatz, strain, placement=placement, **given)


def gauss(case, count=12):
    """The functional by Gauss's rule in space and time."""
    ansatz = Ansatz.from_case(case, True)
    rule = area_rule(case.surface.domain, np.zeros((0, 2)), RuleSpec((2, 2), 4))
    x, w = np.polynomial.legendre.leggauss(count)
    times = ansatz.until * (x + 1) / 2
    return SpaceTime.at_points(ansatz, "published", rule.points, times, np.outer(w / 2, rule.weights), HERE), times


def test_one_time_in_each_interval_and_new_ones_each_time():
    times = stratified_times(2.0, 20, seed=3, iteration=7)
    assert list(np.floor(times / 0.1)) == list(range(20))
    assert np.array_equal(times, stratified_times(2.0, 20, seed=3, iteration=7))
    for other in (stratified_times(2.0, 20, 3, 8), stratified_times(2.0, 20, 4, 7)):
        assert np.all(other != times)


def test_samples_fill_the_cells_of_space_and_time():
    """One sample in each of the 3 x 4 x 5 cells, with the network's inputs in [0, 1]; the same wherever it starts."""
    _, sampler = sampler_of(FALL)
    first, second = sampler.samples(4, 6)
    seen = first.inputs[0].numpy()
    assert seen.min() >= 0
    assert seen.max() <= 1
    cells = np.floor(seen * [3, 4, 5]).astype(int)
    assert len({tuple(cell) for cell in cells}) == 60
    assert np.all(second.inputs[0].numpy() != seen)
    (again,) = sampler.samples(5, 6)
    alike(again.inputs, second.inputs)


def test_the_functional_is_its_terms_summed_by_hand():
    """Against the densities as the paper has them, differentiated by automatic differentiation of u itself."""
    siren, sampler = sampler_of(HUNG)
    (sample,) = sampler.samples(3, 4)
    domain, material = HUNG.surface.domain, HUNG.material
    field = MotionField(sampler.ansatz, siren)
    points, times = stratified_samples(HUNG, (3, 4), 0, 3), stratified_times(1.0, 5, 0, 3)
    area = geometry(HUNG.surface, points, HERE).jacobian.numpy()
    x = HUNG.surface.derivatives(points, 1)
    normal = np.cross(x[1, 0], x[0, 1]) / area[:, None]
    total, h = 0.0, 1e-5
    for t in times:
        before, u, after = (field.displacement(points, t + k * h).detach().numpy() for k in (-1, 0, 1))
        velocity = (after - before) / (2 * h)
        force = material.areal_density * np.array([0, -G, 1.0]) + 20 * t * points[:, 1:] * normal
        stored = 0.5 * (3 + points[:, 1]) * u[:, 1] ** 2
        density = 0.5 * material.areal_density * (velocity**2).sum(1) - (force * u).sum(1) + stored
        total += (density * area).sum() * np.prod(domain.size) / 60
    strain = (sample.weights * sample.strain_energy(sample.planes(siren)[:6])).sum().item()
    assert sample.loss(siren).item() == pytest.approx(total + strain, rel=1e-7)


@pytest.mark.parametrize("strain", ["published", "exact", "linear"])
def test_the_gradient_is_that_of_finite_differences(strain):
    siren, sampler = sampler_of(HUNG, strain)
    (sample,) = sampler.samples(0, 1)
    tensors = [t.requires_grad_() for t in siren.tensors]
    gradients = torch.autograd.grad(sample.loss(siren), tensors)
    generator = torch.Generator().manual_seed(1)
    directions = [torch.randn(t.shape, generator=generator, dtype=t.dtype) for t in tensors]
    h = 1e-6
    with torch.no_grad():
        ahead, behind = (
            sample.loss(siren.with_tensors([t + s * h * d for t, d in zip(tensors, directions, strict=True)])).item()
            for s in (1, -1)
        )
    slope = sum((g * d).sum().item() for g, d in zip(gradients, directions, strict=True))
    assert slope == pytest.approx((ahead - behind) / (2 * h), rel=1e-6)


def test_a_rigid_motion_stores_no_energy():
    sample, times = gauss(moving(NAPKIN))
    angle, xi = 0.7, area_rule(FALL.surface.domain, np.zeros((0, 2)), RuleSpec((2, 2), 4)).points
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]) - np.eye(3)
    jets = np.zeros((6, len(times), len(xi), 3))
    jets[0], jets[1], jets[2] = FALL.surface.position(xi) @ turn.T + times[:, None, None], turn[:, 0], turn[:, 1]
    assert sample.strain_energy(HERE.tensor(jets)).abs().max() < 1e-9


@pytest.mark.parametrize("degree", [0, 1, 3, 8])
def test_free_fall_is_stationary_where_it_is_three_times_too_far(degree):
    """Minimise over u = t^2 F(t), F a polynomial: for a degree p the least value is 1 - 3 / (p + 2)^2 of the infimum.

    Both follow from the infimum's own minimiser, g (T t - t^2 / 2), which no F attains: it leaves with g T.
    """
    sample, times = gauss(FALL, 24)
    fall = fall_of(sample, times, degree)
    least = -FALL.material.areal_density * G**2 / 6
    assert fall.functional == pytest.approx(least * (1 - 3 / (degree + 2) ** 2), rel=1e-10)
    assert fall(1.0) / (G / 2) == pytest.approx(1 - 2 / (degree + 2) ** 2, rel=1e-10)


@pytest.mark.long
def test_free_fall_tends_to_three_times_the_true_one_at_half_the_time():
    sample, times = gauss(FALL, 48)
    gaps = [abs(fall_of(sample, times, degree)(0.5) / (G / 8) - 3.0) for degree in (2, 8, 20)]
    assert gaps == sorted(gaps, reverse=True)
    assert gaps[-1] < 0.02
    for degree in (3, 8):  # at rest at T in the limit, by the natural condition: g T / (p + 2) is left
        assert abs(fall_of(sample, times, degree).speed(1.0)) == pytest.approx(G / (degree + 2), rel=1e-8)
    assert fall_of(sample, times, 20).speed(0.05) == pytest.approx(0.95 * G, rel=0.1)  # fastest all but at once


def fall_of(sample, times, degree):
    """Return the minimiser over downward u = t^2 F(t), by the functional's own values on a basis (it is quadratic)."""
    basis = [np.polynomial.legendre.Legendre.basis(k, domain=[0, 1]) for k in range(degree + 1)]

    def planes(f):
        result = torch.zeros((7, *sample.weights.shape, 3), dtype=torch.float64)
        result[0, ..., 2] = HERE.tensor(-(times**2) * f(times))[:, None]
        result[6, ..., 2] = HERE.tensor(-2 * times * f(times) - times**2 * f.deriv()(times))[:, None]
        return result

    modes = [planes(f) for f in basis]

    def value(weights):
        return sample.functional(sum(w * mode for w, mode in zip(weights, modes, strict=True)))

    start = torch.zeros(degree + 1, dtype=torch.float64)
    stiffness = torch.func.hessian(value)(start)
    weights = torch.linalg.solve(stiffness, -torch.func.grad(value)(start))
    f = sum((w * b for w, b in zip(weights.tolist(), basis, strict=True)), start=0.0 * basis[0])
    return Fall(value(weights).item(), f)


@dataclass(frozen=True)
class Fall:
    """The fall t^2 f(t)."""

    functional: float
    f: np.polynomial.legendre.Legendre

    def __call__(self, t):
        return float(t**2 * self.f(t))

    def speed(self, t):
        return float(2 * t * self.f(t) + t**2 * self.f.deriv()(t))


def test_a_network_starts_at_rest_whatever_its_weights():
    siren, sampler = sampler_of(HUNG)
    planes = SpaceTime.at_points(
        sampler.ansatz, "published", inner_points(HUNG), np.array([0.0]), np.ones((1, 20)), HERE
    ).planes(siren)
    assert planes.abs().max().item() < 1e-15
