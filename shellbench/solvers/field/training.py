"""Training by Adam: fresh samples each epoch, a function to match or losses of local structures to minimise.

Shu et al., algorithm 1. Its first player draws points where losses are large, its second takes a step on them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import embedding_bag

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.field.case import FieldCase
from shellbench.problems.field.formulas import evaluated
from shellbench.problems.field.structure import EDGES, MIDDLE, OUTER, TURN, corners, lattice
from shellbench.solvers.field.basis import local
from shellbench.solvers.field.field import OMEGA, LayeredField, encoded, free_factor
from shellbench.solvers.field.sampling import Cells, jittered, positive, relaxed

Array = NDArray[np.float64]
FIRST, SECOND, TINY = 0.9, 0.999, 1e-8  # of Adam: beta1, beta2 and epsilon
START = 1e-4  # features of a grid start within this much of zero


@dataclass(frozen=True)
class Sampler:
    """How points of an epoch are chosen; see `shellbench.solvers.field.solver.TrainedSettings` for the fields."""

    kind: str
    weighted: bool
    share: float
    kept: float
    cells: int
    lloyd: int


@dataclass(frozen=True)
class Choice:
    """How a field is trained."""

    form: Mapping[str, Any]
    features: int
    width: int
    epochs: int
    samples: int
    rate: float
    seed: int
    device: str
    double: bool
    sampler: Sampler
    every: int


class Weights:
    """The weights of a field as tensors that learn; `displacement` is what `LayeredField` computes of them."""

    def __init__(self, choice: Choice) -> None:
        self.form, self.choice = choice.form, choice
        self.kind = torch.float64 if choice.double else torch.float32
        random = torch.Generator().manual_seed(choice.seed)
        self.tensors: dict[str, Tensor] = {}
        for number, cells in enumerate(self.form["cells"]):
            self._add(f"grid_{number}", ((cells + self.form["degree"]) ** 2, choice.features), START, random)
        inputs = len(self.form["cells"]) * choice.features or 2 + 4 * self.form["frequencies"]
        sizes = [inputs, *[choice.width] * (self.form["layers"] - 1), 3]
        for number in range(self.form["layers"]):
            one, other = sizes[number : number + 2]
            bound = 1 / math.sqrt(one)
            wide = bound
            if self.form["activation"] == "sine":  # as Sitzmann et al. have it
                wide = 1 / one if number == 0 else math.sqrt(6 / one) / OMEGA
            self._add(f"weight_{number}", (one, other), wide, random)
            self._add(f"bias_{number}", (other,), bound, random)

    def _add(self, name: str, shape: tuple[int, ...], bound: float, random: torch.Generator) -> None:
        values = (2 * torch.rand(shape, generator=random, dtype=torch.float64) - 1) * bound
        self.tensors[name] = values.to(self.choice.device, self.kind).requires_grad_()

    def tensor(self, array: NDArray[Any]) -> Tensor:
        """Return an array of numbers as a tensor."""
        return torch.as_tensor(array, dtype=self.kind, device=self.choice.device)

    def displacement(self, points: Array) -> Tensor:
        """Return the displacement (n, 3) at points (n, 2)."""
        form = self.form
        if form["cells"]:
            levels = []
            for number, cells in enumerate(form["cells"]):
                indices, values = local(points, cells, form["degree"])
                bag = torch.as_tensor(indices, device=self.choice.device), self.tensors[f"grid_{number}"]
                levels.append(embedding_bag(*bag, per_sample_weights=self.tensor(values), mode="sum"))
            found = torch.cat(levels, dim=1) if form["layers"] else torch.stack(levels).sum(dim=0)
        else:
            found = self.tensor(encoded(points, form["frequencies"]))
        for number in range(form["layers"]):
            found = found @ self.tensors[f"weight_{number}"] + self.tensors[f"bias_{number}"]
            if number < form["layers"] - 1:
                found = torch.relu(found) if form["activation"] == "relu" else torch.sin(OMEGA * found)
        mask = [axis not in form["confined"] for axis in "xyz"]
        return found * self.tensor(free_factor(points, form["held"])[:, None] * np.array(mask))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the weights."""
        return {name: tensor.detach().cpu().numpy().copy() for name, tensor in self.tensors.items()}


class Adam:
    """Kingma and Ba, "Adam: A Method for Stochastic Optimization", algorithm 1.

    PyTorch's own takes ten seconds of imports at its first step.
    """

    def __init__(self, tensors: list[Tensor], rate: float) -> None:
        self.tensors, self.rate, self.count = tensors, rate, 0
        self.first = [torch.zeros_like(tensor) for tensor in tensors]
        self.second = [torch.zeros_like(tensor) for tensor in tensors]

    @torch.no_grad()
    def step(self, loss: Tensor) -> None:
        """Take a step against the gradient of a loss."""
        with torch.enable_grad():
            gradients = torch.autograd.grad(loss, self.tensors)
        self.count += 1
        size = self.rate / (1 - FIRST**self.count)
        unbiased = math.sqrt(1 - SECOND**self.count)
        for tensor, slope, first, second in zip(self.tensors, gradients, self.first, self.second, strict=True):
            first.mul_(FIRST).add_(slope, alpha=1 - FIRST)
            second.mul_(SECOND).addcmul_(slope, slope, value=1 - SECOND)
            tensor.addcdiv_(first, second.sqrt().div_(unbiased).add_(TINY), value=-size)


def strains(places: Tensor, rest: Tensor) -> Tensor:
    """Return the strain loss (n,) of triangles (n, 3, 3)."""
    lengths = [
        ((places[:, j] - places[:, i]).norm(dim=1) / (rest[:, j] - rest[:, i]).norm(dim=1) - 1) ** 2 for i, j in EDGES
    ]
    return torch.stack(lengths).sum(dim=0)


def bends(places: Tensor) -> Tensor:
    """Return the bending loss (n,) of structures (n, 6, 3)."""
    normals = []
    for a, b, c in (MIDDLE, *OUTER):
        normal = torch.linalg.cross(places[:, b] - places[:, a], places[:, c] - places[:, a])
        normals.append(normal / normal.norm(dim=1, keepdim=True))
    return torch.stack([((normals[0] - n) ** 2).sum(dim=1) for n in normals[1:]]).sum(dim=0)


def losses_at(case: FieldCase, weights: Weights, points: Array, angles: Array) -> Tensor:
    """Return the weighted sum of losses (n,) at points (n, 2), structures turned by angles (n,)."""
    if case.match is not None:
        off = weights.displacement(points) - weights.tensor(evaluated(case.match.function, points))
        return (off**2).sum(dim=1)
    cloth = case.cloth
    assert cloth is not None

    def at(count: int) -> tuple[Tensor, Tensor]:
        there = corners(points, angles, cloth.side, count, cloth.past_edges).reshape(-1, 2)
        rest = weights.tensor(case.rest(there))
        return (rest + weights.displacement(there)).reshape(-1, count, 3), rest.reshape(-1, count, 3)

    found = torch.zeros(len(points), dtype=weights.kind, device=weights.choice.device)
    if cloth.strain:
        found = found + cloth.strain * strains(*at(3))
    if cloth.bend:
        found = found + cloth.bend * bends(at(6)[0])
    if cloth.gravity:
        heights = weights.tensor(case.rest(points)[:, 2]) + weights.displacement(points)[:, 2]
        found = found + cloth.gravity * cloth.mass_gravity * heights
    return found


def sampled(choice: Choice, cells: Cells, random: np.random.Generator) -> tuple[Array, Array]:
    """Return the points (n, 2) of an epoch, and the weight (n,) of each, which is 1 unless areas are weighed."""
    sampler, count = choice.sampler, choice.samples**2
    if sampler.kind == "uniform":
        points = random.random((count, 2))
    elif sampler.kind == "stratified":
        points = jittered(choice.samples, random)
    else:
        adaptive = int(sampler.share * count)
        points = np.concatenate([cells.draw(adaptive, random), random.random((count - adaptive, 2))])
    ones = np.ones(count)
    if sampler.kind == "adaptive" and sampler.weighted:
        ones = 1 / (sampler.share * cells.density(points) + 1 - sampler.share)
    return relaxed(points, sampler.lloyd), ones


def train(case: FieldCase, choice: Choice, progress: ProgressCallback) -> LayeredField:
    """Train a field; its history has the case's quantities at some epochs.

    Raises
    ------
    SolveFailure
        If the loss is not finite any more.
    """
    began = time.perf_counter()
    random, weights = np.random.default_rng(choice.seed), Weights(choice)
    optimiser = Adam(list(weights.tensors.values()), choice.rate)
    size = choice.sampler.cells
    cells, middles = Cells(np.ones((size, size))), lattice(size)
    history: list[Step] = []
    recent: list[float] = []
    found = LayeredField(case, weights.arrays(), choice.form)
    for epoch in range(choice.epochs):
        if choice.sampler.kind == "adaptive" and epoch:
            with torch.no_grad():
                fresh = losses_at(case, weights, middles, TURN * random.random(size**2)).cpu().numpy()
            cells = cells.mixed(positive(fresh.astype(float)).reshape(size, size), choice.sampler.kept)
        points, ones = sampled(choice, cells, random)
        loss = (losses_at(case, weights, points, TURN * random.random(len(points))) * weights.tensor(ones)).sum()
        optimiser.step(loss)  # a sum, as in eq. (20); only Adam's epsilon knows it from a mean
        value = float(loss.detach()) / len(points)
        if not math.isfinite(value):
            raise SolveFailure(f"the loss is not finite at epoch {epoch}", found)
        recent = [*recent[-9:], value]
        if (epoch + 1) % choice.every == 0 or epoch == choice.epochs - 1:
            found = LayeredField(case, weights.arrays(), choice.form)
            values = {quantity.name: quantity.measure(found) for quantity in case.quantities}
            history.append(Step(epoch + 1, time.perf_counter() - began, value, found.parameters, quantities=values))
            progress(Progress(epoch + 1, choice.epochs, f"loss {value:.3g}"))
    uncertainty = spread(history) | known_by_loss(case, recent)
    drawn = choice.sampler.kind == "adaptive"
    pictures = {"points": points, "density": cells.shares * size**2 / cells.shares.sum()} if drawn else {}
    told = {"seed": choice.seed, "learning_rate": choice.rate}
    return LayeredField(case, found.tensors, choice.form, tuple(history), uncertainty, told, pictures=pictures)


def spread(history: list[Step]) -> dict[str, float]:
    """Return by how much figures moved over the last quarter of what was measured."""
    last = history[-max(2, len(history) // 4) :]
    return {name: float(np.ptp([step.quantities[name] for step in last])) for name in last[-1].quantities}


def known_by_loss(case: FieldCase, recent: list[float]) -> dict[str, float]:
    """Return the root of the mean of the last losses on fresh samples: how far a field is from what it matches."""
    off = math.sqrt(float(np.mean(recent)))
    return {q.name: off for q in case.quantities if case.match is not None and q.kind in ("rms_error", "value")}
