"""Gauss-Newton in a part of a deep network's weights, if a matrix over all of them is too large.

A step moves the steepest units of the last hidden layer, and all layers before: block coordinates, chosen by the rule
of Gauss & Southwell. On pinched cylinders a quarter of the units has two thirds of the gain of all, in a sixth of the
time; the same number of random directions has a hundredth of the gain.

Each layer moves by U C V^T, and only C is solved for. U and V act on the two ends of a layer's derivatives, before
their product is formed. Therefore no row of the Jacobian is as long as the number of weights.

The module also has hidden layers at points, and the derivatives through a layer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.jets import D1, D2, D11, D12, D22, VALUE
from shellbench.solvers.ndf.field.network import Network


@dataclass(frozen=True)
class Sketch:
    """Directions U C V^T of each layer (m units, n inputs and a bias).

    Attributes
    ----------
    left, right
        U (m, a) and V (n + 1, b) of each layer, with orthonormal columns.
    """

    left: tuple[Tensor, ...]
    right: tuple[Tensor, ...]

    @classmethod
    def from_steepest(cls, network: Network, slope: Tensor, directions: int) -> Sketch:
        """Return about `directions` weights of the steepest units of the last hidden layer, and all weights before it.

        The steepest units have the largest part of the gradient `slope` (P,).
        """
        like = network.weights[0]
        left = [torch.eye(len(weight)).to(like) for weight in network.weights]
        right = [torch.eye(weight.shape[1] + 1).to(like) for weight in network.weights]
        units, inputs = len(left[-1]), len(right[-1])
        steepness = slope[-units * inputs :].view(units, inputs).norm(dim=1)
        chosen = torch.topk(steepness, min(units, max(1, directions // inputs))).indices
        left[-1] = left[-1][:, chosen]
        return cls(tuple(left), tuple(right))

    @property
    def count(self) -> int:
        """Number of directions."""
        return sum(u.shape[1] * v.shape[1] for u, v in zip(self.left, self.right, strict=True))

    def rows(self, network: Network, tape: list[Layer], seed: Tensor) -> Tensor:
        """Return the rows (N S, count) of d(functional)/dC; `seed` as in `gauss_newton.jacobian`."""
        count, rows = seed.shape[:2]
        blocks: list[Tensor] = []
        layers = list(zip(network.weights, tape, self.left, self.right, strict=True))
        for weight, layer, u, v in reversed(layers):
            seed = through_activation(layer, seed)
            one, other = seed @ u, layer.inputs @ v[:-1]
            other[VALUE] += v[-1]
            blocks.append((one.transpose(2, 3) @ other.permute(1, 0, 2)[:, None]).reshape(count * rows, -1))
            if len(blocks) < len(layers):
                seed = seed @ weight
        return torch.cat(blocks[::-1], dim=1)

    def restrict(self, gradient: Tensor) -> Tensor:
        """Return the derivatives (count,) by C, from those by all weights (P,)."""
        parts = self._by_layer(gradient, [(len(u), len(v)) for u, v in zip(self.left, self.right, strict=True)])
        return flatten_layers([u.T @ part @ v for u, part, v in zip(self.left, parts, self.right, strict=True)])

    def extend(self, change: Tensor) -> Tensor:
        """Return the change (P,) of all weights by a change (count,) of C."""
        sizes = [(u.shape[1], v.shape[1]) for u, v in zip(self.left, self.right, strict=True)]
        parts = self._by_layer(change, sizes)
        return flatten_layers([u @ part @ v.T for u, part, v in zip(self.left, parts, self.right, strict=True)])

    @staticmethod
    def _by_layer(vector: Tensor, shapes: Sequence[tuple[int, int]]) -> list[Tensor]:
        parts = torch.split(vector, [a * b for a, b in shapes])
        return [part.view(shape) for part, shape in zip(parts, shapes, strict=True)]


class Layer(NamedTuple):
    """Data of a layer for the sweep: input jets (6, N, n), z (6, N, m), and sigma', sigma'', sigma''' (N, m)."""

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
        (N, S, 6, m): factors of the planes of sigma(z) in functional S at a point.
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
