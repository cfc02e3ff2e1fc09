"""A sine layer on second-order jets with its backward pass written by hand.

`jets` leaves the backward pass to automatic differentiation, which takes a sine layer apart into some
twenty products and keeps every one of them. A layer h <- sin(omega (W h + b)) needs only z, its sine and its cosine
again: with z_1, z_11, ... the planes of z and g those of the incoming gradient, the chain rule

    sin(z)_1 = cos(z) z_1,   sin(z)_11 = cos(z) z_11 - sin(z) z_1^2,   sin(z)_12 = cos(z) z_12 - sin(z) z_1 z_2

transposes to a handful of fused products, and the matrix products of all six planes stay one.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd import Function
from torch.autograd.function import FunctionCtx

from shellbench.solvers.ndf.jets import D1, D2, D11, D12, D22, VALUE


def sine_layer(h: Tensor, weight: Tensor, bias: Tensor, omega: float) -> Tensor:
    """Return the jets (6, N, m) of sin(omega (W h + b)) (Sitzmann et al. 2020).

    Parameters
    ----------
    h
        (6, N, n) jets of the layer below.
    weight, bias
        (m, n) and (m,).
    omega
        Frequency.
    """
    result: Tensor = _SineLayer.apply(h, weight, bias, omega)  # type: ignore[no-untyped-call]
    return result


def linear_layer(h: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """Return the jets (6, N, m) of W h + b."""
    constant = torch.zeros_like(h[:, :1, :1])
    constant[VALUE] = 1.0
    return h @ weight.T + constant * bias


class _SineLayer(Function):
    @staticmethod
    def forward(ctx: Any, h: Tensor, weight: Tensor, bias: Tensor, omega: float) -> Tensor:
        z = h @ (omega * weight).T
        z[VALUE] += omega * bias
        sine, cosine = torch.sin(z[VALUE]), torch.cos(z[VALUE])
        ctx.save_for_backward(h, weight, z, sine, cosine)
        ctx.omega = omega
        jet = torch.empty_like(z)
        jet[VALUE] = sine
        torch.mul(cosine, z[1:], out=jet[1:])
        s1, s2 = sine * z[D1], sine * z[D2]
        jet[D11].addcmul_(s1, z[D1], value=-1)
        jet[D12].addcmul_(s1, z[D2], value=-1)
        jet[D22].addcmul_(s2, z[D2], value=-1)
        return jet

    @staticmethod
    def backward(ctx: FunctionCtx, *gradients: Any) -> tuple[Tensor | None, Tensor, Tensor, None]:
        h, weight, z, sine, cosine = ctx.saved_tensors  # type: ignore[attr-defined]
        (g,) = gradients
        omega: float = ctx.omega  # type: ignore[attr-defined]
        dz = cosine * g
        s1, s2 = sine * z[D1], sine * z[D2]
        dz[D1].addcmul_(s1, g[D11], value=-2).addcmul_(s2, g[D12], value=-1)
        dz[D2].addcmul_(s2, g[D22], value=-2).addcmul_(s1, g[D12], value=-1)
        through_sine = (z[1:] * g[1:]).sum(0)
        dz[VALUE].addcmul_(sine, through_sine, value=-1)
        through_cosine = z[D1] * g[D11]
        through_cosine.addcmul_(z[D2], g[D12]).mul_(z[D1]).addcmul_(z[D2].square(), g[D22])
        dz[VALUE].addcmul_(cosine, through_cosine, value=-1)
        flat = dz.flatten(0, 1)
        to_weight = omega * (flat.T @ h.flatten(0, 1))
        to_bias = omega * dz[VALUE].sum(0)
        to_input = dz @ (omega * weight) if ctx.needs_input_grad[0] else None  # type: ignore[attr-defined]
        return to_input, to_weight, to_bias, None
