"""The reverse sweep through a network's jets: how strains change with the hidden weights.

Any linear functional of the feature jets (a strain row, or all of the energy's gradient) is pulled back layer by layer.
One sweep serves many functionals at once, and no graph is kept.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from shellbench.solvers.ndf.jets import D1, D2, D11, D12, D22, VALUE, activation, compose
from shellbench.solvers.ndf.network import Network


class Layer(NamedTuple):
    """What the sweep needs of a layer: input jets (6, N, n), z (6, N, m), and sigma', sigma'', sigma''' (N, m)."""

    inputs: Tensor
    z: Tensor
    first: Tensor
    second: Tensor
    third: Tensor


def forward(network: Network, inputs: Tensor) -> tuple[Tensor, list[Layer]]:
    """Return the feature jets (6, N, M) of input jets (6, N, n), and what the sweep back needs."""
    function, h, tape = activation(network.activation), inputs, []
    for weight, bias in zip(network.weights, network.biases, strict=True):
        z = h @ weight.T
        z[VALUE] += bias
        f0, f1, f2, f3 = function(z[VALUE], 3)
        tape.append(Layer(h, z, f1, f2, f3))
        h = compose((f0, f1, f2), z)
    return h, tape


def through_activation(layer: Layer, seed: Tensor) -> Tensor:
    """Pull functionals of sigma(z) back to functionals of z: the chain rule for jets, transposed.

    Parameters
    ----------
    seed
        (N, S, 6, m): with which factor each plane of sigma(z) enters functional S at a point.
    """
    z1, z2, z11, z12, z22 = (layer.z[plane][:, None] for plane in (D1, D2, D11, D12, D22))
    f1, f2, f3 = layer.first[:, None], layer.second[:, None], layer.third[:, None]
    result = seed * f1[:, :, None]
    c11, c12, c22 = seed[:, :, D11], seed[:, :, D12], seed[:, :, D22]
    bend = seed[:, :, D1] * z1
    bend.addcmul_(seed[:, :, D2], z2).addcmul_(c11, z11).addcmul_(c12, z12).addcmul_(c22, z22)
    slope1, slope2 = c11 * z1, c22 * z2
    twist = slope1 * z1
    twist.addcmul_(slope2, z2).addcmul_(c12, z1 * z2)
    result[:, :, VALUE].addcmul_(f2, bend).addcmul_(f3, twist)
    result[:, :, D1].addcmul_(f2, slope1.mul_(2).addcmul_(c12, z2))
    result[:, :, D2].addcmul_(f2, slope2.mul_(2).addcmul_(c12, z1))
    return result


def jacobian(network: Network, tape: list[Layer], seed: Tensor) -> Tensor:
    """Return the rows (N S, P) of d(functional)/d(weights), in the order of `flatten`.

    Parameters
    ----------
    seed
        (N, S, 6, M): S functionals of the feature jets at each point.
    """
    count, rows = seed.shape[:2]
    result = seed.new_empty((count, rows, network.parameters))
    end = network.parameters
    for weight, layer in zip(reversed(network.weights), reversed(tape), strict=True):
        seed = through_activation(layer, seed)
        units, width = weight.shape
        start = end - units * (width + 1)
        block = result[:, :, start:end].view(count, rows, units, width + 1)
        block[..., :-1] = seed.transpose(2, 3) @ layer.inputs.permute(1, 0, 2)[:, None]
        block[..., -1] = seed[:, :, VALUE]
        end = start
        if end:
            seed = seed @ weight
    return result.view(count * rows, -1)


def gradient(network: Network, tape: list[Layer], seed: Tensor) -> Tensor:
    """Return (P,), the derivative of one functional that sums over points, from its `seed` (N, 6, M)."""
    parts: list[Tensor] = []
    seed = seed[:, None]
    for weight, layer in zip(reversed(network.weights), reversed(tape), strict=True):
        seed = through_activation(layer, seed)
        flat = seed.permute(2, 0, 1, 3).reshape(-1, len(weight))
        slope = flat.T @ layer.inputs.reshape(-1, weight.shape[1])
        parts.append(torch.cat([slope, seed[:, 0, VALUE].sum(0)[:, None]], dim=1).reshape(-1))
        if len(parts) < len(tape):
            seed = seed @ weight
    return torch.cat(parts[::-1])


def flatten(network: Network) -> Tensor:
    """Return all weights (P,): layer by layer, each unit's weights and then its bias."""
    pairs = zip(network.weights, network.biases, strict=True)
    return torch.cat([torch.cat([weight, bias[:, None]], dim=1).reshape(-1) for weight, bias in pairs])


def unflatten(vector: Tensor, like: Network) -> Network:
    """Return a network of the same shape with the weights (P,)."""
    sizes = [weight.numel() + len(weight) for weight in like.weights]
    blocks = [part.view(len(weight), -1) for part, weight in zip(torch.split(vector, sizes), like.weights, strict=True)]
    return Network(
        tuple(block[:, :-1].contiguous() for block in blocks),
        tuple(block[:, -1].contiguous() for block in blocks),
        like.activation,
    )
