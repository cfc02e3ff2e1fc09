"""Training of the five fields on Naghdi's potential energy (Bastek & Kochmann 2023): Adam if asked for, then L-BFGS.

The loss is the energy on fixed points. At intervals the energy is certified on a finer rule; the weights of least
certified energy are the answer. A checkpoint also holds the method's memory, so that an interrupted training continues
exactly.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure
from shellbench.problems.shell.solution import DAMAGE
from shellbench.solvers.naghdi.network import Fields, Shape, units
from shellbench.solvers.naghdi.settings import NaghdiSettings, training_key
from shellbench.solvers.naghdi.solution import (
    Check,
    NaghdiSolution,
    Rule,
    gauss_points,
    side_of,
    sobol_points,
)

Loss = Callable[[Tensor], Tensor]

HISTORY = 100  # steps that L-BFGS remembers
LISTS, COUNTS = ("old_dirs", "old_stps", "ro"), ("n_iter", "func_evals")  # of that memory
LOOKS = 5  # at the certified energy, over which a training may settle
SMALLEST = 1e-14  # change of the loss below which L-BFGS stops


@dataclass(frozen=True)
class State:
    """A training after so many iterations, with all data that it needs to continue.

    Attributes
    ----------
    best, best_energy
        The weights of least certified energy, and that energy, J.
    memory
        Memory of torch's L-BFGS: past steps, and changes of the gradient along them.
    """

    weights: Tensor
    best: Tensor
    best_energy: float
    iteration: int = 0
    seconds: float = 0.0
    evaluations: int = 0
    history: tuple[Step, ...] = ()
    memory: dict[str, Any] = field(default_factory=dict)


def solve(case: Case, settings: NaghdiSettings, progress: ProgressCallback) -> NaghdiSolution:
    """Train a field; see `shellbench.solvers.naghdi.solver.NaghdiSolver`."""
    # 1. Make points, strains and loads once: only z of the network changes.
    # 2. Iterate in rounds of `certify_every`; after each, compute energies on the fine rule, and save the state.
    # 3. End when that energy hardly falls any more, or after so many iterations.
    # 4. Return the state of least certified energy, less the free translation.
    shape = Shape(settings.layers, settings.width, settings.activation)
    if settings.sampling == "gauss":
        xi, at = gauss_points(case, side_of(settings.points))
    else:
        xi, at = sobol_points(case, settings.points, settings.seed)
    fields, rule, check = Fields.at(case, shape, xi), Rule.at(case, xi, at), Check.of(case, shape)
    # In these units the loss is of order one: the work of the load on the units of the fields.
    size = float(rule.forces.abs().sum()) * float(units(case)[0]) or 1.0
    file = _file(case, settings)
    now = _read(file, shape) if file and file.exists() else _beginning(shape, settings.seed)
    resumed, begin = now.iteration, time.perf_counter() - now.seconds
    end = settings.adam_iterations + settings.iterations

    def loss(weights: Tensor) -> Tensor:
        return rule.potential(fields.jets(weights)) / size

    while now.iteration < end:
        by_adam = now.iteration < settings.adam_iterations
        stop = settings.adam_iterations if by_adam else end
        count = min(settings.certify_every, stop - now.iteration)
        weights, evaluations, memory = (
            _adam(loss, now, count, settings.learning_rate) if by_adam else _lbfgs(loss, now, count)
        )
        if not bool(torch.isfinite(weights).all()):
            raise SolveFailure("the training diverged: its loss is not finite", _solution(check, now, resumed))
        energies = check.energies(weights)
        moved = not torch.equal(weights, now.weights)
        better = energies.potential < now.best_energy
        trial = _solution(check, replace(now, best=weights), resumed)
        primary = case.primary
        trained = float(loss(weights)) * size
        step = Step(
            iteration=now.iteration + count,
            seconds=time.perf_counter() - begin,
            energy=energies.potential,
            unknowns=shape.parameters,
            gap=abs(trained / energies.potential - 1) if energies.potential else None,
            quantities={
                primary.name: measure(trial, primary),
                "membrane_energy": energies.membrane,
                "shear_energy": energies.shear,
            },
        )
        now = State(
            weights,
            weights if better else now.best,
            min(energies.potential, now.best_energy),
            step.iteration,
            step.seconds,
            now.evaluations + evaluations,
            (*now.history, step),
            memory,
        )
        if file:
            _write(file, now)
        progress(Progress(now.iteration, end, f"energy {energies.potential:.8g} J"))
        # If L-BFGS found no step it will not find one later; and a training that gains no more has settled.
        if not by_adam and (not moved or _settled(now.history, settings.settle)):
            break
    solution = _solution(check, now, resumed)
    if file:
        file.unlink(missing_ok=True)
    if case.loads and now.best_energy >= 0:
        raise SolveFailure("the training came to no answer: its certified energy is not below rest", solution)
    return solution


def _settled(history: Sequence[Step], settle: float) -> bool:
    """Return True if the certified energy gained less than a share of itself over the last evaluations."""
    if len(history) <= LOOKS:
        return False
    before, after = (min(step.energy for step in part) for part in (history[:-LOOKS], history))
    return before - after < settle * abs(after)


def _beginning(shape: Shape, seed: int) -> State:
    weights = shape.initial(seed)
    return State(weights, weights, float("inf"))


def _solution(check: Check, now: State, resumed: int) -> NaghdiSolution:
    return NaghdiSolution(
        check.case,
        check.fields.shape,
        now.best.numpy(),
        check.mean_translation(now.best),
        history=now.history,
        diagnostics={
            "certified_energy": now.best_energy if np.isfinite(now.best_energy) else None,
            "energy_gap": now.history[-1].gap if now.history else None,
            "iterations": now.iteration,
            "evaluations": now.evaluations,
            "resumed_at": resumed,
            "seconds_per_iteration": now.seconds / max(now.iteration, 1),
        },
    )


def _lbfgs(loss: Loss, now: State, count: int) -> tuple[Tensor, int, dict[str, Any]]:
    """Return the weights after so many iterations, the evaluations of the loss, and the method's memory."""
    trained = now.weights.clone().requires_grad_()
    method = torch.optim.LBFGS(
        [trained],
        max_iter=count,
        max_eval=3 * count,
        tolerance_grad=0.0,
        tolerance_change=SMALLEST,
        history_size=HISTORY,
        line_search_fn="strong_wolfe",
    )
    method.state[trained].update(now.memory)
    made = 0

    def closure() -> float:
        nonlocal made
        made += 1
        method.zero_grad()
        value = loss(trained)
        value.backward()  # type: ignore[no-untyped-call]
        return float(value.detach())

    method.step(closure)  # type: ignore[no-untyped-call]
    return trained.detach(), made, dict(method.state[trained])


def _adam(loss: Loss, now: State, count: int, rate: float) -> tuple[Tensor, int, dict[str, Any]]:
    trained = now.weights.clone().requires_grad_()
    method = torch.optim.Adam([trained], lr=rate)
    for _ in range(count):
        method.zero_grad()
        loss(trained).backward()  # type: ignore[no-untyped-call]
        method.step()
    return trained.detach(), count, {}


def _file(case: Case, settings: NaghdiSettings) -> Path | None:
    if settings.checkpoint is None:
        return None
    return Path(settings.checkpoint) / f"{case.name}-pinn-naghdi-{training_key(case, settings)[:16]}.npz"


def _write(path: Path, now: State) -> None:
    """Write a checkpoint to a file beside an older one, and put it in its place."""
    path.parent.mkdir(parents=True, exist_ok=True)
    facts = {name: getattr(now, name) for name in ("best_energy", "iteration", "seconds", "evaluations")}
    facts["history"] = [{**asdict(step), "quantities": dict(step.quantities)} for step in now.history]
    beside = path.with_name(f".{os.getpid()}-{path.name}")
    # Of the memory, lists of vectors are kept as one array, numbers as such.
    memory = {f"memory.{name}": value for name, value in now.memory.items() if isinstance(value, Tensor)}
    lists = {f"memories.{name}": torch.stack(list(v)) for name, v in now.memory.items() if name in LISTS and v}
    facts["memory"] = {name: float(v) for name, v in now.memory.items() if isinstance(v, int | float)}
    arrays = {name: value.numpy() for name, value in {**memory, **lists}.items()}
    words = np.asarray(json.dumps(facts))
    np.savez(beside, words=words, weights=now.weights.numpy(), best=now.best.numpy(), allow_pickle=False, **arrays)
    beside.replace(path)


def _read(path: Path, shape: Shape) -> State:
    """Read a checkpoint; InputError in one sentence if it is no such file."""
    try:
        with np.load(path, allow_pickle=False) as data:
            words, weights, best = json.loads(str(data["words"])), data["weights"], data["best"]
            memory: dict[str, Any] = words.pop("memory")
            memory |= {name: int(memory[name]) for name in COUNTS if name in memory}
            for name in data.files:
                kind, _, of = name.partition(".")
                if of:
                    held = torch.as_tensor(data[name])
                    memory[of] = list(held.unbind()) if kind == "memories" else held
        if weights.shape != (shape.parameters,) or best.shape != weights.shape:
            raise ValueError("of another network")
        history = tuple(Step(**step) for step in words.pop("history"))
        return State(torch.as_tensor(weights), torch.as_tensor(best), history=history, memory=memory, **words)
    except (OSError, *DAMAGE):
        raise InputError(f"{path}: is damaged, or no checkpoint of pinn-naghdi") from None
