"""The published network: a SIREN whose frequency stays outside its weights while it is trained.

Adam moves every weight by about its learning rate whatever the gradient, so omega0 (W h + b) is trained differently
from (omega0 W) h + omega0 b: here the weights are those of Sitzmann et al. (2020), and omega0 is multiplied into them
only when the trained field becomes a `shellbench.solvers.ndf.network.Network` on the inputs of this package.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from shellbench.errors import InputError
from shellbench.solvers.ndf.inputs import Inputs
from shellbench.solvers.ndf.jets import Placement, constant
from shellbench.solvers.ndf.network import Network
from shellbench.solvers.ndf.sine_jet import linear_layer, sine_layer


@dataclass(frozen=True)
class InputScale:
    """The affine map t = factor * c + shift from the package's inputs c to the published ones t.

    Plain coordinates of [-1, 1] are brought to [0, 1] (Kairanda et al., appendix A); cosine and sine of a periodic one
    stay as they are.

    Attributes
    ----------
    factor, shift
        (n,) for the n inputs.
    """

    factor: Tensor
    shift: Tensor

    @classmethod
    def from_inputs(cls, inputs: Inputs, placement: Placement) -> InputScale:
        """Return the map for the inputs of a case."""
        half: list[bool] = []
        for periodic in inputs.case.surface.domain.periodic:
            turns = {"both": [False, False], "cosine": [False], "none": [True]}
            half += turns[inputs.periodic] if periodic else [True]
        halved = torch.tensor([half[k] for k in inputs.kept], device=placement.device)
        factor = torch.where(halved, 0.5, 1.0).to(placement.dtype)
        return cls(factor, 1 - factor)

    def apply(self, jets: Tensor) -> Tensor:
        """Return the jets (6, N, n) of the published inputs."""
        return jets * self.factor + constant(self.shift.expand(jets.shape[1:]))


@dataclass(frozen=True)
class Siren:
    """Trained tensors of a SIREN: F = W_out h + b_out, h <- sin(omega0 (W h + b)).

    Attributes
    ----------
    weights, biases
        Of the hidden layers and, last, of the linear output layer: (out, in) and (out,).
    omega0
        Frequency of every sine.
    """

    weights: tuple[Tensor, ...]
    biases: tuple[Tensor, ...]
    omega0: float

    @property
    def tensors(self) -> list[Tensor]:
        """All that is trained, layer by layer."""
        return [*self.weights, *self.biases]

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(tensor.numel() for tensor in self.tensors)

    def jets(self, inputs: Tensor) -> Tensor:
        """Return the jets (6, N, 3) of F from the jets (6, N, n) of the published inputs."""
        h = inputs
        *hidden, (weight, bias) = zip(self.weights, self.biases, strict=True)
        for w, b in hidden:
            h = sine_layer(h, w, b, self.omega0)
        return linear_layer(h, weight, bias)

    def with_tensors(self, tensors: list[Tensor]) -> Siren:
        """Return the same network with other numbers."""
        layers = len(self.weights)
        return Siren(tuple(tensors[:layers]), tuple(tensors[layers:]), self.omega0)

    def absorbed(self, scale: InputScale, unit: float) -> tuple[Network, Tensor]:
        """Return the field unit * F on the package's inputs: hidden layers, and the output layer (3, M + 1).

        The last column of the output layer is the bias: it multiplies the constant among the fixed features.
        """
        weights = [self.omega0 * w for w in self.weights[:-1]]
        biases = [self.omega0 * b for b in self.biases[:-1]]
        biases[0] = biases[0] + weights[0] @ scale.shift
        weights[0] = weights[0] * scale.factor
        output = unit * torch.cat([self.weights[-1], self.biases[-1][:, None]], dim=1)
        return Network(tuple(weights), tuple(biases)), output

    @classmethod
    def released(cls, network: Network, output: Tensor, omega0: float, scale: InputScale, unit: float) -> Siren:
        """Return the network whose `absorbed` field is this one; the inverse of `absorbed`."""
        weights = [w / omega0 for w in network.weights]
        biases = [b / omega0 for b in network.biases]
        weights[0] = weights[0] / scale.factor
        biases[0] = biases[0] - weights[0] @ scale.shift
        return cls((*weights, output[:, :-1] / unit), (*biases, output[:, -1] / unit), omega0)


def initial_siren(inputs: int, layers: int, width: int, omega0: float, seed: int, placement: Placement) -> Siren:
    """Return a SIREN as initialised by Sitzmann et al. (2020), section 3.2 and their code.

    Weights are U(-1/n, 1/n) in the first layer and U(-sqrt(6/n)/omega0, sqrt(6/n)/omega0) in all others, the output
    layer included; biases are U(-1/sqrt(n), 1/sqrt(n)), the default of a linear layer.
    """
    generator = torch.Generator().manual_seed(seed)
    sizes = [inputs, *[width] * layers, 3]
    weights, biases = [], []
    for layer, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        bound = 1 / fan_in if layer == 0 else math.sqrt(6 / fan_in) / omega0
        weights.append(_uniform(generator, bound, (fan_out, fan_in), placement))
        biases.append(_uniform(generator, 1 / math.sqrt(fan_in), (fan_out,), placement))
    return Siren(tuple(weights), tuple(biases), omega0)


def check_like(siren: Siren, wanted: Siren) -> None:
    """Check that two networks have layers of the same sizes; InputError in one sentence if they have not."""
    for found, expected in zip(_shapes(siren), _shapes(wanted), strict=False):
        if found != expected:
            raise InputError(f"the start has a layer of {found}, but the settings ask for one of {expected}")
    if len(siren.weights) != len(wanted.weights):
        raise InputError(
            f"the start has {len(siren.weights) - 1} hidden layers, but the settings ask for {len(wanted.weights) - 1}"
        )


def _shapes(siren: Siren) -> Iterator[str]:
    yield from (f"{w.shape[1]} x {w.shape[0]}" for w in siren.weights)


def _uniform(generator: torch.Generator, bound: float, shape: tuple[int, ...], placement: Placement) -> Tensor:
    drawn = torch.rand(shape, generator=generator, dtype=torch.float64)
    return ((2 * drawn - 1) * bound).to(device=placement.device, dtype=placement.dtype)
