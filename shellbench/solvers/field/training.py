"""Training by Adam: fresh samples each epoch, a function to match or losses of local structures to minimise.

Shu et al., algorithm 1. Its first player draws points where losses are large, its second takes a step on them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import embedding_bag

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.field.case import Disc, FieldCase
from shellbench.problems.field.structure import TURN, lattice, weighted
from shellbench.solvers.field.basis import local
from shellbench.solvers.field.field import OMEGA, LayeredField, encode, free_factor, pin_shares
from shellbench.solvers.field.losses import Losses, MeshLosses
from shellbench.solvers.field.sampling import Cells, jittered, positive, relaxed

Array = NDArray[np.float64]
FIRST, SECOND, TINY = 0.9, 0.999, 1e-8  # of Adam: beta1, beta2 and epsilon
START = 1e-4  # features of a grid start within this much of zero
WINDOW = 200  # epochs over which the energy of a training that has settled changes little
EVEN, TURNS = 32, 4  # a training's energy is that of structures at so many midpoints squared, in so many orientations


@dataclass(frozen=True)
class Sampler:
    """Choice of the points of an epoch; see `shellbench.solvers.field.solver.TrainedSettings` for the fields."""

    kind: str
    weighted: bool
    share: float
    kept: float
    cells: int
    lloyd: int


@dataclass(frozen=True)
class Choice:
    """Settings of the training of a field."""

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
    settled: float | None = None
    disc: Disc | None = None


class Weights:
    """The weights of a field as tensors that learn; `displacement` is that of `LayeredField` with these weights.

    Gradients are propagated through the layers by hand, in reused memory: PyTorch's graph, and fresh memory for each of
    its results, cost more than the products. Only the losses as functions of places use the graph.
    """

    def __init__(self, choice: Choice) -> None:
        self.form, self.choice = choice.form, choice
        self.kind = torch.float64 if choice.double else torch.float32
        random = torch.Generator().manual_seed(choice.seed)
        self.tensors: dict[str, Tensor] = {}
        self.pinned = np.array(self.form["pinned"]) if self.form.get("pinned") else None
        self.rooms: dict[tuple[str, tuple[int, ...]], Tensor] = {}
        self.turned: dict[int, Tensor] = {}
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
        self.tensors[name] = values.to(self.choice.device, self.kind)

    def tensor(self, array: NDArray[Any]) -> Tensor:
        """Return an array of numbers as a tensor."""
        return torch.as_tensor(array, dtype=self.kind, device=self.choice.device)

    @torch.no_grad()
    def displacement(self, points: Array) -> Tensor:
        """Return the displacement (n, 3) at points (n, 2), and keep the intermediate values for `slopes`."""
        form = self.form
        if self.pinned is not None:
            shares = self.tensor(pin_shares(points, self.pinned))
            points, count = np.concatenate([points, self.pinned]), len(points)
        self.taps = [local(points, cells, form["degree"]) for cells in form["cells"]]
        found = self._features(points)
        self.inputs: list[Tensor] = []
        for number in range(form["layers"]):
            self.inputs.append(found)
            found = self._room(f"out_{number}", len(found), self.tensors[f"bias_{number}"].shape[0])
            torch.addmm(self.tensors[f"bias_{number}"], self.inputs[-1], self.tensors[f"weight_{number}"], out=found)
            if number < form["layers"] - 1:
                self._activate(found, number)
        mask = [axis not in form["confined"] for axis in "xyz"]
        self.factor = self.tensor(free_factor(points, form["held"], self.choice.disc)[:, None] * np.array(mask))
        found = found * self.factor
        if self.pinned is not None:
            self.shares = shares
            found = found[:count] - shares @ found[count:]
        return found

    @torch.no_grad()
    def slopes(self, slope: Tensor) -> list[Tensor]:
        """Return the gradients of all tensors, in their order, for that of a loss in the last displacement (n, 3)."""
        form, found = self.form, dict[str, Tensor]()
        if self.pinned is not None:
            slope = torch.cat([slope, -self.shares.T @ slope])
        slope = slope * self.factor
        for number in reversed(range(form["layers"])):
            found[f"weight_{number}"], found[f"bias_{number}"] = self.inputs[number].T @ slope, slope.sum(dim=0)
            if number or form["cells"]:
                weight, further = self.tensors[f"weight_{number}"], slope
                slope = self._room(f"back_{number}", len(further), weight.shape[0])
                torch.mm(further, weight.T, out=slope)
            if number and form["activation"] == "relu":
                slope.masked_fill_(self.inputs[number] <= 0, 0.0)
            elif number:
                slope.mul_(self.turned[number - 1])
        for number, (indices, values) in enumerate(self.taps):
            own = slope[:, number * self.choice.features :][:, : self.choice.features] if form["layers"] else slope
            parts = (own[:, None] * self.tensor(values)[:, :, None]).reshape(-1, own.shape[1])
            numbers = torch.as_tensor(indices.ravel(), device=self.choice.device)
            name = f"grid_{number}"
            found[name] = torch.zeros_like(self.tensors[name]).index_add_(0, numbers, parts)
        return [found[name] for name in self.tensors]

    def _features(self, points: Array) -> Tensor:
        form = self.form
        if not form["cells"]:
            return self.tensor(encode(points, form["frequencies"]))
        levels = []
        for number, (indices, values) in enumerate(self.taps):
            bag = torch.as_tensor(indices, device=self.choice.device), self.tensors[f"grid_{number}"]
            levels.append(embedding_bag(*bag, per_sample_weights=self.tensor(values), mode="sum"))
        return torch.cat(levels, dim=1) if form["layers"] else torch.stack(levels).sum(dim=0)

    def _activate(self, values: Tensor, number: int) -> None:
        """Replace values by their activation, and keep its slope if values don't tell it."""
        if self.form["activation"] == "relu":
            values.relu_()
            return
        slope = self.turned[number] = self._room(f"turned_{number}", *values.shape)
        values.mul_(OMEGA)
        torch.cos(values, out=slope)
        slope.mul_(OMEGA)
        values.sin_()

    def _room(self, name: str, *shape: int) -> Tensor:
        """Return a tensor of this shape whose memory is used again: fresh memory of this size costs as much as work."""
        have = self.rooms.get((name, shape))
        if have is None:
            have = self.rooms[name, shape] = torch.empty(shape, dtype=self.kind, device=self.choice.device)
        return have

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
    def step(self, gradients: list[Tensor]) -> None:
        """Take a step against the gradients of a loss."""
        self.count += 1
        size = self.rate / (1 - FIRST**self.count)
        unbiased = math.sqrt(1 - SECOND**self.count)
        for tensor, slope, first, second in zip(self.tensors, gradients, self.first, self.second, strict=True):
            first.mul_(FIRST).add_(slope, alpha=1 - FIRST)
            second.mul_(SECOND).addcmul_(slope, slope, value=1 - SECOND)
            tensor.addcdiv_(first, second.sqrt().div_(unbiased).add_(TINY), value=-size)


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
    # 1. With the adaptive sampler, sample the losses by cell, and mix them into the density.
    # 2. Draw points, and take a step of Adam on the losses there.
    # 3. Record the case's quantities at some epochs, without counting the time.
    # 4. End when the energy has settled, if that is asked.
    # 5. State the change over the last records as the uncertainty.
    began = time.perf_counter()
    random, weights = np.random.default_rng(choice.seed), Weights(choice)
    optimiser = Adam(list(weights.tensors.values()), choice.rate)
    size = choice.sampler.cells
    cells, middles = Cells(np.ones((size, size))), lattice(size)
    history: list[Step] = []
    recent: list[float] = []
    found = LayeredField(case, weights.arrays(), choice.form)
    mesh = MeshLosses(case, weights.tensor, choice.samples) if choice.sampler.kind == "mesh" else None
    energies, change = dict[int, float](), math.inf
    for epoch in range(choice.epochs):
        if choice.sampler.kind == "adaptive" and epoch:
            asked = Losses(case, weights.tensor, middles, TURN * random.random(size**2))
            fresh = asked.weighted(weights.displacement(asked.places)).cpu().numpy()
            if case.disc:
                fresh[case.disc.level(middles) <= 0] = fresh.min()
            cells = cells.mixed(positive(fresh.astype(float)).reshape(size, size), choice.sampler.kept)
        if mesh:
            asked, points, ones = mesh, mesh.points, np.ones(len(mesh.points))
        else:
            points, ones = sampled(choice, cells, random)
            if case.disc:
                inside = case.disc.level(points) > 0
                points, ones = points[inside], ones[inside]
            asked = Losses(case, weights.tensor, points, TURN * random.random(len(points)))
        displacement = weights.displacement(asked.places).requires_grad_()
        loss = (asked.weighted(displacement) * weights.tensor(ones)).sum()
        (slope,) = torch.autograd.grad(loss, [displacement])
        optimiser.step(weights.slopes(slope))  # a sum, as in eq. (20); only Adam's epsilon knows it from a mean
        value = float(loss.detach()) / len(points)
        if not math.isfinite(value):
            raise SolveFailure(f"the loss is not finite at epoch {epoch}", found)
        recent = [*recent[-9:], value]
        if (epoch + 1) % choice.every == 0 or epoch == choice.epochs - 1:
            looked = time.perf_counter()
            found = LayeredField(case, weights.arrays(), choice.form)
            values = {quantity.name: quantity.measure(found) for quantity in case.quantities}
            history.append(Step(epoch + 1, looked - began, value, found.parameters, quantities=values))
            progress(Progress(epoch + 1, choice.epochs, f"loss {value:.3g}"))
            if choice.settled is not None:
                energies[epoch + 1] = now = even_energy(found)
                before = energies.get(epoch + 1 - WINDOW, math.inf)
                change = abs(now - before) / abs(now)
            began += time.perf_counter() - looked  # a look is no part of training
            if choice.settled is not None and change < choice.settled:
                break
    uncertainty = spread(history) | known_by_loss(case, recent)
    drawn = choice.sampler.kind == "adaptive"
    pictures = {"points": points, "density": cells.shares * size**2 / cells.shares.sum()} if drawn else {}
    told = {"seed": choice.seed, "learning_rate": choice.rate, "epochs": epoch + 1}
    found = LayeredField(case, found.tensors, choice.form, tuple(history), uncertainty, told, pictures=pictures)
    if choice.settled is None or change < choice.settled:
        return found
    why = (
        f"the energy still changes by {change:.2g} of it in {WINDOW} epochs, and at most {choice.settled:g} is at rest"
    )
    return replace(found, unsettled=why)


def even_energy(found: LayeredField) -> float:
    """Return the mean of all losses with their weights, at even midpoints: the same measure for all samplers."""
    assert found.case.cloth is not None
    return float(np.mean(weighted(found.losses(found.case.within(lattice(EVEN)), TURNS), found.case.cloth.weights)))


def spread(history: list[Step]) -> dict[str, float]:
    """Return the changes of the values over the last quarter of the measurements."""
    last = history[-max(2, len(history) // 4) :]
    return {name: float(np.ptp([step.quantities[name] for step in last])) for name in last[-1].quantities}


def known_by_loss(case: FieldCase, recent: list[float]) -> dict[str, float]:
    """Return the root of the mean of the last losses on fresh samples: the distance of a field from the function."""
    if case.match is None:  # losses may be negative
        return {}
    off = math.sqrt(float(np.mean(recent)))
    return {q.name: off for q in case.quantities if q.kind in ("rms_error", "value")}
