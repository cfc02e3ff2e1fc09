"""The sine layer's hand-written passes against the generic chain rule and automatic differentiation."""

import torch

from shellbench.solvers.ndf.field.jets import VALUE, compose, sine
from shellbench.solvers.ndf.published.published_network import linear_layer, sine_layer


def random(*shape, seed=0):
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def test_forward_is_the_chain_rule():
    h, weight, bias = random(6, 7, 4), random(5, 4, seed=1), random(5, seed=2)
    z = 1.7 * (h @ weight.T)
    z[VALUE] += 1.7 * bias
    torch.testing.assert_close(sine_layer(h, weight, bias, 1.7), compose(sine(z[VALUE]), z), rtol=1e-12, atol=1e-12)


def test_backward_is_the_derivative_of_the_forward_pass():
    tensors = [
        random(6, 3, 4).requires_grad_(),
        random(5, 4, seed=1).requires_grad_(),
        random(5, seed=2).requires_grad_(),
    ]
    assert torch.autograd.gradcheck(lambda *t: sine_layer(*t, 1.7), tensors)
    assert torch.autograd.gradcheck(linear_layer, tensors)


def test_backward_does_not_touch_what_it_is_given():
    h, weight, bias = random(6, 3, 4), random(5, 4, seed=1).requires_grad_(), random(5, seed=2)
    out = sine_layer(h, weight, bias, 2.0)
    g = random(6, 3, 5, seed=3)
    kept = g.clone()
    first = torch.autograd.grad(out, weight, g, retain_graph=True)[0]
    assert torch.equal(g, kept)
    torch.testing.assert_close(first, torch.autograd.grad(out, weight, g)[0])


def test_a_bias_moves_the_value_alone():
    h, weight = random(6, 3, 4), random(2, 4, seed=1)
    moved = linear_layer(h, weight, torch.ones(2, dtype=torch.float64)) - h @ weight.T
    assert torch.allclose(moved[VALUE], torch.ones(3, 2, dtype=torch.float64))
    assert moved[1:].abs().max() < 1e-14
