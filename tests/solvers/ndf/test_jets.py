"""Jets against nested reverse differentiation, and the refusal of what has no second derivatives."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from shellbench.bench.catalogue import catalog
from shellbench.errors import InputError
from shellbench.solvers.ndf.field import jets
from shellbench.solvers.ndf.field.build import build_ansatz, build_features, build_inputs
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.jets import (
    ACTIVATIONS,
    D1,
    D2,
    D11,
    D12,
    D22,
    VALUE,
    Placement,
    activation,
    smooth_activation,
)
from shellbench.solvers.ndf.field.network import Network, deep_random_features, random_features
from shellbench.solvers.ndf.linear.declines import why_declined
from tests.families import stated, with_something_new

PLACEMENT = Placement()


def drawn_network(points, widths, name):
    scales = torch.full((2,), 2.0, dtype=torch.float64)
    return deep_random_features(torch.tensor(points), scales, widths, seed=3, name=name)


def by_autograd(function, points):
    """Jet (6, N, M) of function: (N, 2) -> (N, M), one derivative after the other."""
    xi = torch.tensor(points, requires_grad=True)
    values = function(xi)
    columns = []
    for column in range(values.shape[1]):
        (first,) = torch.autograd.grad(values[:, column].sum(), xi, create_graph=True)
        (d1,) = torch.autograd.grad(first[:, 0].sum(), xi, retain_graph=True)
        (d2,) = torch.autograd.grad(first[:, 1].sum(), xi, retain_graph=True)
        columns.append(torch.stack([values[:, column], first[:, 0], first[:, 1], d1[:, 0], d1[:, 1], d2[:, 1]]))
    return torch.stack(columns, dim=-1).detach()


def plain_inputs(points):
    return torch.stack(jets.coordinates(points, PLACEMENT), dim=-1)


@pytest.fixture
def points():
    return np.random.default_rng(0).uniform(-1, 1, (7, 2))


@pytest.mark.parametrize("name", ACTIVATIONS)
@pytest.mark.parametrize("depth", [1, 2, 4])
def test_network_jets_match_nested_differentiation(name, depth, points):
    network = drawn_network(points, (5,) * depth, name)
    functions = {"sine": torch.sin, "tanh": torch.tanh, "gelu": torch.nn.functional.gelu, "relu": torch.relu}

    def plain(h):
        for weight, bias in zip(network.weights, network.biases, strict=True):
            h = functions[name](h @ weight.T + bias)
        return h

    found = network.features(plain_inputs(points))
    torch.testing.assert_close(found, by_autograd(plain, points), rtol=1e-11, atol=1e-12)
    torch.testing.assert_close(network.values(torch.tensor(points)), found[VALUE], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("name", ACTIVATIONS)
def test_jets_differentiate_in_the_weights_as_well(name, points):
    network = drawn_network(points, (4, 3), name)
    probe = torch.randn(6, len(points), 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    def loss(*tensors):
        return (Network(tensors[:2], tensors[2:], name).features(plain_inputs(points)) * probe).sum()

    leaves = [t.clone().requires_grad_() for t in (*network.weights, *network.biases)]
    assert torch.autograd.gradcheck(loss, leaves, eps=1e-6, atol=1e-6)
    assert loss(*leaves).item() == pytest.approx(loss(*network.weights, *network.biases).item(), rel=1e-13)


@pytest.mark.parametrize("name", ["sine", "tanh", "gelu", "cosine"])
def test_each_derivative_of_an_activation_is_the_slope_of_the_one_before(name):
    z = torch.linspace(-2.5, 2.5, 11, dtype=torch.float64, requires_grad=True)
    derivatives = getattr(jets, name)(z, 3)
    assert len(derivatives) == 4
    for lower, higher in pairwise(derivatives):
        (slope,) = torch.autograd.grad(lower.sum(), z, retain_graph=True)
        torch.testing.assert_close(higher, slope, rtol=1e-10, atol=1e-12)


def test_products_follow_the_product_rule(points):
    xi1, xi2 = jets.coordinates(points, PLACEMENT)
    cube = jets.product(jets.product(xi1, xi1), xi2)
    a, b = torch.tensor(points).unbind(1)
    expected = {VALUE: a * a * b, D1: 2 * a * b, D2: a * a, D11: 2 * b, D12: 2 * a, D22: 0 * a}
    for plane, value in expected.items():
        torch.testing.assert_close(cube[plane], value)


def test_cross_product_and_power_match_nested_differentiation(points):
    def vectors(xi):
        u = torch.stack([torch.sin(xi[:, 0]), xi[:, 1] ** 2, 1 + xi[:, 0] * xi[:, 1]], -1)
        v = torch.stack([torch.exp(xi[:, 1]), xi[:, 0], 2 - xi[:, 1]], -1)
        return u, v

    u, v = (by_autograd(lambda xi, k=k: vectors(xi)[k], points) for k in (0, 1))
    found = jets.cross(u, v)
    torch.testing.assert_close(found, by_autograd(lambda xi: torch.linalg.cross(*vectors(xi)), points))
    root = jets.power(jets.dot(u, u), -0.5)
    norm = by_autograd(lambda xi: 1 / vectors(xi)[0].norm(dim=-1, keepdim=True), points)
    torch.testing.assert_close(root[..., None], norm)


def test_relu_is_refused_with_the_reason():
    with pytest.raises(InputError, match=r"second derivatives vanish.* allowed are gelu, sine, tanh"):
        smooth_activation("relu")
    for named in (activation, smooth_activation):
        with pytest.raises(InputError, match="allowed are sine"):
            named("swish")


def test_random_features_follow_their_seed():
    scales = torch.tensor([3.0, 1.0, 2.0], dtype=torch.float64)
    first, again, other = (random_features(scales, 2000, seed) for seed in (4, 4, 5))
    assert torch.equal(first.weights[0], again.weights[0])
    assert torch.equal(first.biases[0], again.biases[0])
    assert not torch.equal(first.weights[0], other.weights[0])
    torch.testing.assert_close(first.weights[0].std(0), scales, rtol=0.1, atol=0)
    assert first.biases[0].abs().max() <= np.pi
    assert first.biases[0].std().item() == pytest.approx(np.pi / np.sqrt(3), rel=0.1)
    assert first.parameters == 2000 * 4


LINEAR = [name for name in catalog.case_names() if stated(name)["theory"] == "kirchhoff-love-linear"]


@pytest.mark.parametrize("name", with_something_new(LINEAR))
def test_values_are_those_of_jets_and_carry_no_derivatives(name):
    case = catalog.named_case(name)
    if why_declined(case):
        pytest.skip("no field can hold it")
    spec = FieldSpec()
    inputs, points = build_inputs(case, spec), case.surface.domain.grid(6, 7).reshape(-1, 2)
    network = random_features(PLACEMENT.tensor(np.full(inputs.count, 2.0)), 5, seed=0)
    features, ansatz = build_features(case, spec, network, PLACEMENT, inputs), build_ansatz(case, spec)
    parts = [inputs.jets, features.fixed.jets, ansatz.factors.matrix]
    for part in parts:
        whole, values = part(points, PLACEMENT), part(points, PLACEMENT.of_values)
        assert values.shape == (1, *whole.shape[1:])
        assert torch.allclose(values[VALUE], whole[VALUE], rtol=1e-14, atol=1e-14)
    assert torch.allclose(features.values(points), features.jets(points)[VALUE], rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("name", ["sine", "cosine"])
def test_a_function_alone_is_asked_for_nothing_else(name, monkeypatch):
    asked = []
    for function in ("sin", "cos"):
        original = getattr(torch, function)
        monkeypatch.setattr(torch, function, lambda z, f=function, original=original: asked.append(f) or original(z))
    found = getattr(jets, name)(torch.ones(3), 0)
    assert (len(found), asked) == (1, [name[:3]])
