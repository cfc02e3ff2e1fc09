"""Energy natural gradient: one step moves all weights, those of the output layer included (Mueller & Zeinhofer 2023).

Adam scales the slope of each weight by itself. In a thin shell most changes of weights stretch the midsurface, which is
(L / h)^2 times as stiff as bending, and only few combinations bend it alone. The step

    d = -(G + mu diag G)^-1 g,   G = J^T J,

finds these combinations: g is the gradient of the loss, J has the derivatives of the sampled strains by the weights,
and half |J d|^2 is the strain energy of the field's change. The energy is quadratic in the field, so that this is the
Gauss-Newton step, too. Departures from that paper:

- A draw has too few points for G. G is the running mean of the last draws, from some points of each.
- Strain energy concentrates under a point force. Half of these points are chosen in proportion to their energy.
- The step is halved until the energy of an independent draw falls no further.
- The output layer starts at zero. Otherwise the first steps have to undo random strains a thousand times too large.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

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

# Tuned on the pinched cylinders of the course by certified energy. At a first level of 1e-4 the free cylinder does not
# leave rest within 50 iterations. A matrix that is renewed every fifth iteration from the start needs twice the time.
FIRST_DAMPING, DECAY, DAMPING = 0.1, 0.91, 1e-4  # level at the start, its factor an iteration, least level
POINTS, MEMORY = 400, 0.9  # of a draw, for G, and the share of G that a renewal keeps
EARLY, RENEWAL = 50, 3  # iterations that renew the matrix each; later each third one does
HALVINGS = 8  # of a step, at most; then the weights stay


def flatten(weights: Sequence[Tensor], biases: Sequence[Tensor]) -> Tensor:
    """Return all weights (P,): layer by layer, each unit's weights and then its bias."""
    pairs = zip(weights, biases, strict=True)
    return flatten_layers([torch.cat([weight, bias[:, None]], dim=1) for weight, bias in pairs])


def chosen_points(energies: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Return at most `count` points, half of them in proportion to their energies (N,), and factors of their rows.

    Systematic sampling: point k is expected `count` p_k times, and its energy is divided by that.
    """
    energies = energies + torch.finfo(energies.dtype).tiny
    shares = 0.5 / len(energies) + 0.5 * energies / energies.sum()
    steps = (torch.arange(count, device=shares.device) + 0.5) / count
    found = torch.searchsorted(shares.cumsum(0), steps.to(shares)).clamp_max(len(shares) - 1)
    points, times = torch.unique(found, return_counts=True)
    return points, (times / (count * shares[points])).sqrt()


def strain_jacobian(siren: Siren, sample: Sample, points: Tensor) -> Tensor:
    """Return the derivatives (6 n, P) of the strains at n points of a sample by all weights, as in `flatten`."""
    seen, rows = sample.inputs[:, points], sample.rows[points].view(-1, 6, 3, 6)
    weights, biases = ([siren.omega0 * t for t in layers[:-1]] for layers in (siren.weights, siren.biases))
    network = Network(tuple(weights), tuple(biases), siren.activation)
    features, tape = forward(network, seen[..., : network.weights[0].shape[1]])
    hidden = jacobian(network, tape, rows.mT @ siren.weights[-1][:, : network.width])
    constant = torch.zeros_like(features[..., :1])
    constant[VALUE] = 1.0
    jets = torch.cat([features, seen[..., seen.shape[-1] - siren.beside :], constant], dim=-1).permute(1, 0, 2)
    output = (rows.reshape(-1, 18, 6) @ jets).view(len(hidden), -1)
    return torch.cat([siren.omega0 * hidden, output], dim=1)


@dataclass
class NaturalGradient:
    """The optimiser of a network; see `published_training.Optimiser`.

    Attributes
    ----------
    trials
        Draws for the length of a step, one an iteration.
    iteration
        Number of completed iterations.
    gram
        (P, P): G on and above its diagonal.
    scale, factor
        (P,) root of its diagonal, and the Cholesky factor (P, P) of the scaled and damped matrix.
    """

    network: Siren
    trials: Iterator[Sample]
    iteration: int
    gram: Tensor
    scale: Tensor = field(init=False)
    factor: Tensor = field(init=False)

    @classmethod
    @torch.no_grad()
    def begin(cls, network: Siren, now: Checkpoint, trials: Iterator[Sample]) -> NaturalGradient:
        """Begin or continue a training, whose matrix G takes the place of Adam's second moments."""
        if now.iteration:
            gram = torch.cat(now.second_moments).to(network.tensors[0])
        else:
            gram = network.tensors[0].new_zeros((network.parameters,) * 2)
            for tensor in (network.weights[-1], network.biases[-1]):
                tensor.zero_()
        return cls(network, trials, now.iteration, gram)

    def moments(self) -> tuple[list[Tensor], list[Tensor]]:
        """See `published_training.Optimiser`."""
        none = [torch.zeros_like(tensor) for tensor in self.network.tensors]
        return none, [part.clone() for part in self.gram.tensor_split(len(none))]

    def step(self, sample: Sample, rate: float) -> Tensor:
        """See `published_training.Optimiser`."""
        layers = len(self.network.weights)
        loss = sample.loss(self.network)
        slopes = torch.autograd.grad(loss, self.network.tensors)
        with torch.no_grad():
            slope = flatten(slopes[:layers], slopes[layers:])
            # A checkpoint has no factor: the first iteration after one renews the matrix.
            if self.iteration < EARLY or self.iteration % RECORD % RENEWAL == 0:
                self._renew_matrix(sample)
            step = -rate * torch.cholesky_solve((slope / self.scale)[:, None], self.factor)[:, 0] / self.scale
            self._move_weights(step, next(self.trials))
        self.iteration += 1
        return loss.detach()

    def _renew_matrix(self, sample: Sample) -> None:
        """Add a draw to the matrix, and factorise it."""
        kept = min(MEMORY, self.iteration / (self.iteration + 9))  # less at first, to forget the start
        points, factors = chosen_points(sample.energies(self.network), min(POINTS, len(sample.rows)))
        strains = strain_jacobian(self.network, sample, points).view(len(points), -1)
        self.gram *= kept
        add_gram(self.gram, strains.mul_((1 - kept) ** 0.5 * factors[:, None]).view(-1, len(self.gram)))
        self.scale = self.gram.diagonal().clamp_min(torch.finfo(self.gram.dtype).tiny).sqrt()
        # Cholesky reads the lower half alone, and `add_gram` fills the upper one.
        scaled = (self.gram.mT / self.scale[:, None]).div_(self.scale)
        scaled.diagonal().add_(max(DAMPING, FIRST_DAMPING * DECAY**self.iteration))
        self.factor = torch.linalg.cholesky(scaled)

    def _move_weights(self, step: Tensor, trial: Sample) -> None:
        """Move the weights by the step, halved as long as that lowers the energy of another draw."""
        start = [tensor.clone() for tensor in self.network.tensors]
        moves = self._split_by_tensor(step)

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
        energy(share if now < least else 0.0)

    def _split_by_tensor(self, step: Tensor) -> list[Tensor]:
        """Return a change (P,) as one of each tensor of the network; the inverse of `flatten`."""
        sizes = [weight.numel() + len(weight) for weight in self.network.weights]
        parts = [part.view(len(w), -1) for part, w in zip(torch.split(step, sizes), self.network.weights, strict=True)]
        return [*(part[:, :-1] for part in parts), *(part[:, -1] for part in parts)]
