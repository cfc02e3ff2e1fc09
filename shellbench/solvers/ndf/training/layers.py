"""Hidden layers at points, and how a derivative goes through one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.jets import D1, D2, D11, D12, D22, VALUE


class Layer(NamedTuple):
    """What the sweep needs of a layer: input jets (6, N, n), z (6, N, m), and sigma', sigma'', sigma''' (N, m)."""

    inputs: Tensor
    z: Tensor
    first: Tensor
    second: Tensor
    third: Tensor


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


def flatten_layers(matrices: Sequence[Tensor]) -> Tensor:
    """Return the entries of matrices, one after the other, row by row."""
    return torch.cat([matrix.reshape(-1) for matrix in matrices])
