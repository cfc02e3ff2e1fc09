"""Contact of a Ritz field with obstacles: the least energy among fields that enter no obstacle at the gap's points.

Forces at points are the multipliers (see `contact_forces`). Smooth fields can't resolve single forces, so that many
sets of forces give the same displacement: the smoothest is taken. Smooth fields also oscillate at edges of contact,
where the shear force jumps. Therefore edges of contact along coordinate lines are searched in the gap, and the field
gets features with the same jump (see `lines`). Two answers give the uncertainty of the second one. A single answer is
that of linear statics here, or that of a path (see `contact_at_finite_strain`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.quantities.measure import measure_all
from shellbench.problems.shell.quantities.quantities import ContactPoint, LargestPenetration
from shellbench.problems.shell.question.contact import Touch, gaps
from shellbench.solvers.ndf.field.ansatz import Ansatz
from shellbench.solvers.ndf.field.build import (
    Resolution,
    build_ansatz,
    build_features,
    build_inputs,
    graded_points,
    usual_resolution,
)
from shellbench.solvers.ndf.field.choices import Crease, FieldSpec
from shellbench.solvers.ndf.field.field import Features, Field
from shellbench.solvers.ndf.field.geometry import side_lengths
from shellbench.solvers.ndf.field.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.field.network import random_features
from shellbench.solvers.ndf.field.quadrature import ROUNDING, RuleSpec, area_rule
from shellbench.solvers.ndf.linear.contact_forces import (
    GUARD,
    ROWS_ACROSS,
    SLIGHT,
    contact_points,
    crease_mask,
    least_forces,
    smoothest_forces,
    typical_compliance,
)
from shellbench.solvers.ndf.linear.refinement import (
    SETTLED,
    ErrorBounds,
    finer_rule,
    first_level,
    is_slender,
    probe,
    quantity_changes,
    scale,
    slender_rule,
    uncertainties,
    why_unsettled,
)
from shellbench.solvers.ndf.linear.regularised import JITTER
from shellbench.solvers.ndf.linear.ritz_field import with_settings
from shellbench.solvers.ndf.linear.ritz_settings import NDF_RITZ, RitzSettings
from shellbench.solvers.ndf.linear.signs import Signs, jitter_share, refusal, rounding_energy, unseen_turning
from shellbench.solvers.ndf.linear.solution import NdfSolution, PathSolution
from shellbench.solvers.ndf.linear.solve import HeldInverse, OutputLayer, full_layer, held_part, potential_energy
from shellbench.solvers.ndf.strains.energy import certify, concentrated, energy_gap, normal_equations

# The cases of the tuning are not on record, except where a line states them.
STRAIGHT_EDGE = 0.02  # of a side: spread of an edge of contact along its line
LOOKED, ROWS = 501, 9  # points of a line on which an edge of contact is searched, and number of lines
NEAREST, FARTHEST, ROOT_DEGREE = 1e-2, 0.5, 3  # fitted shares of the largest gap, and degree
FARTHEST_TURNED = 0.1  # the same at finite strain: fits that reach farther disagree with each other by degree
SETTLED_EDGE = SETTLED  # of a side: an edge of contact that changes by less is found
ROUNDS = 5  # of the search for edges of contact
PLANE_STEPS = 8  # steps in which the planes that touch an obstacle are found
SECOND_WIDTH = 1.4  # times the neurons, and times the points and panels by its root: the answer after the first
ALONG_SLENDER = (1.5, 0.3)  # of the scale along and across a slender shell, which bends along its length
SETTLED_POINT = 1e-2  # of the position of an edge of contact: required by gates


@dataclass(frozen=True)
class Touching:
    """A field that touches obstacles, with its forces and its resolution.

    Attributes
    ----------
    solution
        The field, or those of a path.
    potential
        Potential energy of the last field on its fine rule, J.
    signs
        Signs that decide if it is an answer.
    """

    solution: NdfSolution | PathSolution
    potential: float
    signs: Signs

    @property
    def last(self) -> NdfSolution:
        """The field at the path's end."""
        return self.solution.states[-1] if isinstance(self.solution, PathSolution) else self.solution


ContactSolve = Callable[
    [Case, FieldSpec, RitzSettings, Resolution, int, float],
    Touching,
]
"""Answers on a resolution, with a seed, and with so many times the usual contact points a side."""


def solve(
    case: Case,
    spec: FieldSpec,
    settings: RitzSettings,
    progress: ProgressCallback,
    answer: ContactSolve | None = None,
    settled: float = SETTLED,
) -> NdfSolution | PathSolution:
    """Solve twice, on two resolutions with other features; the second is the answer, and their difference its error.

    `answer` defaults to that of linear statics. Quantities count as settled if their uncertainty is at most `settled`
    of their scales.

    Raises
    ------
    SolveFailure
        If a field is no answer (see `shellbench.solvers.ndf.linear.signs`), or the forces of obstacles are not found.
    """
    # 1. Choose two resolutions, the second one wider and on finer rules.
    # 2. Solve on each; the edges of contact found first are the creases of the second.
    # 3. State the second answer with their difference as its uncertainty, and refuse it if its signs are bad.
    begin = time.perf_counter()
    fixed = settings.neurons is not None, settings.panels is not None
    # Paths have no features of edge layers: those of linear theory are too fine for Newton's method.
    chosen = first_level(
        case, with_settings(usual_resolution(case), settings), fixed[0], fixed[1] or not case.linear
    ).resolution
    if case.linear:
        spec = spec.model_copy(update={"detail": 1})
    else:
        rules = [spec if fixed[1] else slender_rule(case, spec) for spec in (chosen.rule, chosen.fine)]
        chosen = replace(chosen, edge_scale=0.0, rule=rules[0], fine=rules[1])
    if is_slender(case):
        longer = int(np.argmax(side_lengths(case)))
        chosen = replace(chosen, along=(ALONG_SLENDER[longer], ALONG_SLENDER[1 - longer]))
    root = SECOND_WIDTH**0.5
    wider = chosen.neurons if fixed[0] else round(SECOND_WIDTH * chosen.neurons)
    fine = replace(chosen, neurons=wider, rule=finer_rule(chosen.rule, root), fine=finer_rule(chosen.fine, root))
    answers: list[Touching] = []
    creases: tuple[Crease, ...] = ()
    steps = []
    for number, resolution in enumerate((chosen, fine)):
        progress(Progress(number, None, f"looking for contact with {resolution.neurons} neurons"))
        given = settings.seed + number * 2**20
        last, creases = _fit_creases(case, spec, settings, resolution, creases, given, root**number, answer or _at_rest)
        steps.append(
            Step(
                iteration=number,
                seconds=time.perf_counter() - begin,
                energy=last.potential,
                unknowns=last.solution.parameters,
                at=spec.t,
                gap=last.signs.gap,
            )
        )
        answers.append(last)
    solution = _as_answer(answers[0], answers[1], tuple(steps), settled)
    if (reason := refusal(answers[1].signs, spec, settings.largest_gap)) is not None:
        raise SolveFailure(reason, solution)
    return solution


def _as_answer(before: Touching, last: Touching, steps: tuple[Step, ...], settled: float) -> NdfSolution | PathSolution:
    """Return the last answer with its uncertainty and diagnostics."""
    solution, case = last.solution, last.solution.case
    try:
        first, second = (dict(measure_all(one.solution)) for one in (before, last))
    except ValueError as error:
        raise SolveFailure(str(error), solution) from None
    rounding = rounding_energy(case.material.membrane_stiffness, 1.0)
    largest = float(np.linalg.norm(probe(solution), axis=-1).max())
    scales = {q.name: scale(solution, q, second[q.name], rounding) for q in case.quantities}
    changed = quantity_changes(case, first, second, (probe(before.solution), probe(solution)))
    for q in case.quantities:
        if isinstance(q, LargestPenetration):  # it is an error itself, compared with the shell's displacement
            scales[q.name] = largest
            changed[q.name] = max(changed[q.name], second[q.name])
    # A value of two answers may agree by chance: no uncertainty is below that of the strain energy, except that of a
    # depth, which is small by itself. Edges of contact are searched until they move by at most `SETTLED_EDGE`.
    before_energy, energy = (sum(one.solution.energies()) for one in (before, last))
    gap = last.signs.gap + last.signs.jitter_share
    depths = {q.name for q in case.quantities if isinstance(q, LargestPenetration)}
    edges = {q.name: int(q.along == "xi2") for q in case.quantities if isinstance(q, ContactPoint)}
    sides = side_lengths(case)
    for name, axis in edges.items():
        changed[name] = max(changed[name], SETTLED_EDGE * sides[axis])
    stated = uncertainties(ErrorBounds(changed, abs(energy - before_energy) / (energy + rounding)), gap, second, scales)
    stated |= {n: u for n, u in uncertainties(ErrorBounds(changed, 0.0), gap, second, scales).items() if n in depths}
    open_ones = [
        why_unsettled({n: u for n, u in stated.items() if (n in edges) == edge}, scales, limit)
        for edge, limit in ((False, settled), (True, max(settled, SETTLED_POINT)))
    ]
    own = (replace(step, iteration=len(steps) + step.iteration) for step in solution.history)
    words = next((words for words in open_ones if words), None)
    return replace(solution, history=(*steps, *own), uncertainty=stated, unsettled=words)


def _fit_creases(
    case: Case,
    spec: FieldSpec,
    settings: RitzSettings,
    resolution: Resolution,
    creases: tuple[Crease, ...],
    seed: int,
    finer: float,
    answer: ContactSolve,
) -> tuple[Touching, tuple[Crease, ...]]:
    """Return the answer on a resolution whose edges of contact coincide with the jumps of its features."""
    size = case.surface.domain.size
    for _ in range(ROUNDS):
        touching = answer(case, spec.model_copy(update={"creases": creases}), settings, resolution, seed, finer)
        found = edges_of_contact(touching.last)
        same = [(axis, side) for axis, _, side in found] == [(axis, side) for axis, _, side in creases]
        if same and all(abs(a[1] - b[1]) <= SETTLED_EDGE * size[a[0]] for a, b in zip(found, creases, strict=True)):
            break
        creases = found
    return touching, creases


def _solve_touch(
    ansatz: Ansatz, features: Features, kept: Tensor, held: HeldInverse, touch: Touch, creases: tuple[Crease, ...]
) -> tuple[OutputLayer, Touch]:
    """Return the weights of the kept pairs, with the contact forces at the points of `touch`."""
    # 1. Compute the gap g and its direction n at the present displacement: curved obstacles are planes for this step.
    # 2. Compute rows G = n . u of the weights, their response A^-1 G^T, and the compliance G A^-1 G^T of the points.
    # 3. Solve the dual problem for forces: gaps by the loads alone, g + G w, plus those by the forces.
    # 4. Take the smoothest forces with the same response. They act where gaps are closed.
    # 5. Repeat at the new displacement until it settles. Start from rest, so that no shell passes through an obstacle.
    case, placement = ansatz.case, features.placement
    values = features.values(touch.points)
    matrix = ansatz.factors.matrix(touch.points, placement)[VALUE]
    lift = ansatz.lift.jet(touch.points, placement)[VALUE]
    line = crease_mask(case, touch, creases)
    free, nothing = held.layer(), held.targets.new_zeros((len(held.targets), len(touch.points)))

    def moved(weights: Tensor) -> Array:
        every = weights.new_zeros(3 * features.count)
        every[kept] = weights
        u = (matrix @ (values @ every.view(3, -1).T)[..., None])[..., 0] + lift
        return np.asarray(u.cpu().numpy())

    u = np.zeros((len(touch.points), 3))
    for _ in range(PLANE_STEPS):
        gap, normal = gaps(case, touch.points, u, ansatz.t)
        along = (matrix.mT @ placement.tensor(normal)[..., None])[..., 0]
        rows = (along[:, :, None] * values[:, None, :]).reshape(len(touch.points), -1)[:, kept]
        response, _ = held.solve(rows.T, nothing)
        compliance = (rows @ response).cpu().numpy()
        compliance = (compliance + compliance.T) / 2
        offset = gap + np.sum(normal * (moved(free.weights) - u), axis=1)
        unit = typical_compliance(compliance, touch)
        forces = least_forces(compliance, offset, SLIGHT * unit)
        largest = float(np.abs(moved(free.weights + response @ placement.tensor(forces))).max())
        smooth = smoothest_forces(compliance, offset, forces, unit, line, largest)
        last, u = u, moved(free.weights + response @ placement.tensor(smooth))
        if np.abs(u - last).max() <= ROUNDING * np.abs(u).max():
            break
    layer = held.layer(rows.T @ placement.tensor(smooth))
    return layer, replace(touch, forces=smooth[:, None] * normal)


def edges_of_contact(solution: NdfSolution) -> tuple[Crease, ...]:
    """Return the coordinate lines along which contact begins, as far as the gap shows them.

    The gap opens with the cube of the distance, so that its cube root goes to zero linearly.
    """
    # From each end of a coordinate, on several lines: take the gap where it is neither rounding nor far from contact,
    # fit a polynomial to its cube root, and find the polynomial's root. Edges that are no coordinate lines are left
    # out.
    case, domain = solution.case, solution.case.surface.domain
    shares, found = np.linspace(0, 1, LOOKED), []
    for axis in (0, 1):
        if domain.periodic[axis]:
            continue
        for side in (-1, 1):
            at = []
            along = domain.lower[axis] + domain.size[axis] * (shares if side < 0 else 1 - shares)
            for share in np.arange(1, ROWS + 1) / (ROWS + 1):
                points = np.full((LOOKED, 2), domain.lower[1 - axis] + share * domain.size[1 - axis])
                points[:, axis] = along
                gap, _ = gaps(case, points, solution.displacement(points), solution.spec.t)
                edge = _root_of_gap(along, gap, FARTHEST if case.linear else FARTHEST_TURNED)
                if edge is not None:
                    at.append(edge)
            if len(at) == ROWS and float(np.ptp(at)) <= STRAIGHT_EDGE * domain.size[axis]:
                found.append((axis, float(np.median(at)), side))
    apart = (GUARD + 1) / ROWS_ACROSS * np.asarray(domain.size)  # rows of their own need room
    ends = [[domain.lower[axis], domain.upper[axis]] for axis in (0, 1)]
    return tuple(
        crease
        for crease in found
        if domain.lower[crease[0]] < crease[1] < domain.upper[crease[0]]
        and all(
            abs(crease[1] - at) > apart[crease[0]]
            for at in (*ends[crease[0]], *(other[1] for other in found if other != crease and other[0] == crease[0]))
        )
    )


def _root_of_gap(along: Array, gap: Array, farthest: float = FARTHEST) -> float | None:
    largest = gap.max()
    closed = np.flatnonzero(gap < NEAREST**2 * largest)
    if not len(closed):
        return None
    peak = int(np.argmax(gap[: closed[0]])) if closed[0] else 0
    x, g = along[peak : closed[0]], gap[peak : closed[0]]
    fitted = (g > NEAREST * largest) & (g < farthest * largest)
    if fitted.sum() < 4 * ROOT_DEGREE:
        return None
    x, g = x[fitted], g[fitted]
    roots = np.polynomial.Polynomial.fit(x, np.cbrt(g), ROOT_DEGREE).roots()
    roots = roots[np.abs(roots.imag) <= ROUNDING * np.ptp(x)].real
    roots = roots[(roots - x[-1]) * (x[-1] - x[0]) >= 0]
    return float(roots[np.argmin(np.abs(roots - x[-1]))]) if len(roots) else None


def draw_field(
    case: Case, spec: FieldSpec, settings: RitzSettings, resolution: Resolution, seed: int
) -> tuple[Ansatz, Features, tuple[RuleSpec, RuleSpec], Array]:
    """Return a field's supports and features, the rules to train and to certify it, and the points of their grading."""
    placement, focal = Placement.on(settings.device), graded_points(case, spec)
    joints = tuple(
        tuple(sorted({*own, *(at for a, at, _ in spec.creases if a == axis)})) for axis, own in enumerate(case.kinks)
    )
    rule, fine = (replace(one, joints=(joints[0], joints[1])) for one in (resolution.rule, resolution.fine))
    inputs = build_inputs(case, spec)
    network = random_features(
        placement.tensor(resolution.scales(inputs)), resolution.neurons, seed, settings.activation
    )
    return build_ansatz(case, spec), build_features(case, spec, network, placement, inputs), (rule, fine), focal


def _at_rest(
    case: Case, spec: FieldSpec, settings: RitzSettings, resolution: Resolution, seed: int, finer: float
) -> Touching:
    # 1. Draw features, integrate the normal equations, and factorise them with the supports held.
    # 2. Find the contact forces and the output layer (`_solve_touch`).
    # 3. Certify the energy on the finer rule, and collect the signs.
    ansatz, features, (rule_spec, fine_spec), focal = draw_field(case, spec, settings, resolution, seed)
    placement = features.placement
    rule, fine = (area_rule(case.surface.domain, focal, one) for one in (rule_spec, fine_spec))
    equations = normal_equations(ansatz, features, rule, concentrated(ansatz, rule_spec, focal, placement))
    kept, held = held_part(ansatz, features, equations, np.arange(features.count))
    pressed, touch = _solve_touch(ansatz, features, kept, held, contact_points(case, spec.creases, finer), spec.creases)
    layer = full_layer(ansatz, features, kept, pressed)
    output = layer.weights.view(3, -1)
    certified = certify(ansatz, features, [output], fine, concentrated(ansatz, fine_spec, focal, placement))[0]
    membrane, bending, _ = certified.parts()
    potential = potential_energy(equations, layer.weights)
    rounding = rounding_energy(case.material.membrane_stiffness, 1.0)
    field = Field(ansatz, features, output, output.new_zeros(6))
    signs = Signs(
        gap=energy_gap(potential, certified, True, rounding),
        taken_up=1.0,
        unseen_turning=unseen_turning(field, fine_spec, focal),
        jitter_share=jitter_share(equations, layer.weights, layer.unbalanced, rounding),
    )
    solution = NdfSolution(
        case=case,
        solver=NDF_RITZ,
        spec=spec,
        field=field,
        rule=fine_spec,
        membrane=membrane,
        bending=bending,
        parameters=len(features.pairs(np.arange(features.count))),
        point_forces=tuple(layer.reactions.tolist()),
        touching=touch,
        diagnostics={
            "energy_gap": signs.gap,
            "certified_energy": certified.potential(),
            "jitter": JITTER,
            "neurons": resolution.neurons,
            "contact_points": len(touch.points),
            "pressed_points": int(np.count_nonzero(np.any(touch.forces != 0, axis=1))),
        },
    )
    return Touching(solution, certified.potential(), signs)
