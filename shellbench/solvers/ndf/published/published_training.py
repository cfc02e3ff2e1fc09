"""Training on samples redrawn at every iteration, by Adam (Kingma & Ba 2014) or another optimiser.

The module also has the test of a collapsed training.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.solvers.ndf.published.checkpoint import Checkpoint, write_checkpoint
from shellbench.solvers.ndf.published.published_network import Siren

RECORD = 25  # iterations between two entries of the history
STRETCH = 10  # entries of the history whose mean estimates an energy of a training: 400 random samples are noisy
CERTAIN = 2.0  # standard errors that are added to this mean, to exclude chance
CERTIFIED = "certified_energy"  # name in the history, J
KEPT_GAIN = 0.5  # of its best gain: least gain at the end of a training


class Sampled(Protocol):
    """Samples drawn for one iteration."""

    def loss(self, siren: Siren) -> Tensor:
        """Return the loss of a network."""
        ...


class Sampling(Protocol):
    """Draws the samples of a training, numbered by the iteration.

    Attributes
    ----------
    modulus_factor
        Factor from a loss to an energy, J.
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


class Optimiser(Protocol):
    """Moves all weights of a network, once for each draw of samples."""

    def step(self, sample: Any, rate: float) -> Tensor:
        """Move the weights by a share `rate` of the optimiser's own length; return the loss before."""
        ...

    def moments(self) -> tuple[list[Tensor], list[Tensor]]:
        """Return copies of the first and second moments, as many tensors of each as the network has."""
        ...


class Adam:
    """The published optimiser, with its authors' constants; see `Optimiser`."""

    def __init__(self, network: Siren, now: Checkpoint) -> None:
        self.network, self.adam = network, torch.optim.Adam(network.tensors)
        if now.iteration:
            for tensor, first, second in zip(network.tensors, now.first_moments, now.second_moments, strict=True):
                self.adam.state[tensor] = {
                    "step": torch.tensor(float(now.iteration)),
                    "exp_avg": first.to(tensor).clone(),
                    "exp_avg_sq": second.to(tensor).clone(),
                }

    def step(self, sample: Sampled, rate: float) -> Tensor:
        """See `Optimiser`."""
        self.adam.param_groups[0]["lr"] = rate
        self.adam.zero_grad()
        loss = sample.loss(self.network)
        loss.backward()  # type: ignore[no-untyped-call]
        self.adam.step()
        return loss.detach()

    def moments(self) -> tuple[list[Tensor], list[Tensor]]:
        """See `Optimiser`."""
        states = [self.adam.state[tensor] for tensor in self.network.tensors]
        return [state["exp_avg"].clone() for state in states], [state["exp_avg_sq"].clone() for state in states]


class LossNotFinite(Exception):
    """The loss is NaN or infinite; `good` is the last finite state of the training."""

    def __init__(self, iteration: int, good: Checkpoint) -> None:
        super().__init__(f"the loss is not finite within iterations {good.iteration + 1} to {iteration}")
        self.good = good


@dataclass(frozen=True)
class Plan:
    """Plan of a training.

    Attributes
    ----------
    iterations
        In all, those of a checkpoint included.
    learning_rate
        Of the optimiser at its start.
    checkpoint
        File to keep the training in, at least every `checkpoint_every` iterations; None for none.
    cosine
        Whether the learning rate falls to zero, as a cosine does from 0 to pi (Loshchilov & Hutter 2017).
    averaging
        Share that an iteration keeps of the running average of weights, which then are the answer; 0 for no average.
    certify_every
        Iterations between two certified energies; 0 for none.
    keep_best
        Whether to keep the weights of least certified energy.
    optimiser
        Begins or continues an optimiser.
    """

    iterations: int
    learning_rate: float
    checkpoint: Path | None = None
    checkpoint_every: int = RECORD
    cosine: bool = False
    averaging: float = 0.0
    certify_every: int = 0
    keep_best: bool = False
    optimiser: Callable[[Siren, Checkpoint], Optimiser] = Adam

    def rate(self, iteration: int) -> float:
        """Return the learning rate of an iteration, the first being 1."""
        return self.learning_rate * (
            0.5 + 0.5 * math.cos(math.pi * (iteration - 1) / self.iterations) if self.cosine else 1.0
        )

    def average_share(self, iteration: int) -> float:
        """Return the share of the running average that an iteration keeps; it is less at first, to forget the start."""
        return min(self.averaging, iteration / (iteration + 9))

    def energy_is_due(self, before: int, iteration: int) -> bool:
        """Return True if an energy is due at a recorded iteration; `before` is the recorded one before it."""
        if not self.certify_every:
            return False
        due = iteration // self.certify_every > before // self.certify_every
        return due or (self.keep_best and iteration == self.iterations)


def first_checkpoint(key: str, siren: Siren) -> Checkpoint:
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
    certify: Callable[[Siren], dict[str, float]] = lambda siren: {},
) -> Checkpoint:
    """Continue a training, and return its state after the last iteration.

    Parameters
    ----------
    siren
        Structure of the network; its numbers are those of `now`.
    watch
        Returns quantities of a network for the history.
    certify
        Returns its energies on a fine quadrature, among them `CERTIFIED`; empty if there are none.

    Raises
    ------
    LossNotFinite
        If the loss is not finite, which is checked every `RECORD` iterations.
    """
    # The published recipe: newly drawn samples each time, a fixed number of iterations, no stopping rule.
    # 1. Take weights and both moments from the state of the training, so that it continues without a difference.
    # 2. Let the optimiser take a step on one draw; update the running average of the weights, if there is one.
    # 3. Every `RECORD` iterations: check that all is finite, keep the state, and write it if that is due.
    # 4. At intervals, certify the energy: it selects the best weights, if these are to be kept.
    # A check at each iteration would make the device wait for the host.
    begin, first = time.perf_counter() - now.seconds, now.iteration
    place = siren.tensors[0]
    tensors = [weight.to(place).clone().requires_grad_() for weight in now.weights]
    network = siren.with_tensors(tensors)
    optimiser = plan.optimiser(network, now)
    averaged = [tensor.to(place).clone() for tensor in now.averaged or now.weights] if plan.averaging else []
    losses: list[Tensor] = []
    written, message = now.iteration, "training"
    for iteration, sample in enumerate(sampler.samples(first, plan.iterations), first + 1):
        loss = optimiser.step(sample, plan.rate(iteration))
        if averaged:
            with torch.no_grad():
                torch._foreach_lerp_(averaged, tensors, 1 - plan.average_share(iteration))
        losses.append(loss)  # stays on the device: reading its value would make it wait
        if iteration % RECORD == 0 or iteration == plan.iterations:
            if not all(bool(torch.isfinite(t).all()) for t in [torch.stack(losses), *tensors]):
                # `now` is still the last finite state.
                raise LossNotFinite(iteration, now)
            recent, losses = torch.stack(losses).double().cpu(), []
            answer = network.with_tensors(averaged) if averaged else network
            energy = sampler.modulus_factor * float(recent.mean())
            with torch.no_grad():
                energies = certify(answer) if plan.energy_is_due(now.iteration, iteration) else {}
                step = Step(
                    iteration=iteration,
                    seconds=time.perf_counter() - begin,
                    energy=energy,
                    unknowns=network.parameters,
                    at=sampler.end,
                    gap=abs(energy / energies[CERTIFIED] - 1) if energies.get(CERTIFIED) else None,
                    quantities=watch(answer) | energies,
                )
            now = _next_checkpoint(now, step, recent, tensors, averaged, optimiser)
            if plan.keep_best and CERTIFIED in energies:
                now = _keep_best(now, energies[CERTIFIED])
            told = [f"energy {step.energy:.4g} J", *(f"{name} {v:.5g}" for name, v in step.quantities.items())]
            message = ", ".join(told)
            if plan.checkpoint and (iteration - written >= plan.checkpoint_every):
                write_checkpoint(now, plan.checkpoint)
                written = iteration
        progress(Progress(iteration, plan.iterations, message))
    return now


def why_collapsed(certified: float, course: Sequence[tuple[int, float]], rest: float, loaded: bool) -> str | None:
    """Return the reason that a trained field is no answer, in one sentence; None if its energy gives no reason.

    Rest is the field without the network: the undeformed shell, or the shell moved by its supports alone. The gain of a
    field is its energy below that of rest. The best gain of a training is the largest over all stretches of its course;
    that of a stretch is its mean less `CERTAIN` standard errors.

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
    # The loss can't show a collapse: it is noisy, and computed on the points that the training exploits. The certified
    # energy can, compared with rest and with the best gain of the course.
    best, first, last = _best_gain(course, rest)
    now = f"its certified energy, {certified:.3g} J, is {f'{gain:.2g} J below' if gain > 0 else 'not below'} rest"
    if best > 0 and gain < KEPT_GAIN * best:
        return f"the training collapsed: {now}, but was at least {best:.2g} J below over iterations {first} to {last}"
    if loaded and gain <= 0:
        return f"the training came to no answer: {now} after {course[-1][0]} iterations"
    return None


def _best_gain(course: Sequence[tuple[int, float]], rest: float) -> tuple[float, int, int]:
    """Return the largest certain gain of a stretch and its first and last iteration; 0 if there was none."""
    best = (0.0, 0, 0)
    for k in range(len(course) - STRETCH + 1):
        iterations, energies = zip(*course[k : k + STRETCH], strict=True)
        # One draw has a few hundred points, and the best of many draws shows a large false gain. The mean of a stretch
        # plus its own error is an upper bound of an energy that the training reached.
        raised = float(np.mean(energies) + CERTAIN * np.std(energies, ddof=1) / STRETCH**0.5)
        best = max(best, (rest - raised, iterations[0], iterations[-1]))
    return best


def _next_checkpoint(
    now: Checkpoint, step: Step, recent: Tensor, tensors: list[Tensor], averaged: list[Tensor], optimiser: Optimiser
) -> Checkpoint:
    """Return the training after the iteration of a step, with copies of all tensors."""
    first, second = optimiser.moments()
    return replace(
        now,
        iteration=step.iteration,
        seconds=step.seconds,
        weights=[tensor.detach().clone() for tensor in tensors],
        first_moments=first,
        second_moments=second,
        losses=torch.cat([now.losses, recent]),
        history=(*now.history, step),
        averaged=[tensor.clone() for tensor in averaged],
    )


def _keep_best(now: Checkpoint, energy: float) -> Checkpoint:
    """Return the training with its present answer as the best one, if it is better."""
    if now.best_energy is not None and now.best_energy <= energy:
        return now
    return replace(now, best=[tensor.clone() for tensor in now.answer], best_energy=energy)  # files share no memory
