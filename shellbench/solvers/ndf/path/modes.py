"""Modes by `ndf-ritz` and `ndf`: small vibrations and buckling of a field whose output layer is solved for.

With w the output weights, the second variation of the potential energy at rest is K + G(s), s the stresses of the
linear answer to the case's loads. Of stationary values of Rayleigh's quotients,

    vibration  omega^2 = w.(K + G) w / w.M w,        buckling  lambda = -w.K w / w.G w,

a field's frequencies are upper bounds. Hidden layers of `ndf` are deep, and stay as drawn here: challengers are further
features of the last layer, and do not show errors outside the span of these layers. The unknowns are independent
combinations of features whose stiffness at rest is the identity; constraints remove free rigid motions, in the mean
over the area.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, eigh
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.modes import why_too_few
from shellbench.problems.shell.question.loads import MomentLoad
from shellbench.solvers.ndf.field.build import (
    build_ansatz,
    build_features,
    build_inputs,
    graded_points,
    usual_resolution,
)
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.field.network import deep_random_features
from shellbench.solvers.ndf.field.quadrature import area_rule
from shellbench.solvers.ndf.field.supports import check_balance
from shellbench.solvers.ndf.linear.constraints import SAME_ROW
from shellbench.solvers.ndf.linear.refinement import SAFETY, SLOWEST, Level, first_level, next_level, why_unsettled
from shellbench.solvers.ndf.linear.ritz_field import with_settings
from shellbench.solvers.ndf.linear.ritz_settings import NDF_RITZ, RitzSettings
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.path.equilibrium import PathProblem
from shellbench.solvers.ndf.path.newton import Basis
from shellbench.solvers.ndf.strains.sampled import elastic_form

Integers = NDArray[np.int64]

SETTLED_MODE = 1e-4  # relative uncertainty of a mode's value from which on an answer has not settled
WANTED = (
    SETTLED_MODE / 10
)  # the same for one level to be enough: corners may contribute more than their challengers show
SHAPES = 25  # points a side at which a shape's largest displacement is searched
FAR_FACTOR = 1e-6  # reciprocal of a load factor, relative to the largest, below which it is an error of the stresses
FINER_KIND = "finer"  # kind of features of the next level: a mode lacks shorter waves


def why_no_modes(case: Case, spec: FieldSpec | None = None) -> str | None:
    """Return the reason that a field can't give the modes of a case, as one clause, or None if it can."""
    if case.springs:
        return "it finds modes of shells without springs only"
    if any(support.motion is not None for support in case.supports):
        return "it finds modes under loads, not under supports that move"
    if spec is not None and spec.supports == "soft":
        return 'it finds modes with supports = "hard" only'
    if any(isinstance(load, MomentLoad) for load in case.loads):
        return "it finds no modes under moments on edges"
    return None


@dataclass(frozen=True)
class _FieldModes:
    """The modes of one field: their values and output weights (3 M, m), and the difference of two rules."""

    values: Array
    weights: Tensor
    gap: float


@dataclass(frozen=True)
class Recipe:
    """Recipe of the field: a solver's name, and the widths of hidden layers before the last, if any."""

    solver: str = NDF_RITZ
    inner: tuple[int, ...] = ()


RITZ = Recipe()


def solve(
    case: Case, spec: FieldSpec, settings: RitzSettings, progress: ProgressCallback, recipe: Recipe = RITZ
) -> PathSolution:
    """Find the modes by ever wider fields, until features of other kinds hardly change their values.

    Raises
    ------
    SolveFailure
        If there are fewer modes, or the shell is not stable at the state of the asked frequencies.
    """
    # 1. Solve each level twice on one basis: with the usual features, and with challengers of other kinds.
    # 2. Take the change by challengers as a lower bound of the error. From the second level on, compare it with the
    #    change by the next level, which may be larger. One level is enough only if challengers change hardly anything.
    # 3. Compute the values as Rayleigh's quotients on a finer rule. Add the difference to the rule of the solve to the
    #    uncertainty.
    began, usual = time.perf_counter(), with_settings(usual_resolution(case), settings)
    fixed = settings.neurons is not None or settings.panels is not None
    first = first_level(case, usual, settings.neurons is not None, settings.panels is not None)
    level: Level | None = first
    before: Array | None = None
    told: Array | None = None  # changes by challengers at the level before
    steps: list[Step] = []
    answer: PathSolution | None = None
    while level is not None:
        progress(Progress(level.number, None, f"modes with {level.resolution.neurons} neurons and their challengers"))
        one = _OneLevel(case, spec, settings, level, recipe)
        plain, whole = one.find(with_challengers=False), one.find(with_challengers=True)
        kept, gained = whole, np.abs(plain.values - whole.values)
        missed = gained
        if before is not None and told is not None:
            # Challengers can only lower a quotient. If it is higher on the finer rule, they have exploited their own
            # rule: they are no part of the answer, and their change is no estimate. The change by the level still is:
            # it is larger than that by the former challengers, and needs no further factor.
            if whole.gap > plain.gap and whole.values.mean() > plain.values.mean():
                kept, gained = plain, np.abs(before - plain.values)
                told = np.maximum(told, gained)
            missed = remaining_error(gained, told, np.abs(before - kept.values))
        sure = SAFETY * (missed + kept.gap * np.abs(kept.values))
        for found in (plain, whole):
            seconds = time.perf_counter() - began
            values = dict(zip([q.name for q in case.quantities], _quantity_values(case, found.values), strict=True))
            steps.append(Step(len(steps), seconds, float(found.values.mean()), one.unknowns, quantities=values))
        share = float((sure / np.abs(kept.values)).max())
        # The field of lower quotients is nearer to the solution. This need not be the wider one, which is worse
        # conditioned.
        if answer is not None and before is not None and kept.values.mean() > (1 + WANTED) * before.mean():
            answer = replace(answer, history=tuple(steps))
            break
        answer = one.solution(kept, sure, steps)
        if fixed or share <= (WANTED if before is None else SETTLED_MODE):
            break
        before, told = kept.values, gained
        del one  # its matrices, before those of the next level are made
        level = next_level(first, level, FINER_KIND, settings.most_neurons)
    assert answer is not None  # there is a first level
    return answer


def remaining_error(gained: Array, told: Array, changed: Array) -> Array:
    """Return the estimated errors of modes (m,).

    Challengers changed the modes by `gained` at this level and by `told` at the level before; `changed` is their change
    since that level. Therefore the change by challengers is multiplied by changed / told, at least 1. Later levels add
    the tail of a geometric series with the ratio gained / told.
    """
    least = np.finfo(float).tiny
    ratio = np.minimum(gained / np.maximum(told, least), SLOWEST)
    return np.asarray(gained * np.maximum(changed / np.maximum(told, least), 1.0) / (1 - ratio))


def _quantity_values(case: Case, values: Array) -> list[float]:
    """Return the values of the case's quantities from those of modes 1, 2, ..."""
    return [float(values[int(q.mark or 1) - 1]) for q in case.quantities]


class _OneLevel:
    """The features of one level, their matrices, and their modes."""

    def __init__(self, case: Case, spec: FieldSpec, settings: RitzSettings, level: Level, recipe: Recipe) -> None:
        self.case, self.level, self.solver = case, level, recipe.solver
        self.spec = spec.model_copy(update={"detail": level.detail})
        self.vibrates = case.quantities[0].kind == "frequency"
        placement, chosen = Placement.on(settings.device), level.resolution
        self.focal, inputs = graded_points(case, self.spec), build_inputs(case, self.spec)
        if recipe.inner:
            values = inputs.jets(case.surface.domain.grid(SHAPES, SHAPES).reshape(-1, 2), placement)[VALUE]
            widths = (*recipe.inner, chosen.neurons + len(level.kinds) * level.challengers)
            scales = placement.tensor(chosen.scales(inputs))
            network = deep_random_features(values, scales, widths, settings.seed, settings.activation)
        else:
            network = level.network(inputs, settings.seed, settings.activation, placement)
        # The jets of all points would take gigabytes, and each matrix needs them once only: they are not kept.
        self.features = build_features(case, self.spec, network, placement, inputs)
        # A linear measure has no second variation: the exact one, which agrees with it at rest, gives K and G.
        exact = self.spec.model_copy(update={"strain": "exact"})
        self.problem = PathProblem(exact, build_ansatz(case, exact), self.features, chosen.rule, self.focal, False)
        rule = area_rule(case.surface.domain, self.focal, chosen.rule)
        check_balance(case, rule, chosen.rule, self.focal)
        weights = self.problem.rest_weights
        self.rest = self.problem.deform(weights, 0.0)
        self.stiffness = self.problem.tangent(self.rest, 0.0)
        self.mass = self.problem.sampled.products(case.material.areal_density * self.problem.areas)

    @property
    def unknowns(self) -> int:
        """Number of output weights that are solved for."""
        return 3 * self.features.count

    def _basis(self, kept: Tensor) -> Basis:
        k, rows = self.case.material.membrane_stiffness, self.problem.constraints
        # The rows of `anchor` are mean displacements along free rigid motions.
        rows = torch.cat([rows, self.problem.anchor / math.sqrt(k)])[:, kept]
        stiffness = self.stiffness[kept][:, kept]
        return Basis.from_stiffness(stiffness + k * rows.T @ rows, rows, (SAME_ROW / k) ** 0.5)

    def _combinations(self, part: Integers) -> Tensor:
        """Return independent combinations (3 M, r) of the numbered features that the supports leave free."""
        kept = torch.as_tensor(self.features.pairs(part), device=self.stiffness.device)
        basis = self._basis(kept).combine
        combine = self.stiffness.new_zeros((self.unknowns, basis.shape[1]))
        combine[kept] = basis
        return combine

    def _linear_weights(self, part: Integers) -> Tensor | None:
        """Return the output weights (3 M,) of the linear answer to the case's loads; None without loads."""
        if not self.case.loads:
            return None
        # Powers about corners have infinite stresses there. A tiny amount of them, by rounding or the rule, hardly
        # affects a static answer, but buckles the shell at a point. Therefore the stresses exclude them.
        hidden, fixed = self.features.network.width, self.features.fixed
        before = np.array(fixed.kept, dtype=int) <= fixed.multipliers * len(fixed.foci)
        smooth = np.r_[part[part < hidden], hidden + np.nonzero(before)[0]]
        combine = self._combinations(smooth)
        stiffness = combine.T @ self.stiffness @ combine
        found: Tensor = combine @ torch.linalg.solve(stiffness, combine.T @ self.problem.forces(1.0)[0])
        return found

    def find(self, with_challengers: bool) -> _FieldModes:
        """Find the modes, with the usual features only or with their challengers."""
        # 1. Compute the stresses of the linear answer to the loads, if any, and their matrix G.
        # 2. Form independent combinations of the features, and A u = mu B u with mu the reciprocal of the asked value.
        # 3. Find the modes of largest mu, and their quotients on the finer rule.
        number, width = max(int(q.mark or 1) for q in self.case.quantities), self.level.resolution.neurons
        hidden, count = self.features.network.width, self.features.count
        part: Integers = np.arange(count) if with_challengers else np.r_[:width, hidden:count]
        loaded, combine = self._linear_weights(part), self._combinations(part)
        elastic, mass = (combine.T @ matrix @ combine for matrix in (self.stiffness, self.mass))
        geometric = None
        if loaded is not None:
            stresses = self.problem.predicted_stresses(self.rest, loaded)
            whole = self.problem.tangent(self.rest, 0.0, geometric=stresses) - self.stiffness
            geometric = combine.T @ whole @ combine
        ahead, elastic = self._eigenproblem(elastic, mass, geometric)
        size = len(ahead)
        if size < number:
            raise SolveFailure(f"the field has {size} independent combinations, too few for mode {number}")
        pair = [_symmetric(m) for m in (ahead, elastic)]
        try:
            inverse, shares = eigh(*pair, subset_by_index=(size - number, size - 1))
        except LinAlgError:
            raise SolveFailure("the shell is not stable at the state about which it is to vibrate") from None
        if not self.vibrates:
            least = float(eigh(*pair, eigvals_only=True, subset_by_index=(0, 0))[0])
            positive = inverse > FAR_FACTOR * max(inverse[-1], -least)
            if not positive.all():
                raise SolveFailure(why_too_few(number, int(positive.sum()), 1 / least if least < 0 else None))
        weights = combine @ torch.as_tensor(shares[:, ::-1].copy(), dtype=combine.dtype, device=combine.device)
        trained, values = 1 / inverse[::-1], self._certified_values(weights, loaded)
        gap = float(np.abs(trained / values - 1).max())
        if self.vibrates:
            values, gap = np.sqrt(values) / (2 * math.pi), gap / 2
        return _FieldModes(values, weights, gap)

    def _eigenproblem(self, elastic: Tensor, mass: Tensor, geometric: Tensor | None) -> tuple[Tensor, Tensor]:
        """Return A and B, whose largest eigenvalues are the reciprocals of the asked values."""
        if not self.vibrates:
            assert geometric is not None  # a case that asks for buckling loads has loads
            return -geometric, elastic
        return mass, elastic if geometric is None else elastic + geometric

    def _certified_values(self, weights: Tensor, loaded: Tensor | None) -> Array:
        """Return the values of the modes (3 M, m) by Rayleigh and Ritz on the finer rule."""
        fine = replace(self.problem, rule_spec=self.level.resolution.fine)
        rest = fine.deform(torch.zeros_like(weights[:, 0]), 0.0)
        gradients, moved = fine.sampled.of_several(weights.T.reshape(weights.shape[1], 3, -1))
        elastic = _form(elastic_form(fine.elasticity, rest.strained.variation), gradients)
        geometric = None
        if loaded is not None:
            geometric = _form(rest.strained.second_variation(fine.predicted_stresses(rest, loaded)), gradients)
        share = self.case.material.areal_density * fine.areas
        mass = torch.einsum("nci,n,ncj->ij", moved, share, moved)
        found = eigh(*(_symmetric(m) for m in self._eigenproblem(elastic, mass, geometric)), eigvals_only=True)
        return np.asarray(1 / found[::-1])

    def solution(self, found: _FieldModes, sure: Array, steps: Sequence[Step]) -> PathSolution:
        """Return the modes that the case asks for, as fields."""
        case, marks = self.case, self.case.states
        uncertainty = dict(zip([q.name for q in case.quantities], _quantity_values(case, sure), strict=True))
        values = dict(zip([q.name for q in case.quantities], _quantity_values(case, found.values), strict=True))
        return PathSolution(
            marks=marks,
            states=tuple(self._mode_shape(found.weights[:, int(mark) - 1]) for mark in marks),
            history=tuple(steps),
            uncertainty=uncertainty,
            unsettled=why_unsettled(uncertainty, values, SETTLED_MODE),
            mode_values={int(mark): float(found.values[int(mark) - 1]) for mark in marks},
            diagnostics={
                "energy_gap": found.gap,
                "level": self.level.number,
                "neurons": self.features.network.width,
                "features": self.features.count,
                "quadrature_points": len(self.problem.weights),
            },
        )

    def _mode_shape(self, weights: Tensor) -> NdfSolution:
        """Return a mode as a field whose largest component is about 1 m."""
        output = weights.view(3, -1)
        field = Field(build_ansatz(self.case, self.spec), self.features, output, output.new_zeros(6))
        moved = field.displacement(self.case.surface.domain.grid(SHAPES, SHAPES).reshape(-1, 2)).flatten()
        scaled = Field(field.ansatz, self.features, output / moved[moved.abs().argmax()], field.rigid)
        shape = NdfSolution(
            case=self.case,
            solver=self.solver,
            spec=self.spec,
            field=scaled,
            rule=self.level.resolution.fine,
            membrane=float("nan"),
            bending=float("nan"),
            parameters=self.unknowns,
        )
        membrane, bending = shape.energies()
        return replace(shape, membrane=membrane, bending=bending)


def _form(form: Tensor, gradients: Tensor) -> Tensor:
    """Return the products (m, m) of gradients (N, 15, m) by a form (N, 15, 15)."""
    return torch.einsum("nai,nab,nbj->ij", gradients, form, gradients)


def _symmetric(matrix: Tensor) -> Array:
    return np.asarray(((matrix + matrix.T) / 2).cpu().numpy())
