"""Lower bounds of the error of a trained field, from challengers, and its uncertainty.

The last hidden layer of the trained network and challengers of `ndf-ritz` (see `refinement`) share one linear solve.
The changes of each quantity and of the energy by this solve are lower bounds of the trained field's error. The gain of
its last training step is another one. The answer remains the trained field: challengers only estimate its uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from shellbench.problem import Step
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.solvers.ndf.field.build import graded_points, usual_resolution
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.quadrature import NOWHERE, area_rule
from shellbench.solvers.ndf.field.supports import point_supports
from shellbench.solvers.ndf.linear.refinement import (
    TRAINED_SHARE,
    ErrorBounds,
    challenger_spec,
    finer_rule,
    first_level,
    joined_features,
    probe,
    quantity_changes,
    remaining_error,
    scale,
    uncertainties,
    why_unsettled,
)
from shellbench.solvers.ndf.linear.signs import jitter_share, rounding_energy
from shellbench.solvers.ndf.linear.solution import NdfSolution
from shellbench.solvers.ndf.linear.solve import potential_energy, solve_part
from shellbench.solvers.ndf.strains.energy import certify, concentrated, energy_gap, normal_equations, surface_area

# With planes of symmetry built in, a field is wide for its part of the shell, and further features gain little: as many
# challengers as features show half of an error that falls with the width, or faster. They resolve point forces more
# finely. The cases of the tuning are not on record.
MIRRORED_SHARE, MIRRORED_CHALLENGER_SCALES = 1.0, (1.0, 4.0)


@dataclass(frozen=True)
class ChallengedField:
    """A trained field compared with the one with challengers.

    Attributes
    ----------
    missed
        Lower bounds of the trained field's errors.
    gap
        Of the joined field: quadrature gap, and imbalance by regularisation.
    challengers
        Their number.
    """

    missed: ErrorBounds
    gap: float
    challengers: int


def with_uncertainty(solution: NdfSolution, seed: int, steps: Sequence[Step]) -> NdfSolution:
    """Return a trained solution with the uncertainty of each quantity, and the reason if it has not settled.

    `steps` are the states that training passed through; `seed` draws the challengers.
    """
    case, values = solution.case, dict(measure_all(solution))
    found = compare_with_challengers(solution, values, seed)
    missed = found.missed.or_larger(training_error(steps, values))
    gap = max(found.gap, solution.diagnostics["energy_gap"])
    rounding = _rounding(solution)
    scales = {q.name: scale(solution, q, values[q.name], rounding) for q in case.quantities}
    uncertainty = uncertainties(missed, gap, values, scales)
    told = {"challenge_gain": found.missed.energy, "challenge_gap": found.gap, "challengers": found.challengers}
    return replace(
        solution,
        uncertainty=uncertainty,
        unsettled=why_unsettled(uncertainty, scales),
        diagnostics={**solution.diagnostics, **told},
    )


def _rounding(solution: NdfSolution) -> float:
    case = solution.case
    rule = area_rule(case.surface.domain, NOWHERE, solution.rule)
    return rounding_energy(case.material.membrane_stiffness, surface_area(solution.field.ansatz, rule))


def training_error(steps: Sequence[Step], values: dict[str, float]) -> ErrorBounds:
    """Return the error that training leaves, from its last two gains: the tail of a geometric series."""
    changed = dict.fromkeys(values, 0.0)
    if len(steps) < 2:
        return ErrorBounds(changed, 0.0)
    gains = [abs(b.energy - a.energy) / max(abs(b.energy), np.finfo(float).tiny) for a, b in pairwise(steps)]
    left = remaining_error(gains[-1], gains[-2] if len(gains) > 1 else 0.0)
    before, last = steps[-2].quantities, steps[-1].quantities
    changed |= {name: abs(last[name] - before[name]) for name in last}
    return ErrorBounds(changed, gains[-1]).times(left)


def compare_with_challengers(solution: NdfSolution, values: dict[str, float], seed: int) -> ChallengedField:
    """Add challengers to a trained field of a linear shell at rest whose quantities have these values."""
    # 1. Take the rules of `ndf-ritz` for this case, graded toward edges and corners, with as many points a feature.
    # 2. Join the features: the trained last hidden layer, fixed features, challengers of all kinds, powers about
    #    corners.
    # 3. Solve once; compute the energies of both fields on the finer rule, each with the multiple that is best there.
    case, trained = solution.case, solution.field.features
    spec = challenger_spec(solution.spec)
    level, focal = first_level(case, usual_resolution(case)), graded_points(case, spec)
    ansatz, placement = solution.field.ansatz, trained.placement
    usual, share = level.resolution, TRAINED_SHARE
    if ansatz.mirrors:
        share, (plain, stretched) = MIRRORED_SHARE, MIRRORED_CHALLENGER_SCALES
        usual = replace(usual, scale=plain, stretched_scale=stretched)
    number = max(1, round(share * trained.network.width / len(level.kinds)))
    parts = ansatz.mirrors.parts if ansatz.mirrors else 1
    growth = max(1.0, math.sqrt(parts * (trained.network.width + len(level.kinds) * number) / usual.neurons))
    usual = replace(usual, neurons=0, rule=finer_rule(usual.rule, growth), fine=finer_rule(usual.fine, growth))
    features = joined_features(
        solution.field, solution.spec, replace(level, resolution=usual, challengers=number), seed
    )
    rule, fine = (ansatz.rule(focal, s) for s in (usual.rule, usual.fine))
    equations = normal_equations(ansatz, features, rule, concentrated(ansatz, usual.rule, focal, placement))
    layer = solve_part(ansatz, features, equations, np.arange(features.count))
    alone = solution.field.output.new_zeros((3, features.count))
    alone[:, : trained.count] = solution.field.output
    outputs = [alone, layer.weights.view(3, -1)]
    first, joined = certify(ansatz, features, outputs, fine, concentrated(ansatz, usual.fine, focal, placement))
    moved = ansatz.lift.moves or any(support.value for support in point_supports(case, solution.spec.t))
    rounding = _rounding(solution)
    gap = energy_gap(potential_energy(equations, layer.weights), joined, moved, rounding)
    gap += jitter_share(equations, layer.weights, layer.unbalanced, rounding)
    shares = (1.0, 1.0) if moved else (first.best, joined.best)
    membrane, bending, _ = joined.parts(shares[1])
    field = Field(ansatz, features, shares[1] * outputs[1], solution.field.output.new_zeros(6))
    other = replace(
        solution,
        field=field.without_rigid_part(rule),
        rule=usual.fine,
        membrane=membrane,
        bending=bending,
        point_forces=tuple((shares[1] * layer.reactions).tolist()),
        history=tuple(replace(step, energy=joined.potential(shares[1])) for step in solution.history[-1:]),
    )
    changed = quantity_changes(case, values, measure_all(other), (probe(solution), probe(other)))
    gained = abs(first.potential(shares[0]) - joined.potential(shares[1]))
    stored = membrane + bending + joined.spring_energy(shares[1]) + rounding
    return ChallengedField(ErrorBounds(changed, gained / stored), gap, len(level.kinds) * number)
