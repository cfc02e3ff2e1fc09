"""Contact of a linear Ritz field with obstacles: the least energy among fields that enter none at the points asked.

Forces at points are the multipliers. They are found from the dual problem, least squares with unknowns that are not
negative (Lawson & Hanson 1974, chapter 23). Smooth fields can't tell many forces apart, so a great many of them give
the same displacement: the smoothest are taken. And smooth fields ring where contact begins, as the shear force jumps
there. So edges of contact along coordinate lines are looked for in the gap, and the field is given features that jump
as well (see `creases`).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.optimize import nnls
from torch import Tensor

from shellbench.errors import SolveFailure
from shellbench.problem import Progress, ProgressCallback, Step
from shellbench.problems.shell.case import Case
from shellbench.problems.shell.contact import Touch, gaps
from shellbench.problems.shell.measure import measure_all
from shellbench.problems.shell.quantities import ContactPoint, LargestPenetration
from shellbench.solvers.ndf.build import (
    FieldSpec,
    Resolution,
    build_ansatz,
    build_features,
    build_inputs,
    graded_points,
    resolution,
    side_lengths,
)
from shellbench.solvers.ndf.creases import Crease
from shellbench.solvers.ndf.energy import certify, concentrated, energy_gap, normal_equations
from shellbench.solvers.ndf.field import Ansatz, Features, Field, random_features
from shellbench.solvers.ndf.jets import VALUE, Array, Placement
from shellbench.solvers.ndf.quadrature import area_rule
from shellbench.solvers.ndf.refinement import (
    Miss,
    changes,
    finer_rule,
    first_level,
    is_slender,
    probed,
    scale,
    uncertainties,
    unsettled,
)
from shellbench.solvers.ndf.ritz_solver import RitzSettings, RitzSolver
from shellbench.solvers.ndf.signs import Signs, jitter_share, refusal, rounding_energy, unseen_turning
from shellbench.solvers.ndf.solution import NdfSolution
from shellbench.solvers.ndf.solve import JITTER, HeldInverse, OutputLayer, held_part, potential_energy, spread
from shellbench.solvers.ndf.static import with_settings

POINTS = 600  # at which gaps are asked, while no edge of contact is known
ALONG, LEAST, MOST = 80, 5, 12  # of them across the edges of contact, and along these
GUARD = 2.0  # spacings outside an edge of contact that its own row stands for
LINE_FORCE = 10.0  # times as much of a force costs nothing more on such a row: a line force is no noise
SLIGHT = 1e-9  # share of the mean compliance by which obstacles give: what makes forces unique at all
SMOOTH = 1e-3  # the same, where forces are made smooth
CLOSED = 3e-4  # of the largest displacement: gaps at which smooth forces may act
STRAIGHT = 0.02  # of a side: spread of an edge of contact along its line
LOOKED, ROWS = 501, 9  # points of a line on which an edge of contact is looked for, and lines
NEAREST, FARTHEST, DEGREE = 1e-2, 0.5, 3  # shares of the largest gap whose cube root is fitted, and how
SETTLED_EDGE = 1e-3  # of a side: change of an edge of contact with which it is found
ROUNDS = 5  # of looking for edges of contact
PLANES = 8  # steps in which the planes that touch an obstacle are found
STILL = 1e-9  # of the largest displacement: change after which these planes stay
FINER = 1.4  # times the neurons, and times the points and panels by its root: the answer after the first
ALONG_SLENDER = (1.5, 0.3)  # of the scale along and across a slender shell, which bends along its length
REACH, FAR_REACH = 2.0, 8.0  # spacings over which forces make a pressure, with edges of contact known or not
SETTLED_POINT = 1e-2  # of where contact begins


def contact_points(case: Case, creases: tuple[Crease, ...], finer: float) -> Touch:
    """Return the points at which the gap is asked, in rows along both coordinates, with no force on them."""
    domain, sides = case.surface.domain, np.asarray(side_lengths(case))
    if creases:
        across = {axis for axis, _, _ in creases}
        alike = ALONG * sides / sides[min(across)]
        counts = [ALONG if axis in across else int(np.clip(alike[axis], LEAST, MOST)) for axis in (0, 1)]
    else:
        counts = [max(4, round(float(np.sqrt(POINTS / sides.prod()) * side))) for side in sides]
    found = []
    for axis in (0, 1):
        # The row of an edge of contact stands for half a spacing inside, and for `GUARD` of them outside, where the gap
        # opens with the cube of the distance.
        h = domain.size[axis] / round(finer * counts[axis])
        lines = sorted((at, side) for other, at, side in creases if other == axis)
        breaks = [domain.lower[axis]]
        for at, side in lines:
            below, above = (0.5, GUARD) if side > 0 else (GUARD, 0.5)
            breaks += [at - below * h, at + above * h]
        breaks.append(domain.upper[axis])
        if np.any(np.diff(breaks) <= 0):
            raise SolveFailure("edges of contact lie closer than the points at which gaps are asked")
        points: list[Array] = []
        lengths: list[Array] = []
        for k, (start, stop) in enumerate(pairwise(breaks)):
            if k % 2:
                points.append(np.array([lines[k // 2][0]]))
                lengths.append(np.array([stop - start]))
                continue
            number = max(1, round((stop - start) / h))
            points.append(start + (stop - start) * (np.arange(number) + 0.5) / number)
            lengths.append(np.full(number, (stop - start) / number))
        found.append((np.concatenate(points), np.concatenate(lengths)))
    grid, sizes = (
        np.stack(np.meshgrid(found[0][k], found[1][k], indexing="ij"), axis=-1).reshape(-1, 2) for k in (0, 1)
    )
    x = case.surface.derivatives(grid, 1)
    speeds = np.stack([np.broadcast_to(np.linalg.norm(x[k], axis=-1), len(grid)) for k in ((1, 0), (0, 1))], axis=-1)
    spacing = np.array([domain.size[axis] / round(finer * counts[axis]) for axis in (0, 1)]) * speeds.max(axis=0)
    return Touch(grid, np.zeros((len(grid), 3)), sizes * speeds, (REACH if creases else FAR_REACH) * spacing)


def least_forces(compliance: Array, gap: Array, give: Array) -> Array:
    """Return forces x (n,) >= 0 with gap + (compliance + give) x >= 0, one of both zero: N from m and m/N.

    Raises
    ------
    SolveFailure
        If there are none that rounding can tell.
    """
    if not np.any(gap < 0):
        return np.zeros(len(gap))  # SciPy's routine takes no empty matrix
    # min x A x / 2 + gap x over x >= 0 with A = R^T R is the distance of R x from -R^-T gap: least squares.
    try:
        root = cholesky(compliance + np.diag(give))
        found, _ = nnls(root, -solve_triangular(root, gap, trans="T"), maxiter=50 * len(gap))
    except (LinAlgError, RuntimeError, ValueError) as error:
        raise SolveFailure(f"the forces of obstacles can't be found ({error})") from None
    return np.asarray(found)


@dataclass(frozen=True)
class Touching:
    """A field that touches obstacles, with its forces, and how it was found.

    Attributes
    ----------
    solution
        The field.
    potential
        On its fine rule, J.
    signs
        Whether it is an answer.
    """

    solution: NdfSolution
    potential: float
    signs: Signs


def solve(case: Case, spec: FieldSpec, settings: RitzSettings, progress: ProgressCallback) -> NdfSolution:
    """Answer twice, on two resolutions with other features; the second is the answer, and their change what it misses.

    Raises
    ------
    SolveFailure
        If a field is no answer (see `shellbench.solvers.ndf.signs`), or the forces of obstacles are not found.
    """
    begin = time.perf_counter()
    spec = spec.model_copy(update={"detail": 1})
    fixed = settings.neurons is not None, settings.panels is not None
    chosen = first_level(case, with_settings(resolution(case), settings), *fixed).resolution
    if is_slender(case):
        longer = int(np.argmax(side_lengths(case)))
        chosen = replace(chosen, along=(ALONG_SLENDER[longer], ALONG_SLENDER[1 - longer]))
    root = FINER**0.5
    wider = chosen.neurons if fixed[0] else round(FINER * chosen.neurons)
    fine = replace(chosen, neurons=wider, rule=finer_rule(chosen.rule, root), fine=finer_rule(chosen.fine, root))
    answers: list[Touching] = []
    creases: tuple[Crease, ...] = ()
    steps = []
    for number, level in enumerate((chosen, fine)):
        progress(Progress(number, None, f"looking for contact with {level.neurons} neurons"))
        given = settings.seed + number * 2**20
        last, creases = _located(case, spec, settings, level, creases, given, root**number)
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
    solution = _stated(answers[0], answers[1], tuple(steps))
    if (reason := refusal(answers[1].signs, solution.spec, settings.largest_gap)) is not None:
        raise SolveFailure(reason, solution)
    return solution


def _stated(before: Touching, last: Touching, steps: tuple[Step, ...]) -> NdfSolution:
    """Return the last answer with what is known of its uncertainty, and of its figures."""
    solution, case = last.solution, last.solution.case
    try:
        first, second = (dict(measure_all(one.solution)) for one in (before, last))
    except ValueError as error:
        raise SolveFailure(str(error), solution) from None
    rounding = rounding_energy(case.material.membrane_stiffness, 1.0)
    largest = float(np.linalg.norm(probed(solution), axis=-1).max())
    scales = {q.name: scale(solution, q, second[q.name], rounding) for q in case.quantities}
    changed = changes(case, first, second, (probed(before.solution), probed(solution)))
    for q in case.quantities:
        if isinstance(q, LargestPenetration):  # it is an error itself, compared with what the shell moves
            scales[q.name] = largest
            changed[q.name] = max(changed[q.name], second[q.name])
    # A figure of two answers may agree by chance: none is taken to be surer than the strain energy, but for a depth,
    # which is small by itself. Edges of contact are looked for until they move by no more than `SETTLED_EDGE`.
    before_energy, energy = (sum(one.solution.energies()) for one in (before, last))
    gap = last.signs.gap + last.signs.jitter_share
    depths = {q.name for q in case.quantities if isinstance(q, LargestPenetration)}
    edges = {q.name: int(q.along == "xi2") for q in case.quantities if isinstance(q, ContactPoint)}
    sides = side_lengths(case)
    for name, axis in edges.items():
        changed[name] = max(changed[name], SETTLED_EDGE * sides[axis])
    stated = uncertainties(Miss(changed, abs(energy - before_energy) / (energy + rounding)), gap, second, scales)
    stated |= {n: u for n, u in uncertainties(Miss(changed, 0.0), gap, second, scales).items() if n in depths}
    open_ones = [
        unsettled({n: u for n, u in stated.items() if (n in edges) == edge}, scales, limit)
        for edge, limit in ((False, 1e-3), (True, SETTLED_POINT))
    ]
    return replace(
        solution, history=steps, uncertainty=stated, unsettled=next((words for words in open_ones if words), None)
    )


def _located(
    case: Case,
    spec: FieldSpec,
    settings: RitzSettings,
    level: Resolution,
    creases: tuple[Crease, ...],
    seed: int,
    finer: float,
) -> tuple[Touching, tuple[Crease, ...]]:
    """Return the answer on a resolution whose edges of contact are where its features jump."""
    size = case.surface.domain.size
    for _ in range(ROUNDS):
        answer = _answer(case, spec.model_copy(update={"creases": creases}), settings, level, seed, finer)
        found = edges_of_contact(answer.solution)
        same = [(axis, side) for axis, _, side in found] == [(axis, side) for axis, _, side in creases]
        if same and all(abs(a[1] - b[1]) <= SETTLED_EDGE * size[a[0]] for a, b in zip(found, creases, strict=True)):
            break
        creases = found
    return answer, creases


def _settled(
    ansatz: Ansatz, features: Features, kept: Tensor, held: HeldInverse, touch: Touch, creases: tuple[Crease, ...]
) -> tuple[OutputLayer, Touch]:
    """Return the weights of the pairs that are kept, with what presses at the points of `touch`."""
    # 1. The gap g and its direction n where the shell is: obstacles that are curved are planes for this step.
    # 2. Rows G = n . u of the weights, their response A^-1 G^T, and the compliance G A^-1 G^T of the points.
    # 3. Forces from the dual problem: gaps of the loads alone, g + G w, and what forces add to them.
    # 4. Of forces with the same response, those of least sum of squares per area. They act where gaps are closed.
    # 5. All over again at the new place, until it stays. From rest on, so that no shell goes through an obstacle.
    # Textbooks take the multipliers of step 3. There are more points than a smooth basis tells apart, so these are a
    # few spikes, whose resultants are right and whose places mean nothing.
    case, placement = ansatz.case, features.placement
    values = features.values(touch.points)
    matrix = ansatz.factors.matrix(touch.points, placement)[VALUE]
    lift = ansatz.lift.jet(touch.points, placement)[VALUE]
    area = touch.lengths.prod(axis=1)
    line = np.zeros(len(area), dtype=bool)
    for axis, at, _ in creases:
        line |= np.abs(touch.points[:, axis] - at) <= 1e-9 * case.surface.domain.size[axis]
    free, nothing = held.layer(), held.targets.new_zeros((len(held.targets), len(area)))

    def moved(weights: Tensor) -> Array:
        every = weights.new_zeros(3 * features.count)
        every[kept] = weights
        u = (matrix @ (values @ every.view(3, -1).T)[..., None])[..., 0] + lift
        return np.asarray(u.cpu().numpy())

    u = np.zeros((len(area), 3))
    for _ in range(PLANES):
        gap, normal = gaps(case, touch.points, u, ansatz.t)
        along = (matrix.mT @ placement.tensor(normal)[..., None])[..., 0]
        rows = (along[:, :, None] * values[:, None, :]).reshape(len(area), -1)[:, kept]
        response, _ = held.solve(rows.T, nothing)
        compliance = (rows @ response).cpu().numpy()
        compliance = (compliance + compliance.T) / 2
        unit = float(np.mean(np.diag(compliance))) * area.mean() / area
        offset = gap + np.sum(normal * (moved(free.weights) - u), axis=1)
        forces = least_forces(compliance, offset, SLIGHT * unit)
        pressed = moved(free.weights + response @ placement.tensor(forces))
        opened = gap + np.sum(normal * (pressed - u), axis=1)
        near = (opened <= CLOSED * np.abs(pressed).max()) | (forces > 0)
        give = (SMOOTH * unit / np.where(line, LINE_FORCE, 1.0))[near]
        smooth = np.zeros(len(area))
        smooth[near] = least_forces(compliance[np.ix_(near, near)], -(compliance @ forces)[near], give)
        last, u = u, moved(free.weights + response @ placement.tensor(smooth))
        if np.abs(u - last).max() <= STILL * np.abs(u).max():
            break
    layer = held.layer(rows.T @ placement.tensor(smooth))
    return layer, replace(touch, forces=smooth[:, None] * normal)


def edges_of_contact(solution: NdfSolution) -> tuple[Crease, ...]:
    """Return the coordinate lines along which contact begins, as far as the gap tells.

    It opens with the cube of the distance, so that its cube root goes to zero as a straight line.
    """
    # From each end of a coordinate, on several lines: the gap where it is neither rounding nor far from contact, its
    # cube root as a polynomial, and the root of that. Edges that are no straight lines of a coordinate are left out.
    case, domain = solution.case, solution.case.surface.domain
    shares, found = np.linspace(0, 1, LOOKED), []
    for axis in (0, 1):
        if domain.periodic[axis]:
            continue
        for side in (-1, 1):
            at = []
            along = domain.lower[axis] + domain.size[axis] * (shares if side < 0 else 1 - shares)
            for share in np.linspace(0.1, 0.9, ROWS):
                points = np.full((LOOKED, 2), domain.lower[1 - axis] + share * domain.size[1 - axis])
                points[:, axis] = along
                gap, _ = gaps(case, points, solution.displacement(points), solution.spec.t)
                edge = _root_of_gap(along, gap)
                if edge is not None:
                    at.append(edge)
            if len(at) == ROWS and float(np.ptp(at)) <= STRAIGHT * domain.size[axis]:
                found.append((axis, float(np.median(at)), side))
    apart = (GUARD + 1) / ALONG * np.asarray(domain.size)  # rows of their own need room
    ends = [[domain.lower[axis], domain.upper[axis]] for axis in (0, 1)]
    return tuple(
        crease
        for crease in found
        if all(
            abs(crease[1] - at) > apart[crease[0]]
            for at in (*ends[crease[0]], *(other[1] for other in found if other != crease and other[0] == crease[0]))
        )
    )


def _root_of_gap(along: Array, gap: Array) -> float | None:
    largest = gap.max()
    closed = np.flatnonzero(gap < NEAREST**2 * largest)
    if not len(closed):
        return None
    peak = int(np.argmax(gap[: closed[0]])) if closed[0] else 0
    x, g = along[peak : closed[0]], gap[peak : closed[0]]
    fitted = (g > NEAREST * largest) & (g < FARTHEST * largest)
    if fitted.sum() < 4 * DEGREE:
        return None
    x, g = x[fitted], g[fitted]
    roots = np.polynomial.Polynomial.fit(x, np.cbrt(g), DEGREE).roots()
    roots = roots[np.abs(roots.imag) <= 1e-9 * np.ptp(x)].real
    roots = roots[(roots - x[-1]) * (x[-1] - x[0]) >= 0]
    return float(roots[np.argmin(np.abs(roots - x[-1]))]) if len(roots) else None


def _answer(
    case: Case, spec: FieldSpec, settings: RitzSettings, level: Resolution, seed: int, finer: float
) -> Touching:
    placement, focal = Placement.on(settings.device), graded_points(case, spec)
    joints = tuple(
        tuple(sorted({*own, *(at for a, at, _ in spec.creases if a == axis)})) for axis, own in enumerate(case.kinks)
    )
    rule_spec, fine_spec = (replace(one, joints=(joints[0], joints[1])) for one in (level.rule, level.fine))
    ansatz, inputs = build_ansatz(case, spec), build_inputs(case, spec)
    network = random_features(placement.tensor(level.scales(inputs)), level.neurons, seed, settings.activation)
    features = build_features(case, spec, network, placement, inputs)
    rule, fine = (area_rule(case.surface.domain, focal, one) for one in (rule_spec, fine_spec))
    equations = normal_equations(ansatz, features, rule, concentrated(ansatz, rule_spec, focal, placement))
    kept, held = held_part(ansatz, features, equations, np.arange(features.count))
    pressed, touch = _settled(ansatz, features, kept, held, contact_points(case, spec.creases, finer), spec.creases)
    layer = spread(ansatz, features, kept, pressed)
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
        solver=RitzSolver.name,
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
            "neurons": level.neurons,
            "contact_points": len(touch.points),
            "pressed_points": int(np.count_nonzero(np.any(touch.forces != 0, axis=1))),
            "unseen_turning": signs.unseen_turning,
        },
    )
    return Touching(solution, certified.potential(), signs)
