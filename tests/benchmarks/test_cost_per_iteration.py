"""Cost of one training iteration of the published network: forward propagation against nested differentiation.

Both do the same work in one run and in turns, so that the ratio does not depend on the machine or its load. The work is
loss and gradient of 5 x 512 sines on 20 x 20 samples, geometry included, and a step of Adam. The expected ratio is at
least 2.5.
"""

import time
from itertools import cycle

import pytest
import torch

from shellbench.bench.catalogue.catalog import named_case
from shellbench.solvers.ndf.published.published_samples import stratified_samples
from tests.solvers.ndf.nested import diaphragm_factor, nested_loss, plate_factor
from tests.solvers.ndf.trainings import sampler_of

LAYERS, WIDTH, CELLS = 5, 512, (20, 20)
ROUNDS = 5
TOP, BOTTOM = ((1.5707963, 300.0), (0, 0, -1)), ((4.7123890, 300.0), (0, 0, 1))
CASES = {"square_plate": (plate_factor, []), "pinched_cylinder_diaphragm": (diaphragm_factor, [TOP, BOTTOM])}


def seconds(function):
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_an_iteration(benchmark, name):
    case, (factor, loads) = named_case(name), CASES[name]
    siren, sampler = sampler_of(case, LAYERS, WIDTH, CELLS, torch.float32)
    tensors = [t.requires_grad_() for t in siren.tensors]
    adam = torch.optim.Adam(tensors, lr=1e-12)
    samples, numbers = sampler.samples(0, 10_000), cycle(range(10_000))

    def step(loss):
        adam.zero_grad()
        loss.backward()
        adam.step()
        return loss.item()

    def ours():
        return step(next(samples).loss(siren))

    def nested():
        points = stratified_samples(case, CELLS, 0, next(numbers))
        loss = nested_loss(
            case, points, siren.weights, siren.biases, siren.omega0, factor, loads, sampler.modulus_factor
        )
        return step(loss)

    assert ours() == pytest.approx(nested(), rel=1e-3)
    slow, fast = [], []
    if benchmark.enabled:
        for _ in range(ROUNDS):
            slow.append(seconds(nested))
            fast.append(seconds(ours))
        benchmark.extra_info["nested_seconds"] = min(slow)
        benchmark.extra_info["forward_seconds"] = min(fast)
        benchmark.extra_info["ratio"] = min(slow) / min(fast)
        benchmark.extra_info["threads"] = torch.get_num_threads()
    benchmark.pedantic(ours, rounds=ROUNDS, warmup_rounds=1)
