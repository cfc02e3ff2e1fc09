"""Training by Adam (Kingma & Ba 2014) on samples that are redrawn at every iteration; when a training has collapsed.

The published loss: the energy of a shell by one random point in each cell of a grid, redrawn at every iteration.

L = |Omega|/N sum_i (W - f . u) sqrt(a) at N stratified samples, less the work f . u of point loads (Kairanda et al.,
eqs. (35), (62), (67)); forces on edges are integrated along them. Strains are the linear part of eq. (30).

Samples are numbers of a counter-based generator, keyed by the seed and counted by the iteration: whichever iteration a
training goes on from, and on whichever device, it sees the samples that it would have seen. All that does not depend
on the network is tabulated for many iterations at once, in float64.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.build import focal_points
from shellbench.solvers.ndf.checkpoint import Checkpoint, write_checkpoint
from shellbench.solvers.ndf.energy import Concentrated, concentrated, surface_area, tabulate
from shellbench.solvers.ndf.field import Ansatz
from shellbench.solvers.ndf.inputs import Inputs
from shellbench.solvers.ndf.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.published_network import InputScale, Siren
from shellbench.solvers.ndf.quadrature import Rule, RuleSpec, area_rule
from shellbench.solvers.ndf.supports import concentrated_forces, force_density

RECORD = 25  # iterations between two entries of the history
STRETCH = 10  # entries of the history whose mean is an energy that a training had: 400 random samples are noisy
CERTAIN = 2.0  # standard errors that this mean is raised by, so that luck is no energy
KEPT = 0.5  # of its best gain that a training must end with


class Sampled(Protocol):
    """What is drawn for one iteration."""

    def loss(self, siren: Siren) -> Tensor:
        """Return the loss of a network."""
        ...


class Sampling(Protocol):
    """Draws the samples of a training, numbered by the iteration.

    Attributes
    ----------
    modulus_factor
        What a loss is to be multiplied by to be an energy, J.
    """

    @property
    def modulus_factor(self) -> float:
        """See the class."""
        ...

    @property
    def end(self) -> float:
        """Load factor, or final time, s."""
        ...

    def samples(self, start: int, stop: int) -> Iterator[Sampled]:
        """Yield the samples of iterations start, ..., stop - 1."""
        ...


class LossNotFinite(Exception):
    """The loss is no number any more; `good` is the training when it last was one."""

    def __init__(self, iteration: int, good: Checkpoint) -> None:
        super().__init__(f"the loss is not finite within iterations {good.iteration + 1} to {iteration}")
        self.good = good


@dataclass(frozen=True)
class Plan:
    """How to train.

    Attributes
    ----------
    iterations
        In all, those of a checkpoint included.
    learning_rate
        Of Adam; its other constants are its authors'.
    checkpoint
        File to keep the training in, at least every `checkpoint_every` iterations; None for none.
    """

    iterations: int
    learning_rate: float
    checkpoint: Path | None = None
    checkpoint_every: int = RECORD


def beginning(key: str, siren: Siren) -> Checkpoint:
    """Return the training of a network before its first iteration."""
    zeros = [torch.zeros_like(t) for t in siren.tensors]
    return Checkpoint(key, 0, 0.0, siren.tensors, zeros, zeros, torch.zeros(0, dtype=torch.float64), ())


def train(
    siren: Siren,
    now: Checkpoint,
    sampler: Sampling,
    plan: Plan,
    watch: Callable[[Siren], dict[str, float]],
    progress: ProgressCallback,
) -> Checkpoint:
    """Go on with a training, and return it as it stands after the last iteration.

    Parameters
    ----------
    siren
        Says what the network is; its numbers are those of `now`.
    watch
        Gives quantities of a network for the history.

    Raises
    ------
    LossNotFinite
        If it is not, which is looked at every `RECORD` iterations.
    """
    # The published recipe: Adam on samples drawn anew each time, a fixed number of iterations, no stopping rule.
    # 1. Take weights and both moments from where the training stands: it goes on as if it had never stopped.
    # 2. Loss of one draw, gradient, step.
    # 3. Every `RECORD` iterations: look whether all is finite, keep the state, and write it down if that is due.
    # Looking each time would make the device wait for the host.
    begin, first = time.perf_counter() - now.seconds, now.iteration
    place = siren.tensors[0]
    tensors = [weight.to(place).clone().requires_grad_() for weight in now.weights]
    network, adam = siren.with_tensors(tensors), _adam(tensors, now, plan.learning_rate)
    losses: list[Tensor] = []
    written, message = now.iteration, "training"
    for iteration, sample in enumerate(sampler.samples(first, plan.iterations), first + 1):
        adam.zero_grad()
        loss = sample.loss(network)
        loss.backward()  # type: ignore[no-untyped-call]
        adam.step()
        losses.append(loss.detach())  # stays on the device: asking for its value would make it wait
        if iteration % RECORD == 0 or iteration == plan.iterations:
            if not all(bool(torch.isfinite(t).all()) for t in [torch.stack(losses), *tensors]):
                # `now` is still the last state that was finite.
                raise LossNotFinite(iteration, now)
            recent, losses = torch.stack(losses).double().cpu(), []
            with torch.no_grad():
                step = Step(
                    iteration=iteration,
                    seconds=time.perf_counter() - begin,
                    energy=sampler.modulus_factor * float(recent.mean()),
                    unknowns=network.parameters,
                    at=sampler.end,
                    quantities=watch(network),
                )
            now = _kept(now, step, recent, tensors, adam)
            told = [f"energy {step.energy:.4g} J", *(f"{name} {v:.5g}" for name, v in step.quantities.items())]
            message = ", ".join(told)
            if plan.checkpoint and (iteration - written >= plan.checkpoint_every):
                write_checkpoint(now, plan.checkpoint)
                written = iteration
        progress(Progress(iteration, plan.iterations, message))
    return now


def why_collapsed(certified: float, course: Sequence[tuple[int, float]], rest: float, loaded: bool) -> str | None:
    """Return why a trained field is no answer, in one sentence; None if its energy does not speak against it.

    Rest is the field without the network: the undeformed shell, or what the motion of supports alone makes of it. A
    field gains what its energy lies below that of rest. The gain that a training had at its best is the largest over
    all stretches of its course, each the mean less `CERTAIN` standard errors.

    Parameters
    ----------
    certified
        Energy of the trained field on the fine quadrature, J.
    course
        Iteration and mean loss, J, of each entry of the history.
    rest
        Energy at rest, J.
    loaded
        Whether loads act on a shell whose supports stay: then the answer lies below rest. A motion of supports may
        already be the answer, so that nothing can be gained on it.
    """
    gain = rest - certified
    # The loss can't say whether a training has collapsed: it is noisy, and taken on the points that it exploits. The
    # certified energy can, against rest, and against what the course shows that the network once could do.
    best, first, last = _best_gain(course, rest)
    now = f"its certified energy, {certified:.3g} J, is {f'{gain:.2g} J below' if gain > 0 else 'not below'} rest"
    if best > 0 and gain < KEPT * best:
        return f"the training collapsed: {now}, but was at least {best:.2g} J below over iterations {first} to {last}"
    if loaded and gain <= 0:
        return f"the training came to no answer: {now} after {course[-1][0]} iterations"
    return None


def _best_gain(course: Sequence[tuple[int, float]], rest: float) -> tuple[float, int, int]:
    """Return the largest certain gain of a stretch and its first and last iteration; 0 if there was none."""
    best = (0.0, 0, 0)
    for k in range(len(course) - STRETCH + 1):
        iterations, energies = zip(*course[k : k + STRETCH], strict=True)
        # One draw is a few hundred points, and the luckiest of many a large false gain. The mean of a stretch raised by
        # its own error is an energy that the training surely had.
        raised = float(np.mean(energies) + CERTAIN * np.std(energies, ddof=1) / STRETCH**0.5)
        best = max(best, (rest - raised, iterations[0], iterations[-1]))
    return best


def _adam(tensors: list[Tensor], now: Checkpoint, learning_rate: float) -> torch.optim.Adam:
    adam = torch.optim.Adam(tensors, lr=learning_rate)
    if now.iteration:
        for tensor, first, second in zip(tensors, now.first_moments, now.second_moments, strict=True):
            adam.state[tensor] = {
                "step": torch.tensor(float(now.iteration)),
                "exp_avg": first.to(tensor).clone(),
                "exp_avg_sq": second.to(tensor).clone(),
            }
    return adam


def _kept(now: Checkpoint, step: Step, recent: Tensor, tensors: list[Tensor], adam: torch.optim.Adam) -> Checkpoint:
    return replace(
        now,
        iteration=step.iteration,
        seconds=step.seconds,
        weights=[tensor.detach().clone() for tensor in tensors],
        first_moments=[adam.state[tensor]["exp_avg"].clone() for tensor in tensors],
        second_moments=[adam.state[tensor]["exp_avg_sq"].clone() for tensor in tensors],
        losses=torch.cat([now.losses, recent]),
        history=(*now.history, step),
    )


BLOCK = 10_000  # sampled points that are tabulated at once
PLATE = 0.00406  # deflection of a simply supported square plate: w = PLATE q L^4 / B (Timoshenko, article 30)
ORDER_ONE = (0.1, 10.0)  # metres: estimated deflections for which the modulus stays as it is
AIM = 100.0  # metres: what the estimate is brought to where it does not; E = 30 brings the pinched cylinders' to 124


def stratified_samples(case: Case, cells: tuple[int, int], seed: int, iteration: int) -> Array:
    """Return one random point in each cell of a grid, (N, 2), for one iteration of a training."""
    generator = np.random.Generator(np.random.Philox(key=seed, counter=iteration << 128))
    corner = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 2)
    share = (corner + generator.random(corner.shape)) / cells
    domain = case.surface.domain
    points: Array = np.asarray(domain.lower) + share * np.asarray(domain.size)
    return points


@dataclass(frozen=True)
class Sample:
    """What the loss of one iteration needs beside the network.

    Attributes
    ----------
    inputs
        (6, N + P, n): jets of the published inputs at the samples and at P points of edge and point loads.
    rows, offset
        (N, 6, 18) and (N, 6): on the jets of F, half the sum of squares is the strain energy.
    force
        (N + P, 3): work of the loads on a unit of F.
    work
        Work of the loads on the lift.
    """

    inputs: Tensor
    rows: Tensor
    offset: Tensor
    force: Tensor
    work: float

    def loss(self, siren: Siren) -> Tensor:
        """Return the potential energy of the field, as the samples see it."""
        jets = siren.jets(self.inputs)
        count = len(self.rows)
        strains = (self.rows @ jets[:, :count].permute(1, 2, 0).reshape(count, 18, 1))[..., 0] + self.offset
        return 0.5 * strains.square().sum() - (self.force * jets[VALUE]).sum() - self.work


@dataclass(frozen=True)
class Sampler:
    """Makes the samples of a training.

    Attributes
    ----------
    ansatz, inputs, scale
        The way supports are built in, and what the network sees of a point.
    cells
        Of the grid, along xi1 and xi2.
    modulus_factor
        Factor s of Young's modulus: with u = lift + s M F the loss is 1/s times the energy of the shell.
    edges
        How finely loads along edges are integrated.
    placement
        Of the tensors.
    """

    ansatz: Ansatz
    inputs: Inputs
    scale: InputScale
    cells: tuple[int, int]
    seed: int
    modulus_factor: float
    edges: RuleSpec
    placement: Placement

    @property
    def end(self) -> float:
        """Load factor."""
        return self.ansatz.t

    def samples(self, start: int, stop: int) -> Iterator[Sample]:
        """Yield the samples of iterations start, ..., stop - 1.

        They are tabulated in the same blocks wherever a training starts: the last bit of a sine can depend on its
        place in a block.
        """
        case, count = self.ansatz.case, math.prod(self.cells)
        exact = self.placement._replace(dtype=torch.float64)
        forces = concentrated(self.ansatz, self.edges, focal_points(case), exact)
        area = surface_area(self.ansatz, area_rule(case.surface.domain, np.zeros((0, 2)), self.edges))
        step = 1 if self.ansatz.lift.moves else max(1, BLOCK // count)  # the work on a lift is that of one sample
        for first in range(start - start % step, stop, step):
            points = [stratified_samples(case, self.cells, self.seed, first + k) for k in range(step)]
            samples = self._tabulated(np.concatenate(points), count, forces, area, exact)
            yield from islice(samples, max(start - first, 0), min(stop - first, step))

    def _tabulated(
        self, points: Array, count: int, forces: Concentrated, area: float, exact: Placement
    ) -> Iterator[Sample]:
        """Yield the samples of `count` points each."""
        weights = np.full(len(points), math.prod(self.ansatz.case.surface.domain.size) / count)
        table = tabulate(self.ansatz, Rule(points, weights), exact, area)
        root, dtype = math.sqrt(self.modulus_factor), self.placement.dtype
        rows = (root * table.rows).view(-1, count, 6, 18).to(dtype)
        offset = (table.offset / root).view(-1, count, 6).to(dtype)
        force = table.force.view(-1, count, 3).to(dtype)
        seen = self.scale.apply(self.inputs.jets(points, exact).to(dtype))
        at_loads = self.scale.apply(self.inputs.jets(forces.points, exact).to(dtype))
        concentrated_force = forces.force.to(dtype)
        for k in range(len(rows)):
            yield Sample(
                torch.cat([seen[:, k * count : (k + 1) * count], at_loads], dim=1),
                rows[k],
                offset[k],
                torch.cat([force[k], concentrated_force]),
                (table.work + forces.work) / self.modulus_factor,
            )


def usual_modulus_factor(ansatz: Ansatz) -> float:
    """Return the power of ten by which Young's modulus is scaled in training, from the case alone.

    A network starts with displacements of order one and leaves that order slowly. Where a plate of the shell's area,
    under the same total load, deflects by `ORDER_ONE`, the modulus stays as it is; where not, the estimate is brought
    near `AIM`, since a curved shell is stiffer than the plate. For the obstacle course these are the published
    choices: no scaling of plate and roof, and E = 30 for 3e6 of the pinched cylinders (Kairanda et al., section 5.1).
    Where only supports are moved, the largest prescribed motion is brought to order one.
    """
    case = ansatz.case
    spec = RuleSpec((6, 6), 6)
    rule = area_rule(case.surface.domain, np.zeros((0, 2)), spec)
    area = rule.areas(case.surface)
    density = np.linalg.norm(force_density(case, rule.points, ansatz.t), axis=-1)
    _, forces = concentrated_forces(case, spec, np.zeros((0, 2)), ansatz.t)
    load = float(area @ density) + float(np.linalg.norm(forces, axis=-1).sum())
    estimate = PLATE * load * float(area.sum()) / case.material.bending_stiffness
    moved = float(ansatz.lift.jet(rule.points, Placement())[VALUE].abs().max()) if ansatz.lift.moves else 0.0
    if ORDER_ONE[0] <= max(estimate, moved) <= ORDER_ONE[1] or max(estimate, moved) == 0.0:
        return 1.0
    return float(10.0 ** round(math.log10(max(estimate / AIM, moved))))
