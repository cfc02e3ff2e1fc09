"""Energy natural gradient: one step moves all weights, those of the output layer included (Mueller & Zeinhofer 2023).

Adam knows of each weight how steep the loss is, and nothing of how weights act together. In a thin shell most changes
of weights stretch the midsurface, which is (L / h)^2 as stiff as bending, and few combinations of them only bend it. A
step d = -(G + mu diag G)^-1 g knows all combinations: G = J^T J, J being the derivatives of the sampled strains by the
weights, so that half |J d|^2 is the strain energy of the field's change. The energy is quadratic in the field;
therefore this is also the Gauss-Newton step.

Departures from the paper: a draw of a few hundred points has fewer strains than the network has weights, so that G is a
running mean over draws. Its level of damping is Marquardt's. The step is halved until the energy falls on a draw of its
own, since the draw of the gradient is exploited.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from shellbench.solvers.ndf.field.jets import VALUE
from shellbench.solvers.ndf.field.network import Network
from shellbench.solvers.ndf.published.checkpoint import Checkpoint
from shellbench.solvers.ndf.published.published_network import Siren
from shellbench.solvers.ndf.published.published_samples import Sample
from shellbench.solvers.ndf.strains.energy import add_gram, mirrored
from shellbench.solvers.ndf.training.gauss_newton import Quadratic, forward, jacobian
from shellbench.solvers.ndf.training.sketch import flatten_layers

HALVINGS = 8  # of a step at most; then the weights stay


def flattened(weights: list[Tensor], biases: list[Tensor]) -> Tensor:
    """Return all weights (P,): layer by layer, each unit's weights and then its bias."""
    pairs = zip(weights, biases, strict=True)
    return flatten_layers([torch.cat([weight, bias[:, None]], dim=1) for weight, bias in pairs])


def strain_jacobian(siren: Siren, sample: Sample, part: slice) -> Tensor:
    """Return the derivatives (6 N, P) of the strains at a part of a sample by all weights, as in `flattened`."""
    seen, rows = sample.inputs[:, : len(sample.rows)][:, part], sample.rows[part].view(-1, 6, 3, 6)
    network = Network(
        tuple(siren.omega0 * w for w in siren.weights[:-1]),
        tuple(siren.omega0 * b for b in siren.biases[:-1]),
        siren.activation,
    )
    features, tape = forward(network, seen[..., : network.weights[0].shape[1]])
    hidden = jacobian(network, tape, rows.mT @ siren.weights[-1][:, : network.width])
    constant = torch.zeros_like(features[..., :1])
    constant[VALUE] = 1.0
    jets = torch.cat([features, seen[..., seen.shape[-1] - siren.beside :], constant], dim=-1).permute(1, 0, 2)
    output = (rows.reshape(-1, 18, 6) @ jets).view(len(hidden), -1)
    return torch.cat([siren.omega0 * hidden, output], dim=1)


@dataclass
class NaturalGradient:
    """The optimiser of a network; see `published_training.Optimiser`."""

    network: Siren
    trials: Iterator[Sample]
    memory: float
    damping: float
    points: int
    iteration: int
    gram: Tensor

    @classmethod
    def begin(
        cls, network: Siren, now: Checkpoint, trials: Iterator[Sample], memory: float, damping: float, points: int
    ) -> NaturalGradient:
        """Continue a training, whose Gram matrix takes the place of Adam's second moments."""
        place, count = network.tensors[0], network.parameters
        gram = torch.cat(now.second_moments).to(place) if now.iteration else place.new_zeros((count, count))
        return cls(network, trials, memory, damping, points, now.iteration, gram.detach())

    def moments(self) -> tuple[list[Tensor], list[Tensor]]:
        """See `published_training.Optimiser`."""
        zeros = [torch.zeros_like(t) for t in self.network.tensors]
        return zeros, [part.clone() for part in self.gram.tensor_split(len(zeros))]

    def step(self, sample: Sample, rate: float) -> Tensor:
        """Move the weights, and return the loss before."""
        tensors, layers = self.network.tensors, len(self.network.weights)
        loss = sample.loss(self.network)
        slopes = list(torch.autograd.grad(loss, tensors))
        slope = flattened(slopes[:layers], slopes[layers:])
        with torch.no_grad():
            kept = min(self.memory, self.iteration / (self.iteration + 9))
            self.gram *= kept
            every = max(1, len(sample.rows) // self.points)
            part = slice(self.iteration % every, None, every)
            strains = strain_jacobian(self.network, sample, part)
            add_gram(self.gram, strains.mul_(((1 - kept) * every) ** 0.5))
            matrix = mirrored(self.gram)
            step = Quadratic(slope, matrix, matrix.diagonal()).step(self.damping)
            self.iteration += 1
            trial = next(self.trials)
            if step is not None:
                self._move(rate * step, trial)
        return loss.detach()

    def _move(self, step: Tensor, trial: Sample) -> None:
        start = [tensor.clone() for tensor in self.network.tensors]
        changes, position = [], 0
        for weight in self.network.weights:
            size = weight.numel() + len(weight)
            changes.append(step[position : position + size].view(len(weight), -1))
            position += size
        moves = [*(c[:, :-1] for c in changes), *(c[:, -1] for c in changes)]
        before, share = trial.loss(self.network), 1.0
        for _ in range(HALVINGS):
            for tensor, old, change in zip(self.network.tensors, start, moves, strict=True):
                tensor.copy_(old + share * change)
            if trial.loss(self.network) < before:
                self.share = share
                return
            share /= 2
        self.share = 0.0
        for tensor, old in zip(self.network.tensors, start, strict=True):
            tensor.copy_(old)
