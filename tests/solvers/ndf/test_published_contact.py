"""The published loss of collisions."""

import numpy as np
import pytest
import torch

from shellbench.solvers.ndf.published.published import why_not_held
from shellbench.solvers.ndf.published.published_motion_field import MARGIN, WEIGHT, collision, contact_forces
from tests.solvers.ndf.motions import NAPKIN, G, gravity, moving
from tests.solvers.ndf.test_published_motion_loss import sampler_of

FALLING = {"kind": "sphere", "centre": [0.5, 0.5, "-0.35 - t"], "radius": 0.3}
CASE = moving(NAPKIN, obstacles=[FALLING], loads=[gravity(0, 0, -G)])
POINTS, TIMES = np.array([[0.5, 0.5], [0.4, 0.6], [0.1, 0.9]]), np.array([0.1, 0.2])
DOWN = np.array([[[0, 0, -0.15], [0.01, 0, -0.2], [0, 0, -0.1]], [[0, 0, -0.2], [0, 0, -0.3], [0, 0, -0.4]]])


def test_the_loss_is_linear_in_the_depth_and_its_slope_is_the_pressure():
    """At the centre the ball's top is at -.05 - t: touched within the margin, and .1 m deep at t = .2 with u = -.35."""
    u = torch.tensor(DOWN, requires_grad=True)
    density = collision(CASE, POINTS, TIMES, u)
    x = np.concatenate([POINTS, np.zeros((3, 1))], axis=1) + DOWN
    centre = np.stack([[0.5, 0.5, -0.35 - t] for t in TIMES])[:, None]
    gap = np.linalg.norm(x - centre, axis=-1) - 0.3
    np.testing.assert_allclose(density.detach().numpy(), WEIGHT * np.maximum(MARGIN - gap, 0), rtol=1e-12)
    assert 0 < (density > 0).sum() < density.numel()
    (slope,) = torch.autograd.grad(density.sum(), u)
    for k, t in enumerate(TIMES):
        forces = contact_forces(CASE, POINTS, np.ones(3), float(t), DOWN[k])
        np.testing.assert_allclose(-slope[k].numpy(), forces, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(forces, axis=1), WEIGHT * (gap[k] < MARGIN))


def test_the_functional_has_it_with_the_weights_of_the_samples():
    siren, sampler = sampler_of(CASE)
    _, free = sampler_of(moving(NAPKIN, loads=[gravity(0, 0, -G)]))
    (with_ball,), (without,) = sampler.samples(0, 1), free.samples(0, 1)
    planes = with_ball.planes(siren)
    planes[0, ..., 2] -= 0.2
    more = (with_ball.weights * collision(CASE, *with_ball.places, planes[0])).sum()
    assert (with_ball.functional(planes) - without.functional(planes)).item() == pytest.approx(more.item(), rel=1e-9)
    assert more > 0


def test_friction_and_obstacles_at_rest_are_declined():
    assert "friction" in why_not_held(moving(NAPKIN, obstacles=[{**FALLING, "friction": 0.1}]))
    assert why_not_held(CASE) is None
