"""Refinement of a linear shell at rest by `ndf-ritz`, and the uncertainty that it states.

Each level solves twice on one basis. The first answer has features of one kind. Challengers then join: newly drawn
features, finer ones, ones that vary faster toward edges and points, and powers about corners. The change by the
challengers is a lower bound of the first answer's error. A level has settled if they hardly change its answer.
Otherwise the next level is wider, and of the kind of challenger that gained most energy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import unit
from shellbench.problems.shell.quantities.quantities import (
    DisplacementQuantity,
    EnergyQuantity,
    FieldError,
    LargestDisplacement,
    PotentialEnergy,
)
from shellbench.problems.shell.solution import ShellSolution
from shellbench.solvers.ndf.field.build import WIDTHS, Resolution, build_features, build_inputs, is_flat
from shellbench.solvers.ndf.field.choices import MULTIPLIERS, FieldSpec
from shellbench.solvers.ndf.field.corners import held_corners
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.geometry import side_lengths
from shellbench.solvers.ndf.field.inputs import Inputs, edge_layers, foci
from shellbench.solvers.ndf.field.jets import Array, Placement
from shellbench.solvers.ndf.field.network import Network, random_features
from shellbench.solvers.ndf.field.quadrature import ROUNDING, RuleSpec

SAFETY = 2.0  # of stated uncertainties, chosen before any error was known
SETTLED = 1e-3  # of a quantity's scale: required by gates of fields
NEGLIGIBLE = 1e-3  # part of the largest displacement below which a value's relative error is meaningless
LEVEL_WIDTHS = WIDTHS[1:]  # of each level, in units of the usual width
TRAINED_SHARE = 0.5  # challengers, in units of the width of the trained layer
SLENDER = 3.0  # ratio of a flat shell's sides from which on its ends have layers of their own; neighbours not on record
CORNER_CUTS = 2  # of cells at corners; the certificate has one more
EDGE_SCALE = 2.0  # of inputs stretched toward edges
SLOWEST = 0.8  # largest ratio of gains of two levels that a tail is summed with: four times the last gain
PROBES = 25  # points a side at which fields are compared, and the largest displacement is searched
REPEATED = 1.5  # times the panels a side: with 6 Gauss points in each, a hundredth of the rule's error
RULE_POWER = 0.4  # of the width, that panels a side grow by: .5 would keep the points a feature; not on record
LEAST_TAIL = 0.5  # of the change by a level: the one before had this error, and the new one may have half of it
LARGEST_SEED = 2**31


@dataclass(frozen=True)
class Kind:
    """A kind of features: factors of the scales of plain inputs, and of those stretched toward edges and points."""

    name: str
    plain: float
    edges: float
    points: float


# Rules that are graded toward points are coarse elsewhere, and fit the usual scales: finer ones exploit them. The cases
# of the tuning of these scales are not on record.
AROUND_POINTS = (Kind("anew", 1.0, 0.0, 1.0), Kind("finer", 1.4, 0.0, 0.7), Kind("layers", 0.7, 0.0, 1.2))
KINDS = (Kind("anew", 1.0, 1.0, 1.0), Kind("finer", 2.0, 1.0, 1.5), Kind("layers", 1.0, 2.0, 2.0))
SCALE_GROWTH = {
    "anew": (1.3, 1.0),
    "finer": (2.0, 1.0),
    "layers": (1.3, 1.5),
}  # of scales from level to level, by winner


@dataclass(frozen=True)
class Level:
    """Widths, scales and rules of one level.

    Attributes
    ----------
    resolution
        Of the first answer; its rules serve both.
    challenging
        Scales of the challengers' inputs before their kind multiplies them.
    challengers
        Number of neurons of each kind.
    detail
        See `shellbench.solvers.ndf.field.build.FieldSpec`.
    number
        From 0.
    kinds
        Of challengers.
    repeated
        Whether the same features were solved for on a coarser rule before.
    """

    resolution: Resolution
    challengers: int
    detail: int
    number: int = 0
    kinds: tuple[Kind, ...] = ()
    repeated: bool = False

    def on_finer_rule(self) -> Level:
        """Return the level with the same features on a finer rule, for challengers that exploit this one."""
        usual = self.resolution
        rule, fine = (finer_rule(spec, REPEATED) for spec in (usual.rule, usual.fine))
        return replace(self, resolution=replace(usual, rule=rule, fine=fine), repeated=True)

    def network(self, inputs: Inputs, seed: int, activation: str, placement: Placement) -> Network:
        """Draw the features of the first answer, then those of each kind of challenger."""
        drawn = [random_features(self._scales(inputs, None, placement), self.resolution.neurons, seed, activation)]
        for k, kind in enumerate(self.kinds):
            scales = self._scales(inputs, kind, placement)
            drawn.append(random_features(scales, self.challengers, _seed(seed, self.number, k), activation))
        weights, biases = (torch.cat([getattr(n, name)[0] for n in drawn]) for name in ("weights", "biases"))
        return Network((weights,), (biases,), activation)

    def each_scale(self, inputs: Inputs, placement: Placement) -> torch.Tensor:
        """Return the scale (M, n) of each input for all neurons: the first answer's, then each kind of challenger's."""
        kinds = [(None, self.resolution.neurons), *((kind, self.challengers) for kind in self.kinds)]
        return torch.cat([self._scales(inputs, kind, placement).expand(count, -1) for kind, count in kinds])

    def _scales(self, inputs: Inputs, kind: Kind | None, placement: Placement) -> torch.Tensor:
        usual = self.resolution
        if kind is not None:
            # Challengers have inputs stretched toward edges even if the first answer has none.
            usual = replace(
                usual,
                scale=usual.scale * kind.plain,
                edge_scale=(usual.edge_scale or EDGE_SCALE) * kind.edges,
                stretched_scale=usual.stretched_scale * kind.points,
            )
        return placement.tensor(usual.scales(inputs))

    def groups(self) -> tuple[np.ndarray, ...]:
        """Return the numbers of the neurons of each kind of challenger."""
        start, each = self.resolution.neurons, self.challengers
        return tuple(np.arange(start + k * each, start + (k + 1) * each) for k in range(len(self.kinds)))


def _seed(seed: int, level: int, kind: int) -> int:
    """Return another seed for each kind and level."""
    return int(np.random.SeedSequence([seed, level, kind]).generate_state(1)[0]) % LARGEST_SEED


def first_level(case: Case, usual: Resolution, given_width: bool = False, given_rule: bool = False) -> Level:
    """Return the first level of a case from its usual resolution, of which settings may fix a part."""
    neurons = usual.neurons * (2 if not given_width and is_slender(case) else 1)
    usual = replace(usual, neurons=neurons, edge_scale=_edge_scale(case))
    chosen = usual if given_rule else _with_layers(case, usual)
    return Level(chosen, _challengers(chosen), detail=1, kinds=AROUND_POINTS if foci(case) else KINDS)


def next_level(first: Level, before: Level, winner: str, most: int) -> Level | None:
    """Return the next level, by the kind of challenger that gained most; None if nothing wider is allowed."""
    number = before.number + 1
    if number >= len(LEVEL_WIDTHS):
        return None
    neurons = min(round(LEVEL_WIDTHS[number] * first.resolution.neurons), most)
    if neurons <= before.resolution.neurons:
        return None
    plain, stretched = SCALE_GROWTH[winner]
    old, growth = before.resolution, LEVEL_WIDTHS[number] ** RULE_POWER
    resolution = replace(
        old,
        neurons=neurons,
        scale=old.scale * plain,
        edge_scale=(old.edge_scale or EDGE_SCALE if winner == "layers" else old.edge_scale) * stretched,
        stretched_scale=old.stretched_scale * stretched,
        rule=finer_rule(old.rule if before.repeated else first.resolution.rule, growth),
        fine=finer_rule(old.fine if before.repeated else first.resolution.fine, growth),
    )
    return Level(resolution, _challengers(resolution), detail=2, number=number, kinds=before.kinds)


def _challengers(resolution: Resolution) -> int:
    return max(4, round(resolution.share * resolution.neurons / len(KINDS)))


def _edge_scale(case: Case) -> float:
    """Return the scale of inputs stretched toward edges in a first answer; zero if it has none."""
    if foci(case):
        return 0.0
    return EDGE_SCALE if not is_flat(case) or is_slender(case) else 0.0


def is_slender(case: Case) -> bool:
    """Return True if a shell is flat, and much longer than wide."""
    lengths = side_lengths(case)
    return is_flat(case) and max(lengths) > SLENDER * min(lengths)


def slender_rule(case: Case, spec: RuleSpec) -> RuleSpec:
    """Return a rule of a slender shell with twice the panels along it, since its inputs resolve the ends' layers."""
    if foci(case) or not is_slender(case):
        return spec
    along = int(np.argmax(side_lengths(case)))
    panels = (2 * spec.panels[0], spec.panels[1]) if along == 0 else (spec.panels[0], 2 * spec.panels[1])
    return replace(spec, panels=panels)


def _with_layers(case: Case, usual: Resolution) -> Resolution:
    """Return a resolution whose rules are graded toward edges, if nothing acts at points, and toward corners."""
    rule, fine = (slender_rule(case, spec) for spec in (usual.rule, usual.fine))
    return replace(usual, rule=graded_rule(case, rule), fine=graded_rule(case, fine, CORNER_CUTS + 1))


def graded_rule(case: Case, spec: RuleSpec, corner_cuts: int = CORNER_CUTS) -> RuleSpec:
    """Return a rule that is graded toward edges, if nothing acts at points, and toward corners where any is held."""
    layers = edge_layers(case, flat=True)
    if not foci(case) and layers is not None:
        spec = replace(spec, layers=layers)
    return spec if foci(case) and not held_corners(case) else replace(spec, corner_cuts=corner_cuts)


def finer_rule(spec: RuleSpec, growth: float) -> RuleSpec:
    """Return a rule of as many times the panels along each side, rounded up."""
    first, second = (math.ceil(growth * number) for number in spec.panels)
    return replace(spec, panels=(first, second))


@dataclass(frozen=True)
class ErrorBounds:
    """Lower bounds of the errors of an answer, from a finer one.

    Attributes
    ----------
    changes
        By quantity, in its unit.
    energy
        Energy gained, as a share of the energy stored.
    """

    changes: Mapping[str, float]
    energy: float

    def times(self, factor: float) -> ErrorBounds:
        """Return the bounds times a factor."""
        return ErrorBounds({name: factor * value for name, value in self.changes.items()}, factor * self.energy)

    def or_larger(self, other: ErrorBounds) -> ErrorBounds:
        """Return the larger bound of each value."""
        changes = {name: max(value, other.changes[name]) for name, value in self.changes.items()}
        return ErrorBounds(changes, max(self.energy, other.energy))


def quantity_changes(
    case: Case, before: Mapping[str, float], after: Mapping[str, float], displacements: tuple[Array, Array]
) -> dict[str, float]:
    """Return the change of each quantity, in its unit, from its values before and after.

    `displacements` are those before and after at points all over the shell, (n, 3) each, metres.
    """
    # One displacement may change little by chance, where the field's change passes through zero. Therefore its change
    # counts as at least that of the field along the same direction, in the mean square over the shell.
    moved = displacements[1] - displacements[0]
    least = {}
    for q in case.quantities:
        if isinstance(q, LargestDisplacement | DisplacementQuantity):
            directions = np.array([unit(d) for d in q.directions]) if isinstance(q, DisplacementQuantity) else np.eye(3)
            least[q.name] = float(np.sqrt(np.mean((moved @ directions.T) ** 2)))
        if isinstance(q, LargestDisplacement) and q.name in after:
            least[q.name] = min(least[q.name], _possible_rise(moved, displacements[1], after[q.name]))
    return {name: max(abs(value - before[name]), least.get(name, 0.0)) for name, value in after.items()}


def _possible_rise(moved: Array, displacement: Array, largest: float) -> float:
    """Return the possible rise of the largest displacement if the field changes again, twice as much, metres.

    No features can change a prescribed displacement: if the largest one is prescribed, it is certain as long as the
    rest of the shell stays below it. No bound is known if the largest one is not prescribed, or between the points.
    """
    size, change = np.linalg.norm(displacement, axis=-1), np.linalg.norm(moved, axis=-1)
    free = change > ROUNDING * size.max()
    if free[np.argmax(size)] or largest > (1 + ROUNDING) * size.max():
        return math.inf
    change = SAFETY * np.maximum(change, np.sqrt(np.mean(change**2)))
    return float(max(0.0, (size + change)[free].max(initial=0.0) - size.max()))


def probe(solution: ShellSolution, at: float | None = None) -> Array:
    """Return the displacement (n, 3) of a solution at points all over the shell, metres."""
    points = solution.case.surface.domain.grid(PROBES, PROBES).reshape(-1, 2)
    return solution.displacement(points, at)


def gain_left(energies: tuple[float, float, float], steps: float) -> float:
    """Return the gain of so many further steps, in units of the last gain, from three energies that fall step by step.

    Gains shrink by the ratio of the two known ones; if these give no ratio below 1, the gains are taken as constant.
    """
    former, last = energies[0] - energies[1], energies[1] - energies[2]
    ratio = last / former if 0 < last < former else 1.0
    return steps if ratio == 1.0 else ratio * (1 - ratio**steps) / (1 - ratio)


def remaining_error(last: float, former: float) -> float:
    """Return the estimated error of an answer, in units of its change since the level before.

    It is the tail of a geometric series, from the shares of energy gained by this change and by the one before, but at
    least `LEAST_TAIL`.
    """
    ratio = min(last / former, SLOWEST) if former > 0 else 0.0
    return max(LEAST_TAIL, ratio / (1 - ratio))


def uncertainties(
    missed: ErrorBounds,
    gap: float,
    values: Mapping[str, float],
    scales: Mapping[str, float],
    rounding: float = ROUNDING,
) -> dict[str, float]:
    """Return the uncertainty of an answer in each quantity, from the lower bounds of its errors.

    It is the larger of two numbers, times `SAFETY`: the change of the quantity; and its scale times the sum of the
    energy gained, `rounding` and `gap`. `gap` is the difference of the two quadratures and the imbalance left by
    regularisation.
    """
    # A value may change little by chance; the energy can't, since it only falls. Displacements on which the load works
    # have the relative error of the energy, others a larger one. Its share therefore is no bound, and the change of the
    # value itself counts too.
    share = missed.energy + gap + rounding
    return {name: SAFETY * max(missed.changes[name], share * scales[name]) for name in values}


def scale(
    solution: ShellSolution, quantity: object, value: float, rounding: float, displacement: Array | None = None
) -> float:
    """Return the scale of a quantity's uncertainty.

    Energies are compared with the whole strain energy, or with one that is `rounding`, J. Displacements near zero are
    compared with a small part of the largest one; `displacement` (n, 3) are the solution's at the probes.
    """
    match quantity:
        case EnergyQuantity():
            return max(sum(solution.energies()), rounding)
        case PotentialEnergy():  # with loads and moved supports it may be any part of the stored energy
            return max(abs(value), sum(solution.energies()), rounding)
        case FieldError():
            return 1.0  # it is already relative, and converges to zero
        case LargestDisplacement() | DisplacementQuantity():
            moved = probe(solution) if displacement is None else displacement
            largest = float(np.linalg.norm(moved, axis=-1).max())
            return max(abs(value), NEGLIGIBLE * largest, np.finfo(float).tiny)
    return max(abs(value), float(np.finfo(float).tiny))


def why_unsettled(uncertainty: Mapping[str, float], scales: Mapping[str, float], limit: float = SETTLED) -> str | None:
    """Return the reason that an answer has not settled, as a clause, or None if it has, or if nothing is asked for.

    It has settled if no uncertainty is above `limit` of its scale.
    """
    if not uncertainty:
        return None
    worst = max(uncertainty, key=lambda name: uncertainty[name] / scales[name])
    share = uncertainty[worst] / scales[worst]
    if share <= limit:  # False if it is NaN
        return None
    return f"{worst} may be off by {share:.1e} of its scale: that is what features of other kinds still change, twice"


def joined_features(field: Field, spec: FieldSpec, level: Level, seed: int) -> Features:
    """Return the features of a trained field, built by the choices `spec`, together with challengers."""
    case, trained, multipliers = field.ansatz.case, field.features, spec.multipliers
    spec = challenger_spec(spec)
    inputs, placement = build_inputs(case, spec), trained.placement
    network = level.network(inputs, seed, spec.activation, placement)
    drawn = build_features(case, spec, network, placement, inputs)
    # The constant is among the trained features, and so are the singular ones unless settings left them out.
    there = 1 + multipliers * len(drawn.fixed.foci)
    new = replace(drawn.fixed, kept=tuple(k for k in drawn.fixed.kept if k >= there))
    return replace(trained, beside=replace(drawn, fixed=new))


def challenger_spec(spec: FieldSpec) -> FieldSpec:
    """Return the choices of challengers: with stretched inputs, singular features and powers about corners."""
    more = {"stretched": True, "edge_stretched": True, "multipliers": spec.multipliers or MULTIPLIERS, "detail": 1}
    return spec.model_copy(update=more)
