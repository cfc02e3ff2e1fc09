"""The network whose last hidden layer gives the features of a field."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.jets import VALUE, activation, compose


@dataclass(frozen=True)
class Network:
    """Hidden layers h <- sigma(W h + b).

    The linear output layer is not part of it: recipes that solve for it treat it differently.

    Attributes
    ----------
    weights, biases
        Of each layer: (out, in) and (out,).
    activation
        Name in `shellbench.solvers.ndf.field.jets.ACTIVATIONS`.
    """

    weights: tuple[Tensor, ...]
    biases: tuple[Tensor, ...]
    activation: str = "sine"

    def __post_init__(self) -> None:
        # Rows are contiguous, as in a file: products of other layouts round differently, so that a loaded field would
        # differ.
        for name in ("weights", "biases"):
            object.__setattr__(self, name, tuple(t.contiguous() for t in getattr(self, name)))

    def to(self, like: torch.dtype | Tensor) -> Network:
        """Return the network in a number format, or in the format and on the device of a tensor."""
        weights, biases = (tuple(t.to(like) for t in layers) for layers in (self.weights, self.biases))
        return replace(self, weights=weights, biases=biases)

    def features(self, inputs: Tensor) -> Tensor:
        """Return the jets (6, N, M) of the last hidden layer from the jets (6, N, n) of the inputs."""
        function, h = activation(self.activation), inputs
        for weight, bias in zip(self.weights, self.biases, strict=True):
            z = h @ weight.T
            if z.requires_grad:
                z = torch.cat([z[:1] + bias, z[1:]])
            else:
                z[VALUE] += bias
            h = compose(function(z[VALUE], 2), z)
        return h

    def values(self, inputs: Tensor) -> Tensor:
        """Return the values (N, M) of the last hidden layer from the values (N, n) of the inputs."""
        function, h = activation(self.activation), inputs
        for weight, bias in zip(self.weights, self.biases, strict=True):
            h = function(h @ weight.T + bias, 0)[0]
        return h

    @property
    def width(self) -> int:
        """Number of features M."""
        return self.weights[-1].shape[0]

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(t.numel() for t in (*self.weights, *self.biases))

    def first_features(self, width: int) -> Network:
        """Return the network with the first `width` features only."""
        return replace(
            self,
            weights=(*self.weights[:-1], self.weights[-1][:width]),
            biases=(*self.biases[:-1], self.biases[-1][:width]),
        )


def random_features(scales: Tensor, width: int, seed: int, name: str = "sine") -> Network:
    """Return one layer of random features, W ~ N(0, scales^2) and b ~ U(-pi, pi) (Rahimi & Recht 2007).

    Parameters
    ----------
    scales
        (n,) standard deviation of the weights of each input.
    """
    generator = torch.Generator().manual_seed(seed)
    draws = torch.randn((width, len(scales)), generator=generator, dtype=torch.float64)
    phases = torch.rand((width,), generator=generator, dtype=torch.float64)
    weight = draws.to(scales) * scales
    return Network((weight,), (((2 * phases - 1) * math.pi).to(scales),), name)


def deep_random_network(inputs: int, widths: tuple[int, ...], seed: int, name: str) -> Network:
    """Return a deep network as usually drawn: W ~ N(0, 1 / inputs of the layer), b ~ U(-pi, pi).

    `inputs` is the number of the network's inputs, `widths` are those of its hidden layers.
    """
    generator = torch.Generator().manual_seed(seed)
    weights, biases = [], []
    for before, width in pairwise((inputs, *widths)):
        weights.append(torch.randn((width, before), generator=generator, dtype=torch.float64) / math.sqrt(before))
        biases.append(math.pi * (2 * torch.rand((width,), generator=generator, dtype=torch.float64) - 1))
    return Network(tuple(weights), tuple(biases), name)


# Of the first map, times sqrt(n / m), and half width of the inner layers' biases: sines of such arguments are nearly
# linear. Much larger ones start far too stiff on shells; how the energy depends on them nearby is not on record.
SQUEEZE, SHIFT = 0.25, 0.2
RIDGE = 1e-8  # of the fit of the last hidden layer, of a feature's mean square; neighbours are not on record


def deep_random_features(inputs: Tensor, scales: Tensor, widths: tuple[int, ...], seed: int, name: str) -> Network:
    """Return a deep network that starts as one layer of random features sigma(W z + b).

    Inner layers are nearly linear orthogonal maps; the last hidden layer is fitted by ridge regression to the targets
    W z, W ~ N(0, scales^2), with b ~ U(-pi, pi). Drawn at random, a deep sine network starts far too stiff on shells.

    Parameters
    ----------
    inputs
        (N, n) values of the inputs at sample points.
    scales
        (n,) standard deviation of the weights of each input, or (M, n) if the features have scales of their own.
    widths
        Of the hidden layers.
    """
    generator = torch.Generator().manual_seed(seed)
    function, h, count = activation(name), inputs, inputs.shape[1]

    def drawn(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator, dtype=torch.float64).to(inputs)

    def spread(bound: float, size: int) -> Tensor:
        return bound * (2 * torch.rand((size,), generator=generator, dtype=torch.float64).to(inputs) - 1)

    weights, biases = [], []
    for layer, width in enumerate(widths[:-1]):
        gain = SQUEEZE * math.sqrt(count / width) if layer == 0 else 1.0
        size = max(width, h.shape[1])
        rotation, _ = torch.linalg.qr(drawn(size, size))
        weights.append(gain * rotation[:width, : h.shape[1]])
        biases.append(spread(SHIFT, width))
        h = function(h @ weights[-1].T + biases[-1], 0)[0]
    targets = inputs @ (drawn(widths[-1], count) * scales).T
    design = torch.cat([h, torch.ones_like(h[:, :1])], dim=1)
    normal = design.T @ design
    normal.diagonal().add_(RIDGE * len(h))
    last = torch.linalg.solve(normal, design.T @ targets).T
    weights.append(last[:, :-1].contiguous())
    biases.append(last[:, -1] + spread(math.pi, widths[-1]))
    return Network(tuple(weights), tuple(biases), name)
