"""Linear shells at rest by `ndf-ritz`: levels of ever more features, until challengers hardly change the answer.

With loads only, each answer is the multiple of the found field that is best on the finer quadrature, so that the error
of the training quadrature does not scale it.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial

import numpy as np
import torch

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.quantities import ResultantQuantity
from shellbench.solvers.ndf.field.build import (
    build_ansatz,
    build_features,
    build_inputs,
    field_mirrors,
    graded_points,
)
from shellbench.solvers.ndf.field.choices import FieldSpec
from shellbench.solvers.ndf.field.field import Field
from shellbench.solvers.ndf.field.jets import KINKED, Placement
from shellbench.solvers.ndf.field.quadrature import NOWHERE, area_rule
from shellbench.solvers.ndf.field.supports import check_balance, point_supports
from shellbench.solvers.ndf.linear.answer import STRONGER, BestLevel, Candidate, SolvedLevel, displacement_values
from shellbench.solvers.ndf.linear.patches import Balances
from shellbench.solvers.ndf.linear.refinement import (
    KINDS,
    ErrorBounds,
    Level,
    first_level,
    next_level,
    remaining_error,
    scale,
    uncertainties,
    why_unsettled,
)
from shellbench.solvers.ndf.linear.regularised import JITTER
from shellbench.solvers.ndf.linear.ritz_field import mirrors_by_default, part_resolution, with_settings
from shellbench.solvers.ndf.linear.ritz_settings import NDF_RITZ, RitzSettings
from shellbench.solvers.ndf.linear.signs import Signs, jitter_share, net_work, refusal, rounding_energy, unseen_turning
from shellbench.solvers.ndf.linear.solution import NdfSolution
from shellbench.solvers.ndf.linear.solve import potential_energy, solve_part
from shellbench.solvers.ndf.strains.energy import certify, concentrated, energy_gap, normal_equations, surface_area
from shellbench.solvers.ndf.strains.soft import Springs, support_error

PENALTY = 1e4  # supports yield by at most 1e-5 of the deflection, and rounding takes less than 1e-3 of the energy
NESTED = (0.25, 0.5, 1.0)  # shares of the width of the nested fields of the convergence curve


def solve(case: Case, spec: FieldSpec, settings: RitzSettings, progress: ProgressCallback) -> NdfSolution:
    """Refine level by level until the challengers hardly change an answer, or nothing wider is allowed.

    Raises
    ------
    SolveFailure
        If no level has an answer (see `shellbench.solvers.ndf.linear.signs`).
    """
    # 1. Solve for two answers on one basis: the usual features, and those with challengers of other kinds.
    # 2. Take the change by the second answer, and the change since the last level, as lower bounds of the first one's
    #    error. A stronger regularisation estimates the effect of the usual one. The uncertainty of each quantity
    #    follows.
    # 3. If not settled, make the next level wider, on a finer rule, and of the kind of challenger that gained most.
    # A level that exploits its quadrature has no answer, but the next one may have. If challengers lose certified
    # energy, they exploit the rule: the level is solved once more on a finer one. The level of least certified energy
    # is the answer: newly drawn features need not span the former ones. If settings fix width or panels, the first
    # answer stays, and challengers only estimate its uncertainty.
    begin = time.perf_counter()
    given_width, given_rule = settings.neurons is not None, settings.panels is not None
    fixed = given_width or given_rule
    # Fields of given widths serve for comparisons with each other, and with those of other recipes.
    wanted = not fixed and mirrors_by_default(case) if settings.mirrors is None else settings.mirrors
    asked = spec.model_copy(update={"mirrors": wanted})
    mirrors = field_mirrors(case, asked)
    spec = spec if mirrors is None else asked
    usual = with_settings(part_resolution(case, mirrors), settings)
    first = first_level(case, usual, given_width, given_rule)
    level: Level | None = first
    kept: BestLevel | None = None
    steps: list[Step] = []
    answer: NdfSolution | None = None
    balances: Balances = {}
    while level is not None:
        progress(Progress(level.number, None, f"solving with {level.resolution.neurons} neurons and their challengers"))
        solved = _solve_level(case, spec, settings, level, begin, balances)
        last = solved.first if fixed else solved.best
        exploiting = solved.best is not solved.with_challengers
        reason = refusal(last.signs, last.solution.spec, settings.largest_gap)
        alone = refusal(solved.first.signs, solved.first.solution.spec, settings.largest_gap)
        if reason is not None and alone is None:
            # Only the challengers exploit the rule: they are no part of the answer.
            last, reason = solved.first, None
        if reason is not None and kept is not None:
            break
        steps += [a.step for a in (*solved.narrower, solved.first, *(() if last is solved.first else (last,)))]
        missed = solved.error_bounds()
        if kept is not None:
            since = kept.answer.error_bounds(last)
            if last.exploits_rule(_energy_on_rule(kept.answer, level, settings)):
                last, solved, missed = kept.answer, kept.solved, kept.missed.or_larger(since)
            else:
                left = remaining_error(since.energy, kept.missed.energy)
                missed = missed.times(max(1.0, left)).or_larger(since.times(left))
        answer, wider = _as_answer(last, solved, tuple(steps), missed)
        exploited = replace(
            last.signs, gap=0.0, jitter_share=last.signs.jitter_share if spec.supports == "soft" else 0.0
        )
        curable = refusal(exploited, last.solution.spec, settings.largest_gap) is None
        if reason is not None and (fixed or not curable):
            break
        if fixed or (reason is None and wider is None):
            break
        winner = KINDS[0].name
        if reason is None:
            kept = BestLevel(last, solved, missed)
            if exploiting and not level.repeated:
                level = level.on_finer_rule()
                continue
            if not exploiting:
                reached = solved.energies()
                winner = min(reached, key=reached.__getitem__)
        level = next_level(first, level, winner, settings.most_neurons)
    assert answer is not None
    if fixed:
        answer = _without_challengers(answer, first.resolution.neurons)
    if reason is not None and kept is None:
        raise SolveFailure(reason, answer)
    return answer


def _energy_on_rule(answer: Candidate, level: Level, settings: RitzSettings) -> float:
    """Return the potential energy of an answer on the finer rule of another level, J."""
    solution, spec = answer.solution, level.resolution.fine
    case, field = solution.case, solution.field
    ansatz, features, focal = field.ansatz, field.features, graded_points(case, solution.spec)
    forces = concentrated(ansatz, spec, focal, features.placement)
    energies = certify(ansatz, features, [field.output], ansatz.rule(focal, spec), forces)[0]
    if ansatz.soft:
        springs = Springs.from_spec(ansatz, spec, focal, settings.penalty or PENALTY)
        energies = springs.certify(energies, ansatz, features, field.output)
    return energies.potential()


def _without_challengers(solution: NdfSolution, width: int) -> NdfSolution:
    """Return a solution whose network has only its first features: the others have no weight."""
    field, total = solution.field, solution.field.features.network.width
    features = replace(field.features, network=field.features.network.first_features(width))
    output = torch.cat([field.output[:, :width], field.output[:, total:]], dim=1)
    return replace(solution, field=Field(field.ansatz, features, output, field.rigid))


def _as_answer(
    last: Candidate, solved: SolvedLevel, steps: tuple[Step, ...], missed: ErrorBounds
) -> tuple[NdfSolution, str | None]:
    """Return an answer with its history and uncertainty, and the reason for a wider field, or None."""
    # Stress resultants are derivatives, and settle last: they need wider fields. But a field with settled displacements
    # is an answer, and each resultant states its uncertainty.
    solution = last.solution
    area = surface_area(solution.field.ansatz, area_rule(solution.case.surface.domain, NOWHERE, solution.rule))
    rounding = rounding_energy(solution.case.material.membrane_stiffness, area)
    scales = {q.name: scale(solution, q, last.values[q.name], rounding) for q in solution.case.quantities}
    missed = missed.or_larger(_recovery_bounds(solution))
    gap = max(a.signs.gap + a.signs.jitter_share for a in (solved.first, solved.with_challengers))
    uncertainty = uncertainties(missed, gap, last.values, scales)
    others = {q.name for q in solution.case.quantities if not isinstance(q, ResultantQuantity)}
    numbered = tuple(replace(step, iteration=k) for k, step in enumerate(steps))
    stated = replace(
        solution,
        history=numbered,
        uncertainty=uncertainty,
        unsettled=why_unsettled({name: value for name, value in uncertainty.items() if name in others}, scales),
        diagnostics={
            **solution.diagnostics,
            "support_error": support_error(solution.field),
            "level": solved.level.number,
            "challenge_gain": missed.energy,
            "challengers": len(solved.level.kinds) * solved.level.challengers,
        },
    )
    return stated, why_unsettled(uncertainty, scales)


def _recovery_bounds(solution: NdfSolution) -> ErrorBounds:
    """Return lower bounds of the errors of recovered stress resultants: their difference to a coarser degree."""
    changed = {q.name: 0.0 for q in solution.case.quantities}
    for q in solution.case.quantities:
        if isinstance(q, ResultantQuantity):
            points, weights = q.rule(solution.case)
            coarser, finer = (
                q.component_of(q.turned(solution.case, points, values))
                for values in solution.recovered_resultants(q.kind, points)
            )
            changed[q.name] = abs(float(weights @ (finer - coarser)))
    return ErrorBounds(changed, 0.0)


def _solve_level(
    case: Case, spec: FieldSpec, settings: RitzSettings, level: Level, begin: float, balances: Balances
) -> SolvedLevel:
    # 1. Draw the level's features, and integrate the normal equations on its rule; soft supports join as springs.
    # 2. Choose nested parts of the features: parts of the usual ones, all of them, and those with challengers, the last
    #    ones with three levels of regularisation.
    # 3. Solve for the output layer of each part from the same matrix, and certify all energies on the finer rule at
    #    once.
    # 4. Scale each answer by its best multiple if nothing moves, remove its rigid motion, and collect its signs and
    #    history.
    # Textbooks solve one Ritz basis. Here nested bases of one matrix show the error at the cost of further
    # factorisations.
    spec = spec.model_copy(update={"detail": level.detail})
    placement, focal, chosen = Placement.on(settings.device), graded_points(case, spec), level.resolution
    ansatz, inputs = build_ansatz(case, spec), build_inputs(case, spec)
    network = level.network(inputs, settings.seed, settings.activation, placement)
    features = build_features(case, spec, network, placement, inputs)
    whole, rule = (each(focal, chosen.rule) for each in (partial(area_rule, case.surface.domain), ansatz.rule))
    check_balance(case, whole, chosen.rule, focal)
    equations = normal_equations(ansatz, features, rule, concentrated(ansatz, chosen.rule, focal, placement))
    weight = settings.penalty or PENALTY
    springs = Springs.from_spec(ansatz, chosen.fine, focal, weight) if ansatz.soft else None
    if springs:
        equations = Springs.from_spec(ansatz, chosen.rule, focal, weight).added_to(equations, ansatz, features)

    hidden, former = network.width, np.logical_or(features.fixed.coarser_mask(), level.number > 1)
    plain, powers = hidden + np.nonzero(former)[0], hidden + np.nonzero(~former)[0]
    shares = NESTED if level.number == 0 and not level.repeated else NESTED[-1:]
    widths = sorted({math.ceil(share * chosen.neurons) for share in shares})
    parts = [np.concatenate([np.arange(width), plain]) for width in widths]
    parts.append(np.arange(features.count))
    parts += [parts[-1]] * 2
    jitters = [JITTER] * (len(parts) - 3) + [STRONGER**2 * JITTER, STRONGER * JITTER, JITTER]
    both = zip(parts, jitters, strict=True)
    layers = [solve_part(ansatz, features, equations, part, level=jitter) for part, jitter in both]
    outputs = [layer.weights.view(3, -1) for layer in layers]
    fine = ansatz.rule(focal, chosen.fine)
    certified = certify(ansatz, features, outputs, fine, concentrated(ansatz, chosen.fine, focal, placement))
    moved = ansatz.lift.moves or any(support.value for support in point_supports(case, spec.t))
    if springs:
        certified = [springs.certify(c, ansatz, features, o) for c, o in zip(certified, outputs, strict=True)]
        moved = springs.moved
    rounding = rounding_energy(case.material.membrane_stiffness, surface_area(ansatz, rule))
    answers: list[Candidate] = []
    for part, jitter, layer, output, energies in zip(parts, jitters, layers, outputs, certified, strict=True):
        potential = potential_energy(equations, layer.weights)
        gap = energy_gap(potential, energies, moved, rounding)
        share = 1.0 if moved else energies.best
        membrane, bending, _ = energies.parts(share)
        field = Field(ansatz, features, share * output, output.new_zeros(6))
        solution = NdfSolution(
            case=case,
            solver=NDF_RITZ,
            spec=spec,
            field=field.without_rigid_part(whole),
            rule=chosen.fine,
            membrane=membrane,
            bending=bending,
            parameters=len(features.pairs(part)),
            point_forces=springs.point_forces(field) if springs else tuple((share * layer.reactions).tolist()),
            balances=balances,
        )
        judged = len(answers) >= len(parts) - 4
        signs = Signs(
            gap=gap,
            taken_up=1.0 if moved else net_work(equations),
            unseen_turning=unseen_turning(solution.field, chosen.fine, focal) if judged else 0.0,
            jitter_share=jitter_share(equations, layer.weights, layer.unbalanced, rounding),
        )
        step = Step(
            iteration=0,
            seconds=time.perf_counter() - begin,
            energy=energies.potential(share),
            unknowns=solution.parameters,
            at=spec.t,
            gap=gap,
            quantities=displacement_values(solution),
        )
        diagnostics = {
            "energy_gap": gap,
            "certified_energy": energies.potential(share),
            "jitter": jitter,
            "fixed_weights": network.parameters,
            "neurons": network.width if part is parts[-1] else chosen.neurons,
            "quadrature_points": len(rule.points),
            "fine_quadrature_points": len(fine.points),
            "jitter_share": signs.jitter_share,
        }
        if spec.activation in KINKED:
            diagnostics["unseen_turning"] = signs.unseen_turning
        if springs:
            diagnostics |= {"spring_energy": energies.spring_energy(share), "penalty": weight}
        answers.append(
            Candidate(
                solution=replace(solution, diagnostics=diagnostics),
                potential=energies.potential(share),
                stored=membrane + bending + energies.spring_energy(share) + rounding,
                signs=signs,
                step=step,
            )
        )

    def reached() -> dict[str, float]:
        joined = [np.concatenate([np.arange(chosen.neurons), plain, powers, group]) for group in level.groups()]
        weights = [solve_part(ansatz, features, equations, part).weights for part in joined]
        return {k.name: potential_energy(equations, w) for k, w in zip(level.kinds, weights, strict=True)}

    *narrower, alone, stiffest, stiffer, usual = answers
    return SolvedLevel(level, tuple(narrower), alone, (stiffest, stiffer, usual), reached)
