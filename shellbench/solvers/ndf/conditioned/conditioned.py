"""One neural field for all materials of a range: `ndf-conditioned`.

The hidden layer is drawn once, and does not depend on the material. The output layer is a function of the material,

    u(xi; material) = sum over k of c_k(material) u_k(xi),   u_k = W_k phi(xi),

with W_k the output layers that were solved for at some materials of the range, and c the coefficients of least energy,
which follow for any material from a small system (`reduced`). Only the layers W_k are solved for; nothing is trained by
descent, and nothing is interpolated between materials. Departure from the published recipe (Kairanda et al. 2023,
section 4.4): that makes thickness and modulus inputs of a network, and trains it by descent at random materials.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.series.conditioned import ConditionedCase, Material
from shellbench.problems.series.conditioned_answer import SECONDS_BEFORE, SECONDS_EACH, ConditionedAnswer
from shellbench.problems.series.quantities import Parameter, Value
from shellbench.solvers.ndf.conditioned.reduced import Equations, Reduced, asked_row, matrices_on_rule
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import (
    build_ansatz,
    build_features,
    build_inputs,
    graded_points,
    usual_resolution,
)
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.jets import Array, Placement
from shellbench.solvers.ndf.field.quadrature import ROUNDING, area_rule
from shellbench.solvers.ndf.field.supports import check_balance
from shellbench.solvers.ndf.field.weights import network_of, network_tensors, read_described, write_described
from shellbench.solvers.ndf.linear.refinement import SAFETY, SETTLED, first_level
from shellbench.solvers.ndf.linear.ritz_field import field_spec
from shellbench.solvers.ndf.linear.ritz_settings import ConditionedSettings, RitzSettings
from shellbench.solvers.ndf.linear.solve import solve_part
from shellbench.solvers.ndf.strains.energy import why_exploited

FORMAT = "ndf-conditioned, format 1"
CANDIDATES = (9, 7)  # thicknesses and Poisson's ratios of the grid from which materials are chosen
LAST_FIELDS = 2  # last fields, which must not change the displacement of any candidate
CHALLENGED = 8  # first fields, at the ends of the ranges, which are also solved for without challengers
ASKED_TIMES = 50  # answers by which their time is measured
"""Construction of the field.

Young's modulus multiplies all four parts alike, so u is inversely proportional to it, exactly: fields are solved for at
the middle one. Thickness and Poisson's ratio are chosen from a grid that is denser at the ends, each as
far from those before as can be.
"""


@dataclass(frozen=True, kw_only=True)
class ConditionedField(ConditionedAnswer):
    """A field for all materials of a range; see `shellbench.problem.Solution`.

    Attributes
    ----------
    spec
        The choices from which the field is rebuilt.
    features
        Features of all fields.
    layers
        (n, 3, M): their output layers W_k.
    rigid
        (n, 6): their rigid motions.
    reduced
        Their energies.
    """

    spec: FieldSpec
    features: Features
    layers: Tensor
    rigid: Tensor
    reduced: Reduced

    @cached_property
    def _ansatz(self) -> Ansatz:
        return build_ansatz(self.case.shell_of(self.case.middle), self.spec)

    @property
    def parameters(self) -> int:
        """Number of output weights that were solved for, of all materials."""
        return int(self.layers.numel())

    @property
    def storage_bytes(self) -> int:
        """Bytes of all tensors."""
        return sum(t.numel() * t.element_size() for t in self.tensors().values())

    def displacement(
        self, points: Array, at: float | None = None, material: Material | Mapping[str, float] | None = None
    ) -> Array:
        """Return the displacement (..., 3), m, at points (..., 2), of a material; the middle one if None.

        Raises
        ------
        InputError
            If the material is beyond the ranges, or parameters are missing.
        """
        chosen = self.case.chosen_material(material)
        c = torch.as_tensor(self.reduced.coefficients(chosen), dtype=self.layers.dtype)
        flat = self.case.shell_of(chosen).surface.domain.wrap(np.asarray(points, dtype=float).reshape(-1, 2))
        field = Field(self._ansatz, self.features, torch.tensordot(c, self.layers, 1), c @ self.rigid)
        with torch.no_grad():
            found = field.displacement(flat).cpu().numpy()
        return np.asarray(found.reshape(*np.shape(points)[:-1], 3))

    def asked(self, material: Material | Mapping[str, float]) -> float:
        """Return the asked displacement, m, at any material of the ranges; InputError beyond them."""
        return self.reduced.value(self.case.chosen_material(material))

    def derivative(self, material: Material | Mapping[str, float], by: Parameter) -> float:
        """Return the derivative of its logarithm by log h, log E or nu; InputError beyond the ranges."""
        return self.reduced.sensitivity(self.case.chosen_material(material), by)

    def value(self, number: int) -> float:
        """Return the asked displacement, m, at a held-out material."""
        return self.asked(self.case.materials[number])

    def sensitivity(self, number: int, by: Parameter) -> float:
        """Return the derivative of its logarithm at a held-out material."""
        return self.derivative(self.case.materials[number], by)

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors by the names they have in a file."""
        energies = {name: torch.as_tensor(array) for name, array in self.reduced.arrays().items()}
        return {**network_tensors(self.features.network), "layers": self.layers, "rigid": self.rigid, **energies}

    def save(self, path: Path) -> Path:
        """Write the field as safetensors, all other data as JSON in its header; return the file with its suffix."""
        words = {
            "format": FORMAT,
            "case": self.case.data(),
            "spec": self.spec.model_dump(mode="json"),
            "activation": self.features.network.activation,
            "uncertainty": dict(self.uncertainty),
        }
        return write_described(path, self.tensors(), words)

    @classmethod
    def load(cls, path: Path) -> ConditionedField:
        """Read a file of `save`; InputError in one sentence if it is no such file."""
        with read_described(path, FORMAT, "conditioned field") as (words, tensors):
            case = ConditionedCase.model_validate(words["case"])
            spec, features = read_features(case, words, tensors)
            energies = {name: tensors[name].numpy() for name in ("parts", "coarse", "load", "asked", "span")}
            return cls(
                case=case,
                uncertainty=words["uncertainty"],
                spec=spec,
                features=features,
                layers=tensors["layers"],
                rigid=tensors["rigid"],
                reduced=Reduced(**energies),
            )


def read_features(
    case: ConditionedCase, words: Mapping[str, Any], tensors: Mapping[str, Tensor]
) -> tuple[FieldSpec, Features]:
    """Return the choices and the features of a file, from its header and tensors; raise if they do not fit."""
    spec, shell = FieldSpec.model_validate(words["spec"]), case.shell_of(case.middle)
    inputs = build_inputs(shell, spec)
    hidden = {k: t for k, t in tensors.items() if k.startswith(("weight.", "bias."))}
    network = network_of(hidden, words["activation"], inputs.count)
    return spec, build_features(shell, spec, network, Placement(), inputs)


def solve(case: ConditionedCase, settings: ConditionedSettings, progress: ProgressCallback) -> ConditionedField:
    """Build the field of a case.

    Raises
    ------
    SolveFailure
        If the field exploits its quadrature at a held-out material or one that was solved for.
    """
    # 1. Draw one hidden layer, that of `ndf-ritz` with its challengers at the middle of the ranges. Integrate the four
    #    matrices of its features once.
    # 2. Solve for the output layer of least energy at one material after the other, at the first ones also without the
    #    challengers. Stop when the last fields no longer change the displacement of any candidate.
    # 3. Integrate the four matrices of these fields on a finer quadrature, from strains of the fields themselves, so
    #    that nothing cancels.
    # 4. State the uncertainty of each held-out value: the change by challengers in the span of the first fields, the
    #    change by the last fields, and the gap.
    with torch.no_grad():
        return _Build(case, settings, progress).field()


class _Build:
    """The steps of `solve`, and their common data."""

    def __init__(self, case: ConditionedCase, settings: ConditionedSettings, progress: ProgressCallback) -> None:
        self.begin = time.perf_counter()
        self.case, self.settings, self.progress = case, settings, progress
        self.shell = shell = case.shell_of(case.middle)
        usual = usual_resolution(shell)
        usual = replace(usual, neurons=settings.neurons or usual.neurons)
        self.level = first_level(shell, usual, given_width=settings.neurons is not None)
        self.chosen = self.level.resolution
        self.spec = field_spec(shell, RitzSettings()).model_copy(update={"detail": self.level.detail})
        self.placement = Placement.on(settings.device)
        self.focal, inputs = graded_points(shell, self.spec), build_inputs(shell, self.spec)
        self.ansatz = build_ansatz(shell, self.spec)
        network = self.level.network(inputs, settings.seed, self.spec.activation, self.placement)
        self.features = build_features(shell, self.spec, network, self.placement, inputs)
        self.asked = asked_row(self.ansatz, self.features)

    def field(self) -> ConditionedField:
        # 1. Integrate the four matrices of the features, and solve for fields at chosen materials, with and without
        #    challengers.
        # 2. Integrate the four matrices of these fields on the rule of the solves and on the finer one.
        # 3. Reduce: orthonormal combinations of the fields, once of those with challengers and once of those without.
        # 4. State uncertainties at the held-out materials, and refuse a field that exploits its quadrature.
        # The textbook's reduced basis has its matrices on one quadrature. Here the finer one serves for answers, and
        # the difference of the two is the gap.
        rule = area_rule(self.shell.surface.domain, self.focal, self.chosen.rule)
        check_balance(self.shell, rule, self.chosen.rule, self.focal)
        self.progress(Progress(0, None, "integrating the energy of the features"))
        equations = Equations.from_rule(self.ansatz, self.features, rule, self.chosen.rule, self.focal)
        usual = np.concatenate([
            np.arange(self.chosen.neurons),
            self.features.network.width + np.nonzero(self.features.fixed.coarser_mask())[0],
        ])  # fmt: skip
        everything = np.arange(self.features.count)
        full, alone, steps = self._solve_materials(equations, everything, usual)
        self.progress(Progress(len(full), None, "integrating the energy of the fields"))
        both = torch.stack([*full, *alone])
        on_rule = equations.reduced_matrices(both)
        fine = area_rule(self.shell.surface.domain, self.focal, self.chosen.fine)
        parts, loads = matrices_on_rule(self.ansatz, self.features, both, fine, self.chosen.fine, self.focal)
        asked = (both @ self.asked).numpy()
        n, middle = len(full), self.case.middle
        first, second = (
            Reduced.from_fields(parts[:, k, k], on_rule[:, k, k], loads[k], asked[k], middle)
            for k in (slice(0, n), slice(n, None))
        )
        layers = both[:n].view(n, 3, -1)
        rigid = torch.stack([
            Field(self.ansatz, self.features, layer, layer.new_zeros(6)).rigid_part(rule) for layer in layers
        ])  # fmt: skip
        built = time.perf_counter() - self.begin
        uncertainty, gap, missed = uncertainties(self.case, first, second)
        found = ConditionedField(
            case=self.case,
            history=(*steps, Step(len(steps), built, first.energy(middle), len(layers) * both.shape[1])),
            uncertainty=uncertainty,
            unsettled=_unsettled(self.case, first, uncertainty),
            diagnostics={
                SECONDS_BEFORE: built,
                SECONDS_EACH: _seconds_each(self.case, first),
                "energy_gap": gap,
                "challenge_gain": missed,
                "fields": n,
                "independent_fields": int(first.span.shape[1]),
                "neurons": self.features.network.width,
                "quadrature_points": len(rule.points),
                "fine_quadrature_points": len(fine.points),
            },
            spec=self.spec,
            features=self.features,
            layers=layers,
            rigid=rigid,
            reduced=first,
        )
        if (reason := why_exploited(gap, self.settings.largest_gap)) is not None:
            raise SolveFailure(reason, found)
        return found

    def _solve_materials(
        self, equations: Equations, everything: Any, usual: Any
    ) -> tuple[list[Tensor], list[Tensor], list[Step]]:
        """Return output layers (3 M,) with the challengers and without them, at as many materials as are needed."""
        full: list[Tensor] = []
        alone: list[Tensor] = []
        steps: list[Step] = []
        for number, material in enumerate(chosen_materials(self.case, self.settings.snapshots)):
            self.progress(Progress(number, None, f"solving at h = {material.thickness:.4g} m"))
            at = equations.at(material)
            layer = solve_part(self.ansatz, self.features, at, everything).weights
            full.append(layer)
            if number < CHALLENGED:
                alone.append(solve_part(self.ansatz, self.features, at, usual).weights)
            energy = -0.5 * float(at.load @ layer)
            steps.append(Step(number, time.perf_counter() - self.begin, energy, len(layer)))
            if len(full) > LAST_FIELDS + 1 and self._last_change(equations, full) <= self.settings.tolerance:
                break
        return full, alone, steps

    def _last_change(self, equations: Equations, layers: Sequence[Tensor]) -> float:
        """Return the largest relative change of a candidate's displacement by the last fields."""
        stacked = torch.stack(list(layers))
        parts, load = equations.reduced_matrices(stacked), (stacked @ equations.load).numpy()
        now = Reduced.from_fields(parts, parts, load, (stacked @ self.asked).numpy(), self.case.middle)
        before = now.without_last(LAST_FIELDS, self.case.middle)
        return max(abs(before.value(m) / now.value(m) - 1) for m in candidates(self.case)[0])


def candidates(case: ConditionedCase) -> tuple[list[Material], Array]:
    """Return the candidate materials, and their places (n, 2) in the unit square, denser at its ends."""
    thick, ratios = ((1 - np.cos(np.linspace(0, np.pi, count))) / 2 for count in CANDIDATES)
    places = np.array([(h, nu) for h in thick for nu in ratios])
    return [case.ranges.material((float(h), 0.5, float(nu))) for h, nu in places], places


def chosen_materials(case: ConditionedCase, most: int) -> Iterator[Material]:
    """Yield candidates: the middle one, then each as far as possible from those before."""
    materials, places = candidates(case)
    taken = [int(np.argmin(np.abs(places - 0.5).sum(axis=1)))]
    yield materials[taken[0]]
    while len(taken) < min(most, len(places)):
        apart = np.linalg.norm(places[:, None] - places[taken], axis=-1).min(axis=1)
        taken.append(int(apart.argmax()))
        yield materials[taken[-1]]


def uncertainties(case: ConditionedCase, first: Reduced, second: Reduced) -> tuple[dict[str, float], float, float]:
    """Return the uncertainty of each quantity, the largest gap, and the largest share of energy that was missed.

    Of a displacement: what the challengers change, or as a share of it the energy that they gain and the gap; of a
    derivative: what they change, and the gap. To both comes the most that the last fields have changed at any
    candidate: at a single material they may change little by chance. All times `SAFETY`.
    """
    shorter = first.without_last(LAST_FIELDS, case.middle)
    like = first.without_last(len(first.load) - len(second.load), case.middle)  # as many fields as `second` has
    gaps = [first.gap(material) for material in case.materials]
    missed = [abs(1 - second.energy(m) / like.energy(m)) for m in case.materials]
    among = candidates(case)[0]
    found: dict[str, float] = {}
    for quantity in case.quantities:
        material = case.materials[quantity.material]
        share = missed[quantity.material] + gaps[quantity.material] + ROUNDING
        value, challenged, alone = (quantity_of(one, material, quantity) for one in (first, like, second))
        scale = abs(value) if isinstance(quantity, Value) else 1.0
        last = max(_difference(first, shorter, candidate, quantity) for candidate in among)
        found[quantity.name] = SAFETY * (max(abs(challenged - alone), share * scale) + last * scale)
    return found, max(gaps), max(missed)


def _difference(one: Reduced, other: Reduced, material: Material, quantity: Any) -> float:
    """Return the difference of two answers in a quantity at some material, relative if it is a displacement."""
    first, second = (quantity_of(each, material, quantity) for each in (one, other))
    return abs(first - second) / (abs(first) if isinstance(quantity, Value) else 1.0)


def quantity_of(reduced: Reduced, material: Material, quantity: Any) -> float:
    """Return a quantity of a material."""
    if isinstance(quantity, Value):
        return reduced.value(material)
    return reduced.sensitivity(material, quantity.by)


def _unsettled(case: ConditionedCase, reduced: Reduced, uncertainty: Mapping[str, float]) -> str | None:
    """Return the reason that an answer has not settled, as a clause, or None if it has."""
    shares = {
        q.name: uncertainty[q.name] / abs(reduced.value(case.materials[q.material]))
        for q in case.quantities
        if isinstance(q, Value)
    }
    worst = max(shares, key=shares.__getitem__, default=None)
    if worst is None or shares[worst] <= SETTLED:
        return None
    return (
        f"{worst} may be off by {shares[worst]:.1e}: that is what challengers and the last fields still change, twice"
    )


def _seconds_each(case: ConditionedCase, reduced: Reduced) -> float:
    """Return the wall time of one answer, s."""
    start = time.perf_counter()
    for number in range(ASKED_TIMES):
        reduced.value(case.materials[number % len(case.materials)])
    return (time.perf_counter() - start) / ASKED_TIMES
