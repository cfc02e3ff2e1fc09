"""Checkpoints: all data that a training needs to continue, in one file that is either complete or absent."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path

from torch import Tensor

from shellbench.problem import Step
from shellbench.solvers.ndf.field.weights import are_finite, input_errors, read_tensors, texts_of, write_tensors

FORMAT = "shellbench-ndf-checkpoint-1"
GROUPS = ("weight", "first_moment", "second_moment")
ANSWERS = ("averaged", "best")  # of trainings that keep them


@dataclass(frozen=True)
class Checkpoint:
    """A training after so many iterations.

    Samples are numbered by the iteration and keyed by the seed, so that no generator's state is kept.

    Attributes
    ----------
    key
        Key of the training: a checkpoint continues only in a training of the same key.
    iteration
        Number of completed iterations.
    seconds
        Wall time that they took.
    weights, first_moments, second_moments
        The trained tensors, and Adam's moments of their gradients.
    losses
        (iteration,): the loss of each.
    history
        The record so far.
    averaged
        The running average of the weights; empty if none is kept.
    best, best_energy
        The weights of least certified energy so far, and that energy, J; empty and None if none are kept.
    """

    key: str
    iteration: int
    seconds: float
    weights: list[Tensor]
    first_moments: list[Tensor]
    second_moments: list[Tensor]
    losses: Tensor
    history: tuple[Step, ...]
    averaged: list[Tensor] = field(default_factory=list)
    best: list[Tensor] = field(default_factory=list)
    best_energy: float | None = None

    @property
    def answer(self) -> list[Tensor]:
        """The tensors of the training's present answer."""
        return self.averaged or self.weights


def write_checkpoint(checkpoint: Checkpoint, path: Path) -> None:
    """Write a checkpoint in place of an older one: to a file beside it that is then renamed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    groups = (checkpoint.weights, checkpoint.first_moments, checkpoint.second_moments)
    named = dict(zip((*GROUPS, *ANSWERS), (*groups, checkpoint.averaged, checkpoint.best), strict=True))
    tensors = {f"{name}.{k}": tensor for name, group in named.items() for k, tensor in enumerate(group)}
    facts = {
        "key": checkpoint.key,
        "iteration": checkpoint.iteration,
        "seconds": checkpoint.seconds,
        "best_energy": checkpoint.best_energy,
        "history": [{**asdict(step), "quantities": dict(step.quantities)} for step in checkpoint.history],
    }
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        texts = {"format": FORMAT, "checkpoint": json.dumps(facts)}
        write_tensors(beside, {**tensors, "losses": checkpoint.losses}, texts)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def is_checkpoint(path: Path) -> bool:
    """Return True if a file is a checkpoint; False if it can't be read."""
    return texts_of(path).get("format") == FORMAT


def read_checkpoint(path: Path) -> Checkpoint:
    """Read a file of `write_checkpoint`.

    Raises
    ------
    InputError
        In one sentence, if it is no complete checkpoint.
    """
    texts, tensors = read_tensors(path)
    with input_errors(path):
        facts = json.loads(texts["checkpoint"])
        layers = range(sum(name.startswith(f"{GROUPS[0]}.") for name in tensors))
        weights, first, second = ([tensors[f"{group}.{k}"] for k in layers] for group in GROUPS)
        averaged, best = ([tensors[f"{group}.{k}"] for k in layers if f"{group}.0" in tensors] for group in ANSWERS)
        energy = facts.get("best_energy")
        found = Checkpoint(
            key=str(facts["key"]),
            iteration=int(facts["iteration"]),
            seconds=float(facts["seconds"]),
            weights=weights,
            first_moments=first,
            second_moments=second,
            losses=tensors["losses"],
            history=tuple(Step(**step) for step in facts["history"]),
            averaged=averaged,
            best=best,
            best_energy=None if energy is None else float(energy),
        )
        if found.losses.shape != (found.iteration,) or not are_finite([*found.weights, *averaged, *best]):
            raise ValueError(f"its losses or weights are not those of {found.iteration} iterations")
    return found
