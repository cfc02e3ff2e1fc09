"""The failure of the published training on the free cylinder: `python docs/collapse.py`, some 5 minutes.

Trains as printed, then prints for each further iteration the loss of its samples, its membrane and bending parts, the
largest strain energy of one sample, and the length of the gradient. With seed 0 the network stays as it was after 550
iterations, which shows the one sample that stands out. `--seed 1 --last 925 --shown 40 --going-on` trains on, which
shows the growth of the membrane energy.
"""

from __future__ import annotations

import argparse

import torch

from shellbench.bench.catalogue.catalog import named_case
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.published.published import _Training
from shellbench.solvers.ndf.published.published_network import Siren
from shellbench.solvers.ndf.published.published_samples import Sample, stratified_samples
from shellbench.solvers.ndf.published.published_training import Plan, first_checkpoint, train
from shellbench.solvers.ndf.published_solver import PublishedSettings

CASE, RATE = "pinched_cylinder_free", 1e-4


def cylinder() -> Case:
    """Return the case that is trained."""
    case = named_case(CASE)
    assert isinstance(case, Case)
    return case


def main() -> None:
    """Print a line for each iteration after the last that is trained without output."""
    asked = argparse.ArgumentParser()
    for name, usual in (("--seed", 0), ("--last", 550), ("--shown", 13)):
        asked.add_argument(name, type=int, default=usual)
    asked.add_argument("--going-on", action="store_true")
    told = asked.parse_args()
    training = _Training.from_case(cylinder(), PublishedSettings(seed=told.seed))
    sampler, now = training.sampler, first_checkpoint(training.key, training.siren)
    stops = [told.last, *(told.last + k for k in range(1, told.shown) if told.going_on)]
    for iteration, sample in enumerate(sampler.samples(told.last, told.last + told.shown), told.last + 1):
        if stops:
            plan = Plan(stops.pop(0), RATE)
            now = train(training.siren, now, sampler, plan, lambda siren: {}, lambda told: None)
        network = training.siren.with_tensors([weight.clone().requires_grad_() for weight in now.weights])
        show(iteration, sample, network, sampler.modulus_factor, told.seed)


def show(iteration: int, sample: Sample, network: Siren, unit: float, seed: int) -> None:
    """Print loss and energies of a network at the samples of an iteration; its outputs are displacements in a unit, m."""
    loss, count = sample.loss(network), len(sample.rows)
    length = sum(float(g.square().sum()) for g in torch.autograd.grad(loss, network.tensors)) ** 0.5
    jets = network.jets(sample.inputs).detach()[:, :count].permute(1, 2, 0).reshape(count, 18, 1)
    energies = unit * 0.5 * ((sample.rows @ jets)[..., 0] + sample.offset).square()
    membrane, bending = energies[:, :3].sum(), energies[:, 3:].sum()
    one = energies.sum(1)
    xi = stratified_samples(cylinder(), (20, 20), seed, iteration - 1)[int(one.argmax())]
    print(
        f"{iteration}: energy {unit * loss.item():.3g} J, membrane {membrane:.2g}, bending {bending:.2g}, one sample"
        f" {float(one.max()):.2g} J at {xi[0] * 180 / torch.pi:.2f} degrees, {xi[1]:.2f} m; gradient {length:.3g}"
    )


if __name__ == "__main__":
    main()
