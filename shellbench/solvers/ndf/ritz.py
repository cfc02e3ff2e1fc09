"""The recipe `ndf-ritz`: fixed random sine features whose output layer is solved for. It trains nothing.

The strain energy of a linear shell is quadratic in the output weights, so they follow from one symmetric positive
definite system, as in Ritz's method; the hidden layer keeps the weights that the seed drew (random features, Rahimi &
Recht 2007). Widths, scales and quadrature follow from the case: whether it is flat, and whether it
carries forces at points. Where only loads act, the answer is the multiple of the found field that is best on the finer
quadrature, so that what the training quadrature misjudges does not scale it.

What makes a solved field no answer is told from the field itself, first of all whether it turns where its energy does
not look. Bending energy is integrated from second derivatives at points. A field with kinks turns at lines that no
point lies on, and those turns would cost infinite energy, not none. Between the ends of a panel the slope changes by
the integral of the second derivative: where it changes by more, the energy has missed it.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from shellbench.errors import InputError, SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.measure import measure
from shellbench.problems.shell.quantities import DisplacementQuantity
from shellbench.solvers.ndf import large_displacement, motion
from shellbench.solvers.ndf.build import (
    FieldSpec,
    Resolution,
    build_ansatz,
    build_features,
    build_inputs,
    graded_points,
    resolution,
    rung,
    rung_count,
)
from shellbench.solvers.ndf.choices import StrainName
from shellbench.solvers.ndf.energy import (
    NormalEquations,
    certify,
    concentrated,
    energy_gap,
    exploits,
    normal_equations,
    rigid_part,
    surface_area,
)
from shellbench.solvers.ndf.equilibrium import UNSTRAINED
from shellbench.solvers.ndf.field import Field, random_features
from shellbench.solvers.ndf.jets import D1, D2, D11, D22, KINKED, Array, Placement, activation, smooth_activation
from shellbench.solvers.ndf.large_displacement import Rung
from shellbench.solvers.ndf.motion_solution import MotionSolution
from shellbench.solvers.ndf.quadrature import RuleSpec, area_rule, line_rule, panel_ends
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.sampled import scales
from shellbench.solvers.ndf.soft import Springs, support_error
from shellbench.solvers.ndf.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.solve import JITTER, potential_energy, solve_nested
from shellbench.solvers.ndf.supports import check_balance, point_supports

CANCELLED = 1e-12  # share of the loads' work that is left on the feature that takes up most; rounding leaves 1e-15
LARGEST_UNSEEN = 1e-2  # of the changes of slope: smooth fields show 1e-6 and less, rectified ones 0.3 and more
LARGEST_ADDED = 1e-3  # of the energy: default fields show 1e-5 and less; beyond this the answer is visibly the jitter's


@dataclass(frozen=True)
class Signs:
    """Figures that tell whether a field is an answer.

    Attributes
    ----------
    gap
        Quadrature gap.
    taken_up
        Largest work of the loads on a feature, as a share of what it would be if no part of it cancelled.
    unseen_turning
        Share of the changes of slope that the second derivatives do not account for.
    jitter_share
        Work that what was added to the diagonal leaves unbalanced, as a share of the energy.
    """

    gap: float
    taken_up: float
    unseen_turning: float
    jitter_share: float


def taken_up(equations: NormalEquations) -> float:
    """Return the largest work of the loads on a feature, as a share of what it would be if no part cancelled."""
    return float(equations.load.abs().max()) / equations.uncancelled if equations.uncancelled > 0 else 1.0


def jitter_share(equations: NormalEquations, weights: Tensor, unbalanced: float, rounding: float) -> float:
    """Return what a jitter on the diagonal has left unbalanced, J, as a share of the energy of output weights (3 M,).

    `rounding` is an energy, J, below which there is nothing to take a share of.
    """
    stored = 0.5 * float(weights @ (equations.stiffness @ weights))
    return unbalanced / (max(stored, 0.0) + abs(equations.constant) + rounding)


def rounding_energy(stiffness: float, area: float) -> float:
    """Return an energy, J, that is rounding, from the membrane stiffness, N/m, and the area, m^2."""
    return UNSTRAINED * stiffness * area


def refusal(signs: Signs, spec: FieldSpec, largest_gap: float) -> str | None:
    """Return why a field is no answer, in one sentence, or None if nothing speaks against it."""
    # In the order of causes: the sentence names what to mend first. Each comparison is written so that a figure which
    # is not a number refuses.
    if not signs.taken_up >= CANCELLED:
        even = " (with a cosine alone, every field is even about the seam)" if spec.periodic_input == "cosine" else ""
        return f"no field of this kind takes up the loads: their work cancels on every feature{even}"
    if not signs.unseen_turning <= LARGEST_UNSEEN:
        kinked = spec.activation in KINKED
        cause = f", as the second derivatives of activation '{spec.activation}' vanish" if kinked else ""
        return (
            f"the field folds where its bending energy does not look: {100 * signs.unseen_turning:.2g} % of its changes"
            f" of slope are kinks without curvature{cause}, so it is no equilibrium of the shell"
        )
    soft = spec.supports == "soft"
    if soft and not signs.jitter_share <= LARGEST_ADDED:  # before the gap: more panels would not help
        return ill_conditioned(signs.jitter_share, "a smaller penalty")
    if (reason := exploits(signs.gap, largest_gap)) is not None:
        return f"{reason}; use more panels or fewer neurons"
    if not signs.jitter_share <= LARGEST_ADDED:
        return ill_conditioned(signs.jitter_share, "fewer neurons")
    return None


def ill_conditioned(share: float, remedy: str) -> str:
    """Say in one sentence that the equations could not be solved as they are."""
    return (
        f"the equations are too ill-conditioned: what keeps them definite takes {100 * share:.2g} % of the energy;"
        f" use {remedy}"
    )


LINES = (0.17, 0.38, 0.61, 0.84)  # shares of the other coordinate at which lines run, off all symmetry


def unseen_turning(field: Field, spec: RuleSpec, focal: Array) -> float:
    """Return the share of a field's changes of slope that its second derivatives do not account for, 0 to 1.

    Along coordinate lines, panel by panel of the rule `spec`: the sum of |slope(b) - slope(a) - integral of u,dd| over
    the sum of |slope(b) - slope(a)| + integral of |u,dd|, or over the slopes where these are larger.
    """
    # By the fundamental theorem slope(b) - slope(a) is the integral of u,dd over a panel, unless the slope jumps
    # within.
    # 1. Lines along both coordinates, off all symmetry, with the panels of the rule that was solved on.
    # 2. Slopes at the ends of panels, second derivatives at its Gauss points.
    # 3. The mismatch of both, summed over panels and lines, as a share of all turning.
    # A finer rule, the usual check, sees no kink either, as none of its points lies on one.
    domain = field.ansatz.case.surface.domain
    unseen, total = 0.0, 0.0
    for axis, first, second in ((0, D1, D11), (1, D2, D22)):
        lower, upper, size = domain.lower[axis], domain.upper[axis], domain.size[axis]
        ends = panel_ends(lower, upper, [float(f) for f in focal[:, axis]], spec, axis, domain.periodic[axis])
        inner, weights = line_rule(ends, spec.order)
        for share in LINES:
            across = domain.lower[1 - axis] + share * domain.size[1 - axis]
            points = np.full((len(ends) + len(inner), 2), across)
            points[:, axis] = np.concatenate([ends, inner])
            jet = field.jet(points).cpu().numpy() * size
            slope, bend = jet[first, : len(ends)], jet[second, len(ends) :] * weights[:, None]
            change, bend = np.diff(slope, axis=0), bend.reshape(len(ends) - 1, spec.order, 3)
            unseen += float(np.linalg.norm(change - bend.sum(1), axis=-1).sum())
            turned = np.linalg.norm(change, axis=-1).sum() + np.linalg.norm(bend, axis=-1).sum()
            # A field that hardly turns would make a share of nothing. Then its slopes are what a mismatch is compared
            # with.
            total += float(max(turned, np.linalg.norm(slope, axis=-1).max()))
    return unseen / total if total > 0 else 0.0


PENALTY = 1e4  # supports give by 1e-5 of the deflection and less, and rounding takes less than 1e-3 of the energy
NESTED = (0.25, 0.5, 1.0)  # shares of the width whose nested fields make the convergence curve


def solve(
    case: Case, settings: RitzSettings, progress: ProgressCallback
) -> NdfSolution | PathSolution | MotionSolution:
    """Solve a case; see `shellbench.solvers.ndf.ritz_solver.RitzSolver`."""
    spec = field_spec(case, settings)
    with torch.no_grad():
        if case.dynamics is not None:
            return _move(case, spec, settings, progress)
        if large_displacement.is_path(case):
            return _follow(case, spec, settings, progress)
        return _solve(case, spec, settings, progress)


def field_spec(case: Case, settings: RitzSettings) -> FieldSpec:
    """Return the choices of the field; InputError if settings do not fit each other or the case."""
    if settings.penalty and settings.supports == "hard":
        raise InputError("setting penalty belongs to supports = \"soft\"; here they are 'hard'")
    path = case.dynamics is not None or large_displacement.is_path(case)
    (smooth_activation if path else activation)(settings.activation)
    return FieldSpec(
        activation=settings.activation,
        periodic_input=settings.periodic_input,
        components=settings.components,
        supports=settings.supports,
        stretched=settings.stretched,
        layer=settings.layer,
        edge_stretched=settings.stretched,
        multipliers=settings.singular,
        strain=strain_of(case, settings.strain),
    )


def strain_of(case: Case, strain: StrainName | None) -> StrainName:
    """Return the strain measure of a case.

    Raises
    ------
    InputError
        If another one than the linear is asked for in the linear theory.
    """
    if case.linear and strain not in (None, "linear"):
        raise InputError(f"case '{case.name}' is of the linear theory: setting strain = \"{strain}\" does not fit it")
    return strain or ("linear" if case.linear else "exact")


def _follow(case: Case, spec: FieldSpec, settings: RitzSettings, progress: ProgressCallback) -> PathSolution:
    """Follow the path of a case with one rung, if a setting fixes its width, or several."""
    placement, focal, inputs = Placement.on(settings.device), graded_points(case, spec), build_inputs(case, spec)

    def build(number: int) -> Rung:
        chosen = _resolution(rung(case, number), settings)
        scales = placement.tensor(chosen.scales(inputs))
        network = random_features(scales, chosen.neurons, settings.seed, settings.activation)
        features = build_features(case, spec, network, placement, inputs)
        return Rung(features, chosen.rule, chosen.fine, focal)

    last = rung_count(case) - 1
    numbers = range(last + 1) if settings.neurons is None else [last]
    builds = [partial(build, number) for number in numbers]
    return large_displacement.solve(case, spec, RitzSolver.name, builds, settings.largest_gap, progress)


def _move(case: Case, spec: FieldSpec, settings: RitzSettings, progress: ProgressCallback) -> MotionSolution:
    """Follow a motion with one rung, if a setting fixes its width, or several."""
    spec = spec.model_copy(update={"stretched": False, "edge_stretched": False, "multipliers": 0})
    placement, inputs = Placement.on(settings.device), build_inputs(case, spec)

    def build(degree: int, width: int) -> motion.Rung:
        spread = placement.tensor(scales(case, inputs, degree))
        network = random_features(spread, width, settings.seed, settings.activation)
        return motion.Rung(degree, build_features(case, spec, network, placement, inputs))

    rungs = motion.rungs_of(case, None if settings.neurons is None else (settings.neurons,))
    builds = [partial(build, degree, width) for degree, width in rungs]
    return motion.solve(case, spec, RitzSolver.name, builds, settings.largest_gap, progress)


def _solve(case: Case, spec: FieldSpec, settings: RitzSettings, progress: ProgressCallback) -> NdfSolution:
    begin = time.perf_counter()
    placement, focal = Placement.on(settings.device), graded_points(case, spec)
    chosen = _resolution(resolution(case), settings)
    ansatz, inputs = build_ansatz(case, spec), build_inputs(case, spec)
    scales = placement.tensor(chosen.scales(inputs))
    network = random_features(scales, chosen.neurons, settings.seed, settings.activation)
    features = build_features(case, spec, network, placement, inputs)

    progress(Progress(0, 3, f"integrating the energy of {chosen.neurons} neurons"))
    rule = area_rule(case.surface.domain, focal, chosen.rule)
    check_balance(case, rule, chosen.rule, focal)
    equations = normal_equations(ansatz, features, rule, concentrated(ansatz, chosen.rule, focal, placement))
    weight = settings.penalty or PENALTY
    springs = Springs.from_spec(ansatz, chosen.fine, focal, weight) if ansatz.soft else None
    if springs:
        equations = Springs.from_spec(ansatz, chosen.rule, focal, weight).join(equations, ansatz, features)
    progress(Progress(1, 3, "solving for the output layer"))
    widths = sorted({math.ceil(share * chosen.neurons) for share in NESTED})
    layers = [solve_nested(ansatz, features, equations, width) for width in widths]
    progress(Progress(2, 3, "certifying the energy on the finer quadrature"))
    outputs = [layer.weights.view(3, -1) for layer in layers]
    fine = area_rule(case.surface.domain, focal, chosen.fine)
    certified = certify(ansatz, features, outputs, fine, concentrated(ansatz, chosen.fine, focal, placement))
    moved = ansatz.lift.moves or any(support.value for support in point_supports(case, spec.t))
    if springs:
        certified = [springs.certify(c, ansatz, features, o) for c, o in zip(certified, outputs, strict=True)]
        moved = springs.moved
    history: list[Step] = []
    for width, layer, output, energies in zip(widths, layers, outputs, certified, strict=True):
        potential = potential_energy(equations, layer.weights)
        gap = energy_gap(potential, energies, moved)
        share = 1.0 if moved else energies.best
        membrane, bending, _ = energies.parts(share)
        field = Field(ansatz, features, share * output, output.new_zeros(6))
        solution = NdfSolution(
            case=case,
            solver=RitzSolver.name,
            spec=spec,
            field=field.less_rigid(rigid_part(field, rule)),
            rule=chosen.fine,
            membrane=membrane,
            bending=bending,
            parameters=output.numel(),
            point_forces=springs.point_forces(field) if springs else tuple((share * layer.reactions).tolist()),
        )
        step = Step(
            iteration=len(history),
            seconds=time.perf_counter() - begin,
            energy=potential,
            unknowns=3 * (width + features.fixed.count),
            at=spec.t,
            gap=gap,
            quantities=displacement_values(solution),
        )
        history.append(step)
    rounding = rounding_energy(case.material.membrane_stiffness, surface_area(ansatz, rule))
    signs = Signs(
        gap=gap,
        taken_up=1.0 if moved else taken_up(equations),
        unseen_turning=unseen_turning(solution.field, chosen.fine, focal),
        jitter_share=jitter_share(equations, layer.weights, layer.unbalanced, rounding),
    )
    diagnostics = {
        "energy_gap": gap,
        "certified_energy": energies.potential(share),
        "jitter": JITTER,
        "fixed_weights": network.parameters,
        "neurons": chosen.neurons,
        "quadrature_points": len(rule.points),
        "fine_quadrature_points": len(fine.points),
        "support_error": support_error(solution.field),
        "unseen_turning": signs.unseen_turning,
        "jitter_share": signs.jitter_share,
    }
    if springs:
        diagnostics |= {"spring_energy": energies.spring_energy(share), "penalty": weight}
    solution = replace(solution, history=tuple(history), diagnostics=diagnostics)
    if reason := refusal(signs, spec, settings.largest_gap):
        raise SolveFailure(reason, solution)
    return solution


def _resolution(usual: Resolution, settings: RitzSettings) -> Resolution:
    rule = replace(usual.rule, panels=settings.panels or usual.rule.panels, order=settings.order or usual.rule.order)
    return replace(
        usual,
        neurons=settings.neurons or usual.neurons,
        scale=settings.scale or usual.scale,
        stretched_scale=settings.stretched_scale or usual.stretched_scale,
        rule=rule,
    )


def displacement_values(solution: NdfSolution) -> dict[str, float]:
    """Return the displacement quantities of a solution's case, by name."""
    quantities = [q for q in solution.case.quantities if isinstance(q, DisplacementQuantity)]
    return {q.name: measure(solution, q) for q in quantities}
