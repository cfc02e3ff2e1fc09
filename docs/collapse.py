"""Which sample threw the published training of the free cylinder off: `python docs/collapse.py`, some 5 minutes.

Trains as printed, seed 0, for 550 iterations, and shows what the next samples see of that network: the loss, the
largest strain energy of one sample, and the length of the gradient. The training itself goes no further.
"""

from __future__ import annotations

import torch

from shellbench.bench.catalog import named_case
from shellbench.solvers.ndf.published import _Training
from shellbench.solvers.ndf.published_samples import stratified_samples
from shellbench.solvers.ndf.published_solver import PublishedSettings
from shellbench.solvers.ndf.published_training import Plan, beginning, train

LAST, SHOWN = 550, 13


def main() -> None:
    """Print a line for each iteration after the last good ones."""
    case = named_case("pinched_cylinder_free")
    training = _Training.from_case(case, PublishedSettings())
    unit = training.sampler.modulus_factor
    now = train(
        training.siren,
        beginning(training.key, training.siren),
        training.sampler,
        Plan(LAST, 1e-4),
        lambda siren: {},
        lambda told: None,
    )
    network = training.siren.with_tensors([weight.requires_grad_() for weight in now.weights])
    for iteration, sample in enumerate(training.sampler.samples(LAST, LAST + SHOWN), LAST + 1):
        loss, count = sample.loss(network), len(sample.rows)
        length = sum(float(g.square().sum()) for g in torch.autograd.grad(loss, network.tensors)) ** 0.5
        jets = network.jets(sample.inputs).detach()[:, :count].permute(1, 2, 0).reshape(count, 18, 1)
        energy = 0.5 * ((sample.rows @ jets)[..., 0] + sample.offset).square().sum(1)
        xi = stratified_samples(case, (20, 20), 0, iteration - 1)[int(energy.argmax())]
        print(
            f"{iteration}: energy {unit * loss.item():.3g} J, one sample {unit * float(energy.max()):.2g} J at", end=""
        )
        print(f" {xi[0] * 180 / torch.pi:.2f} degrees, {xi[1]:.2f} m; gradient {length:.3g}")


if __name__ == "__main__":
    main()
