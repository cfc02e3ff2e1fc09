"""Networks that skin: the perceptron of Jin et al. (section 7), from bones or from the pose alone, and recurrent ones.

Networks compute coefficients of PCA modes: of displacements, or of what an earlier network leaves (section 8).
Recurrent units also compute bones, one unit a chain. All are trained in float32, which resolves 1e-7 of a displacement,
while errors are 1e-2. The stored arrays give meshes without torch.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.skinning.body import distance
from shellbench.problems.skinning.case import SkinningCase
from shellbench.problems.skinning.data import clips_of
from shellbench.solvers.skinning.forward import SHAPE, Given, chains_skin, dense_skin, recurrent_skin, shape_skin
from shellbench.solvers.skinning.linear import bones, coefficients, modes_of
from shellbench.solvers.skinning.solution import Arrays, Skin, Skinned
from shellbench.solvers.skinning.units import chain, course

if TYPE_CHECKING:
    from shellbench.solvers.skinning.settings import ChainSettings, NetworkSettings, RecurrentSettings

Array = NDArray[np.float64]
LOOKS = 8  # times at which the course of a training is looked at, evenly spread
SMALL = 1e-12  # m: below this distance of the truth there is no direction


class Training:
    """Base of the trainings: the modes, their target coefficients, the history, and an end if the loss diverges.

    After an `earlier` network, the modes are of what its training frames lack, and new arrays have a `prefix`.
    """

    def __init__(
        self, case: SkinningCase, solver: str, skin: Skin, count: int, progress: ProgressCallback,
        earlier: Skinned | None = None, prefix: str = "",
    ) -> None:  # fmt: skip
        self.case, self.solver, self.skin, self.progress = case, solver, skin, progress
        self.clips, self.earlier, self.prefix = clips_of(case), earlier.arrays if earlier else {}, prefix
        self.began = time.perf_counter() - (earlier.history[-1].seconds if earlier else 0.0)  # clips are no part of it
        moved = self.clips.moved[case.seen]
        rest = self.clips.rest.reshape(-1)
        self.start = earlier.fitted.reshape(moved.shape) if earlier else np.broadcast_to(rest, moved.shape)
        moved = moved - (self.start - rest)
        self.basis = modes_of(moved, count)
        self.wanted = coefficients(self.basis, moved)
        self.scale = float(np.sqrt((self.wanted**2).mean())) or 1.0
        self.history: list[Step] = []

    def record(self, epoch: int, of: int, loss: float, arrays: Arrays) -> None:
        """Record the state of a training at some epochs.

        Raises
        ------
        SolveFailure
            If the loss is not finite; the earlier records come with it.
        """
        self.progress(Progress(epoch, of, f"loss {loss:.3g}"))
        if not np.isfinite(loss):
            partial = self.last if self.history else None  # type: ignore[has-type]
            raise SolveFailure(f"the training diverged in epoch {epoch}", partial)
        if epoch % max(of // LOOKS, 1) and epoch != of:
            return
        seconds = time.perf_counter() - self.began
        found_arrays = {self.prefix + name: array for name, array in (self.basis | dict(arrays)).items()}
        self.last = Skinned(self.case, self.solver, self.skin, {**self.earlier, **found_arrays}, tuple(self.history))
        primary = self.case.primary
        found = {primary.name: primary.measure(self.last)}
        self.began += time.perf_counter() - self.began - seconds  # recording is no part of it either
        self.history.append(Step(epoch, seconds, loss, self.last.parameters, quantities=found, iterations=epoch))

    def finish(self) -> Skinned:
        """Return the last state with its history."""
        return Skinned(self.case, self.solver, self.skin, self.last.arrays, tuple(self.history))


def train_dense(
    case: SkinningCase, solver: str, given: Given, settings: NetworkSettings, progress: ProgressCallback,
    earlier: Skinned | None = None,
) -> Skinned:  # fmt: skip
    """Train a perceptron from the input of a frame to coefficients, with frames in random order.

    After an `earlier` network of bones, it is the shape network of section 8: it adds what the earlier one lacks.
    """
    skin, prefix = (shape_skin, SHAPE) if earlier else (dense_skin(given), "")
    training = Training(case, solver, skin, settings.modes, progress, earlier, prefix)
    inputs = given(case, training.clips, case.seen)
    mean, spread = inputs.mean(axis=0), inputs.std(axis=0)
    spread[spread < SMALL] = 1.0  # the held bones do not move
    draw = np.random.default_rng(settings.seed)
    widths = (inputs.shape[1], *settings.widths, len(training.basis["modes"]))
    weights = [_drawn(draw, n, (n, m)) for n, m in pairwise(widths)]
    biases = [_drawn(draw, n, (m,)) for n, m in pairwise(widths)]
    x, wanted = _tensor((inputs - mean) / spread), _tensor(training.wanted)
    collide = Collision(training, settings.expansion) if settings.collision else None
    optimizer = torch.optim.Adam([*weights, *biases], lr=settings.learning_rate, fused=True)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.epochs)

    def arrays() -> dict[str, NDArray[np.float32]]:
        named = {f"weight_{i}": w for i, w in enumerate(weights)} | {f"bias_{i}": b for i, b in enumerate(biases)}
        kept = {name: tensor.detach().numpy().copy() for name, tensor in named.items()}
        return kept | {"input_mean": mean, "input_spread": spread, "scale": np.array([training.scale])}

    for epoch in range(1, settings.epochs + 1):
        total = 0.0
        for batch in _batches(draw, len(x), settings.batch):
            found = x[batch]
            for place, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
                found = found @ weight + bias
                found = torch.relu(found) if place < len(weights) - 1 else training.scale * found
            # The modes are orthonormal: the squared distance of meshes is that of coefficients, and a constant.
            loss = settings.data_weight * ((found - wanted[batch]) ** 2).sum(1).mean()
            if collide is not None:
                loss = loss + settings.collision_weight * collide(found, batch)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            total += float(loss.detach()) * len(batch) / len(x)
        slower.step()
        training.record(epoch, settings.epochs, total, arrays())
    return training.finish()


def train_recurrent(
    case: SkinningCase, solver: str, settings: RecurrentSettings, progress: ProgressCallback
) -> Skinned:
    """Train a gated recurrent unit (Cho et al. 2014) from the body's motion to coefficients, clip by clip."""
    training = Training(case, solver, recurrent_skin, settings.modes, progress)
    return _train_units(training, {"": training.wanted}, settings)


def train_chains(
    case: SkinningCase, solver: str, settings: ChainSettings, progress: ProgressCallback, skinned: Skinned
) -> Skinned:
    """Train a unit for each chain from the body's motion to its bones; a trained skinning network makes the mesh."""
    training = Training(case, solver, chains_skin, settings.modes, progress)
    moved = bones(case, training.clips, case.seen).reshape(len(case.seen), case.bones.nodes, case.bones.chains, 3)
    training.basis = dict(skinned.arrays)
    each = {chain(j): moved[:, :, j].reshape(len(moved), -1) for j in range(case.bones.chains)}
    return _train_units(training, each, settings)


def _train_units(training: Training, wanted: Mapping[str, Array], settings: RecurrentSettings) -> Skinned:
    """Train units from the body's motion to values of the training frames, {prefix: (n, m)}, each by itself."""
    # 1. Normalise the inputs by mean and spread of the training frames; mask the held-out frames.
    # 2. Draw the units' weights from the seed, and train by Adam with a cosine schedule.
    # 3. Each step takes whole clips; the loss is the mean square over the training frames in them.
    case = training.case
    frames, motion = case.cape.frames, course(training.clips)
    seen = np.zeros(case.cape.clips * frames, dtype=bool)
    seen[case.seen] = True
    mean, spread = motion.reshape(-1, motion.shape[-1])[seen].mean(0), motion.reshape(-1, motion.shape[-1])[seen].std(0)
    spread[spread < SMALL] = 1.0
    x, mask = _tensor((motion - mean) / spread), torch.from_numpy(seen.reshape(-1, frames))
    draw, width = np.random.default_rng(settings.seed), settings.width
    units = []
    for prefix, values in wanted.items():
        scale = float(np.sqrt((values**2).mean())) or 1.0
        aim = np.zeros((len(seen), values.shape[1]))
        aim[seen] = values
        unit = torch.nn.GRU(x.shape[-1], width, batch_first=True)
        with torch.no_grad():
            for tensor in unit.parameters():
                tensor.copy_(_drawn(draw, width, tuple(tensor.shape)).detach())
        out, bias = _drawn(draw, width, (width, aim.shape[1])), _drawn(draw, width, (aim.shape[1],))
        units.append((prefix, scale, _tensor(aim.reshape(len(mask), frames, -1)), unit, out, bias))
    learnt = [tensor for *_, unit, out, bias in units for tensor in (*unit.parameters(), out, bias)]
    optimizer = torch.optim.Adam(learnt, lr=settings.learning_rate, fused=True)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.epochs)

    def arrays() -> dict[str, NDArray[np.float32]]:
        kept: dict[str, NDArray[np.float32]] = {}
        for prefix, scale, _, unit, out, bias in units:
            named = {**dict(unit.named_parameters()), "out": out, "out_bias": bias}
            kept |= {prefix + name: tensor.detach().numpy().copy() for name, tensor in named.items()}
            kept |= {prefix + "input_mean": mean, prefix + "input_spread": spread, prefix + "scale": np.array([scale])}
        return kept

    clips_seen = np.flatnonzero(seen.reshape(-1, frames).any(axis=1))
    for epoch in range(1, settings.epochs + 1):
        total = 0.0
        for batch in _batches(draw, len(clips_seen), settings.batch):
            clips = torch.from_numpy(clips_seen[batch.numpy()])
            loss = torch.zeros(())
            for _, scale, wished, unit, out, bias in units:
                found = scale * (unit(x[clips])[0] @ out + bias)
                loss = loss + (((found - wished[clips]) ** 2).sum(-1) * mask[clips]).sum() / mask[clips].sum()
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            total += float(loss.detach()) * len(batch) / len(clips_seen)
        slower.step()
        training.record(epoch, settings.epochs, total, arrays())
    return training.finish()


class Collision:
    """The collision loss: it attracts vertices inside the expanded body to their places after a push toward the truth.

    The push has the length of the depth and the direction r-hat to the truth, and does not depend on the weights.
    Therefore a vertex' gradient is parallel to that of its distance from the truth. A push never passes the truth,
    which lies outside and no nearer than the depth.
    """

    def __init__(self, training: Training, expansion: float) -> None:
        seen, clips = training.case.seen, training.clips
        self.mean, self.modes = _tensor(training.basis["mean"]), _tensor(training.basis["modes"])
        self.start = _tensor(training.start)
        self.truth = clips.meshes[seen].reshape(len(seen), -1, 3).astype(np.float32)
        self.axes = clips.axes[seen].astype(np.float32)
        self.radii = clips.radii.astype(np.float32) + np.float32(expansion)

    def __call__(self, found: Tensor, batch: Tensor) -> Tensor:
        """Return the loss of coefficients (n, k), m^2, a mean over frames."""
        meshes = (self.start[batch] + self.mean + found @ self.modes).reshape(len(batch), -1, 3)
        number = batch.numpy()
        with np.errstate(over="ignore", invalid="ignore"):  # the loss shows a training that diverges
            target = pushed_targets(meshes.detach().numpy(), self.truth[number], self.axes[number], self.radii)
        return ((meshes - torch.from_numpy(target)) ** 2).sum() / len(batch)


def pushed_targets(
    meshes: NDArray[np.floating], truth: NDArray[np.floating], axes: NDArray[np.floating], radii: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Return places (n, v, 3), m: meshes, but vertices inside are pushed by their depth toward the truth."""
    depth = -distance(meshes, axes, radii)  # type: ignore[arg-type] # float32 too
    inside = depth > 0
    way = (truth - meshes)[inside]
    length = np.maximum(np.linalg.norm(way, axis=-1), SMALL)
    found = meshes.copy()
    found[inside] += (depth[inside] / length)[:, None] * way
    return found


def _drawn(draw: np.random.Generator, inputs: int, shape: tuple[int, ...]) -> Tensor:
    """Return uniform weights within 1/sqrt(inputs), as torch draws them, but from the seed alone."""
    return _tensor(draw.uniform(-1, 1, shape) / np.sqrt(inputs)).requires_grad_()


def _tensor(values: Array) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))


def _batches(draw: np.random.Generator, count: int, size: int) -> Iterator[Tensor]:
    yield from torch.from_numpy(draw.permutation(count)).split(size)  # type: ignore[no-untyped-call]
