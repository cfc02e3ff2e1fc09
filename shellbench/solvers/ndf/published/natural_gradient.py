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
from shellbench.solvers.ndf.published.published_training import RECORD
from shellbench.solvers.ndf.strains.energy import add_gram
from shellbench.solvers.ndf.training.gauss_newton import forward, jacobian
from shellbench.solvers.ndf.training.sketch import flatten_layers

FIRST_DAMPING, DECAY = 0.1, 0.91  # the level and its share an iteration later
EARLY, REFRESH = 50, 3  # steps with the same matrix
TINY = 1e-30
HALVINGS = 8  # of a step at most; then the weights stay


def flattened(weights: list[Tensor], biases: list[Tensor]) -> Tensor:
    """Return all weights (P,): layer by layer, each unit's weights and then its bias."""
    pairs = zip(weights, biases, strict=True)
    return flatten_layers([torch.cat([weight, bias[:, None]], dim=1) for weight, bias in pairs])


def chosen_points(energies: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Return about `count` points, half of them in proportion to their energies (N,), and the weights of their rows.

    Systematic sampling: point k is expected `count` p_k times, and its rows are divided by that.
    """
    shares = 0.5 / len(energies) + 0.5 * (energies + TINY) / (energies + TINY).sum()
    steps = (torch.arange(count, device=shares.device) + 0.5) / count
    found = torch.searchsorted(shares.cumsum(0), steps.to(shares)).clamp_max(len(shares) - 1)
    points, times = found.unique(return_counts=True)
    return points, (times / (count * shares[points])).sqrt()


def strain_jacobian(siren: Siren, sample: Sample, part: Tensor) -> Tensor:
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
        if not now.iteration:
            with torch.no_grad():
                for tensor in (network.weights[-1], network.biases[-1]):
                    tensor.zero_()
        return cls(network, trials, memory, damping, points, now.iteration, gram.detach())

    def moments(self) -> tuple[list[Tensor], list[Tensor]]:
        """See `published_training.Optimiser`."""
        none = [torch.zeros_like(tensor) for tensor in self.network.tensors]
        return none, [part.clone() for part in self.gram.tensor_split(len(none))]

    def step(self, sample: Sample, rate: float) -> Tensor:
        """Move the weights, and return the loss before."""
        tensors, layers = self.network.tensors, len(self.network.weights)
        loss = sample.loss(self.network)
        slopes = list(torch.autograd.grad(loss, tensors))
        slope = flattened(slopes[:layers], slopes[layers:])
        with torch.no_grad():
            if self.iteration < EARLY or self.iteration % RECORD % REFRESH == 0:
                self._refresh(sample)
            step = -rate * torch.cholesky_solve((slope / self.scale)[:, None], self.factor)[:, 0] / self.scale
            self._search(step, next(self.trials))
            self.iteration += 1
        return loss.detach()

    def _refresh(self, sample: Sample) -> None:
        """Add a draw to the matrix, and factorise it."""
        kept = min(self.memory, self.iteration / (self.iteration + 9))
        points, roots = chosen_points(sample.energies(self.network), self.points)
        strains = strain_jacobian(self.network, sample, points).view(len(points), -1)
        self.gram *= kept
        add_gram(self.gram, strains.mul_((1 - kept) ** 0.5 * roots[:, None]).view(-1, len(self.gram)))
        self.scale = self.gram.diagonal().clamp_min(torch.finfo(self.gram.dtype).tiny).sqrt()
        # Cholesky reads the lower half alone, and `add_gram` fills the upper one.
        scaled = (self.gram.mT / self.scale[:, None]).div_(self.scale)
        scaled.diagonal().add_(max(self.damping, FIRST_DAMPING * DECAY**self.iteration))
        self.factor = torch.linalg.cholesky(scaled)

    def _search(self, step: Tensor, trial: Sample) -> None:
        """Move the weights by the step, halved as long as that lowers the energy of a draw of its own."""
        start = [tensor.clone() for tensor in self.network.tensors]
        moves = self._by_tensor(step)

        def energy(share: float) -> float:
            for tensor, old, change in zip(self.network.tensors, start, moves, strict=True):
                tensor.copy_(old + share * change)
            return float(trial.loss(self.network))

        least, share, now = energy(0.0), 1.0, energy(1.0)
        for _ in range(HALVINGS):
            half = energy(share / 2)
            if now < min(half, least):
                break
            share, now = share / 2, half
        share = share if now < least else 0.0
        energy(share)
        self.share = share

    def _by_tensor(self, step: Tensor) -> list[Tensor]:
        """Return a change (P,) as one of each tensor of the network; the inverse of `flattened`."""
        sizes = [weight.numel() + len(weight) for weight in self.network.weights]
        parts = [part.view(len(w), -1) for part, w in zip(step.split(sizes), self.network.weights, strict=True)]
        return [*(part[:, :-1] for part in parts), *(part[:, -1] for part in parts)]
