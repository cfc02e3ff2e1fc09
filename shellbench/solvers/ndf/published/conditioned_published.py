"""The published method for many materials: the material is an input of the network.

u(xi, material) = M(xi) F(xi, material) (Kairanda et al. 2023, eq. (37), at rest), trained by Adam on the energy (38) at
one material an iteration, drawn evenly from the ranges, and at one random point in each cell of a grid. The network,
the samples and Adam's constants are those of `published`. Thickness, modulus and ratio enter as their shares of the
ranges.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import ProgressCallback
from shellbench.problems.series.conditioned import ASKED, ConditionedCase, Material
from shellbench.problems.series.conditioned_answer import SECONDS_BEFORE, SECONDS_EACH, ConditionedAnswer, stepped
from shellbench.problems.series.quantities import Parameter
from shellbench.problems.shell.quantities.quantities import DisplacementQuantity
from shellbench.solvers.ndf.conditioned.reduced import part_rows, stiffnesses
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import build_inputs, focal_points, usual_resolution
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.inputs import Inputs
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement, constant
from shellbench.solvers.ndf.field.quadrature import Rule
from shellbench.solvers.ndf.field.supports import quantity_points
from shellbench.solvers.ndf.field.weights import read_described, write_described
from shellbench.solvers.ndf.published.published_network import InputScale, Siren, initial_siren, published_ansatz
from shellbench.solvers.ndf.published.published_samples import stratified_samples, usual_modulus_factor
from shellbench.solvers.ndf.published.published_settings import ConditionedPublishedSettings
from shellbench.solvers.ndf.published.published_training import LossNotFinite, Plan, first_checkpoint, train
from shellbench.solvers.ndf.strains.energy import concentrated, tabulate

FORMAT = "ndf-material, format 1"
INPUTS = len(Material._fields)
ITERATIONS_AT_ONCE = 10  # iterations that are tabulated at once
QUOTIENT_STEP = 1e-3  # of central difference quotients of the network, whose error is of its square
SEPARATE = 1  # stream of random numbers for materials, separate from that of points


def material_shares(case: ConditionedCase, material: Material) -> Array:
    """Return the position of a material in the ranges, (3,), from 0 to 1, on the linear scale of the draws."""
    ends = np.array([getattr(case.ranges, name) for name in Material._fields])
    return np.asarray((np.array(material) - ends[:, 0]) / (ends[:, 1] - ends[:, 0]))


def drawn_material(case: ConditionedCase, seed: int, iteration: int) -> Material:
    """Return the material of an iteration."""
    share = np.random.default_rng([seed, SEPARATE, iteration]).random(INPUTS)
    ends = [getattr(case.ranges, name) for name in Material._fields]
    return Material(*(float(low + s * (high - low)) for s, (low, high) in zip(share, ends, strict=True)))


@dataclass(frozen=True)
class ConditionedProblem:
    """A case with all data that its network needs."""

    case: ConditionedCase
    ansatz: Ansatz
    inputs: Inputs
    scale: InputScale
    placement: Placement

    @classmethod
    def from_case(cls, case: ConditionedCase, placement: Placement) -> ConditionedProblem:
        """Build the published boundary functions and inputs, which do not depend on the material."""
        spec = FieldSpec(stretched=False, multipliers=0)
        shell = case.shell_of(case.middle)
        inputs = build_inputs(shell, spec)
        return cls(case, published_ansatz(shell, spec), inputs, InputScale.from_inputs(inputs, placement), placement)

    def network_inputs(self, points: Array, material: Material) -> Tensor:
        """Return the jets (6, N, n + 3) of the network's inputs."""
        exact = self.placement._replace(dtype=torch.float64)
        plain = self.scale.apply(self.inputs.jets(points, exact).to(self.placement.dtype))
        return append_material(plain, material_shares(self.case, material))


def append_material(jets: Tensor, share: Array) -> Tensor:
    """Return jets (6, N, n + 3) with the material's shares as further inputs."""
    own = torch.as_tensor(share).to(jets).expand(jets.shape[1], INPUTS)
    return torch.cat([jets, constant(own, len(jets))], dim=-1)


@dataclass(frozen=True)
class Sample:
    """Data of the loss of one iteration: inputs, rows of the four parts with their factors, and forces."""

    inputs: Tensor
    rows: tuple[Tensor, ...]
    factors: Array
    force: Tensor

    def loss(self, siren: Siren) -> Tensor:
        """Return the energy (38) on the samples, divided by the factor of the modulus."""
        jets = siren.jets(self.inputs)
        count = len(self.rows[0])
        flat = jets[:, :count].permute(1, 2, 0).reshape(count, 18, 1)
        energy = -(self.force * jets[VALUE]).sum()
        for rows, factor in zip(self.rows, self.factors, strict=True):
            energy = energy + 0.5 * float(factor) * (rows.reshape(count, -1, 18) @ flat).square().sum()
        return energy


@dataclass(frozen=True)
class Sampler:
    """Source of the samples; see `shellbench.solvers.ndf.published.published_training.Sampling`."""

    question: ConditionedProblem
    settings: ConditionedPublishedSettings
    modulus_factor: float
    end: float = 1.0

    def samples(self, start: int, stop: int) -> Iterator[Sample]:
        """Yield the samples of iterations start, ..., stop - 1."""
        q, cells = self.question, self.settings.cells
        shell, dtype = q.ansatz.case, q.placement.dtype
        count, exact = math.prod(cells), q.placement._replace(dtype=torch.float64)
        forces = concentrated(q.ansatz, usual_resolution(shell).rule, focal_points(shell), exact)
        for first in range(start, stop, ITERATIONS_AT_ONCE):
            numbers = range(first, min(first + ITERATIONS_AT_ONCE, stop))
            points = np.concatenate([stratified_samples(shell, cells, self.settings.seed, k) for k in numbers])
            weights = np.full(len(points), math.prod(shell.surface.domain.size) / count)
            parts = [rows.to(dtype) for rows in part_rows(q.ansatz, points, weights, exact)]
            force = tabulate(q.ansatz, Rule(points, weights), exact).force.to(dtype)
            for k, number in enumerate(numbers):
                own = slice(k * count, (k + 1) * count)
                material = drawn_material(q.case, self.settings.seed, number)
                yield Sample(
                    q.network_inputs(np.concatenate([points[own], forces.points]), material),
                    tuple(rows[own] for rows in parts),
                    self.modulus_factor * stiffnesses(material),
                    torch.cat([force[own], forces.force.to(dtype)]),
                )


@dataclass(frozen=True, kw_only=True)
class TrainedField(ConditionedAnswer):
    """A trained network with the material as an input; it states no uncertainty."""

    siren: Siren
    unit: float

    @cached_property
    def _question(self) -> ConditionedProblem:
        return ConditionedProblem.from_case(self.case, Placement())

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return self.siren.parameters

    @property
    def storage_bytes(self) -> int:
        """Bytes of weights and biases."""
        return sum(t.numel() * t.element_size() for t in self.siren.tensors)

    def displacement(self, points: Array, at: float | None = None, material: Material | None = None) -> Array:
        """Return the displacement (N, 3), m, at points (N, 2), including rigid motions."""
        question, chosen = self._question, material or self.case.middle
        exact = self.siren.with_tensors([tensor.cpu().double() for tensor in self.siren.tensors])
        with torch.no_grad():
            free = self.unit * exact.jets(question.network_inputs(points, chosen))[VALUE]
            matrix = question.ansatz.factors.matrix(points, question.placement)[VALUE]
        return np.asarray((matrix @ free[..., None])[..., 0].numpy())

    def asked(self, material: Material) -> float:
        """Return the asked displacement, m."""
        shell = self._question.ansatz.case
        quantity = shell.quantity(ASKED)
        assert isinstance(quantity, DisplacementQuantity)
        points, directions = quantity_points(shell, quantity)
        return float(np.mean(np.sum(self.displacement(points, material=material) * directions, axis=-1)))

    def value(self, number: int) -> float:
        """Return the asked displacement, m, at a held-out material."""
        return self.asked(self.case.materials[number])

    def sensitivity(self, number: int, by: Parameter) -> float:
        """Return the derivative of its logarithm, by a difference quotient."""
        material = self.case.materials[number]
        ahead, behind = (self.asked(stepped(material, by, way * QUOTIENT_STEP)) for way in (1, -1))
        return (ahead - behind) / (2 * QUOTIENT_STEP) / self.asked(material)

    def save(self, path: Path) -> Path:
        """Write weights and biases as safetensors, all other data as JSON in the header."""
        words = {"format": FORMAT, "case": self.case.data(), "omega0": self.siren.omega0, "unit": self.unit}
        named = {f"{k:03d}": tensor for k, tensor in enumerate(self.siren.tensors)}
        return write_described(path, named, words)

    @classmethod
    def load(cls, path: Path) -> TrainedField:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        with read_described(path, FORMAT, "trained field for many materials") as (words, tensors):
            ordered = tuple(tensors[name] for name in sorted(tensors))
            half = len(ordered) // 2
            siren = Siren(ordered[:half], ordered[half:], float(words["omega0"]))
            case = ConditionedCase.model_validate(words["case"])
            return cls(case=case, siren=siren, unit=float(words["unit"]))


def solve(case: ConditionedCase, settings: ConditionedPublishedSettings, progress: ProgressCallback) -> TrainedField:
    """Train a network; SolveFailure if its loss becomes non-finite."""
    begin = time.perf_counter()
    placement = Placement.on(settings.device)._replace(dtype=getattr(torch, settings.dtype))
    question = ConditionedProblem.from_case(case, placement)
    count = question.inputs.count + INPUTS
    siren = initial_siren(count, settings.layers, settings.width, settings.omega0, settings.seed, placement)
    unit_of = usual_modulus_factor(question.ansatz)
    sampler = Sampler(question, settings, unit_of)
    plan = Plan(settings.iterations, settings.learning_rate)
    try:
        now = train(siren, first_checkpoint("", siren), sampler, plan, lambda network: {}, progress)
    except LossNotFinite as failure:
        raise SolveFailure(f"the training diverged: {failure}; try a smaller learning_rate") from None
    built = time.perf_counter() - begin
    found = TrainedField(case=case, siren=siren.with_tensors(now.weights), unit=unit_of)
    begin = time.perf_counter()
    for number in range(len(case.materials)):
        found.value(number)
    each = (time.perf_counter() - begin) / len(case.materials)
    return TrainedField(
        case=case,
        history=now.history,
        diagnostics={SECONDS_BEFORE: built, SECONDS_EACH: each, "modulus_factor": unit_of},
        siren=found.siren,
        unit=unit_of,
    )
