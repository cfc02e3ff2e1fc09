"""Training all weights of a field by certified energy.

Three quadratures keep a field from exploiting its points. The energy and its gradient are computed on the training
points. A step counts only if the energy also falls on independent, finer check points, and by about the same amount. A
third, finest rule, which no decision uses, gives the reported certificate (see `trainer`). Width and scale of the
starting features are chosen by the check points' energy, without any known value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from shellbench.errors import SolveFailure
from shellbench.problems.shell.case import Case
from shellbench.solvers.ndf.field.build import is_flat
from shellbench.solvers.ndf.field.jets import VALUE
from shellbench.solvers.ndf.field.network import Network, deep_random_features, deep_random_network
from shellbench.solvers.ndf.training.gauss_newton import Quadratic, energy_gradient, flatten, quadratic_model, unflatten
from shellbench.solvers.ndf.training.sketch import Sketch
from shellbench.solvers.ndf.training.training_problem import COARSE_ORDER, Quadratures, Trained, TrainingProblem

CERTIFICATE = 3.0  # points of the final rule, as a multiple of the training points
# Chosen by certified energy on plates, roofs and cylinders; each shell takes the best of a tuple. The results of other
# pairs are not on record, and neither are the neighbours of the next constants, except where a line states them.
SINGULAR_SCALES = (2.0, 2.0), (2.0, 3.0), (1.0, 4.0)  # about point forces: each start has one of them
WIDEST_SINGULAR = 500  # last hidden layer, about point forces on curved shells
MIXED_SCALES = SINGULAR_SCALES[2], SINGULAR_SCALES[0]  # on curved shells: the features of one start have both
MIRRORED_SCALES = (1.0, 3.0), (0.7, 4.0)  # the same for a field on one of several parts
MANY_WEIGHTS, STEEPEST = 3200, 900  # hidden weights beyond which a step moves only the steepest ones, and their number
COARSE_ROWS = 2.0  # strain rows of the Gauss-Newton matrix a column; 3 has no advantage
AGREEMENT = 0.2  # admissible difference of the gains on the two point sets, as a share of the smaller
REFINE, MOST_REFINED = 1.4, 3.0  # factor of training points if they are exploited, and its limit
# Factors of the damping after a refusal, a fair step, a good one. On plates, roofs and cylinders fours in place of
# sixteens make twice as many attempts, and end with the same certified energy.
HARDEN, EASE, EASE_MORE = 16.0, 3.0, 10.0
FAIR = 0.3
GOOD = 1 - FAIR  # of the predicted decrease
ATTEMPTS = 3  # steps tried in an iteration, with increasing damping
NEGLIGIBLE = 0.02  # share of the tolerance: if the most damped step can't gain more, training ends


@dataclass(frozen=True)
class Plan:
    """Limits of a training; see `TrainerSettings` for the purpose of each setting.

    Attributes
    ----------
    widths
        Of the last hidden layer, tried in turn until the certified energy settles.
    scales
        Standard deviations of the starting features' weights, for plain and for stretched inputs.
    mixed
        Whether the features of one start have all scales in turn, rather than each start one of them.
    gap
        Disagreement of training and check points beyond which more points are taken.
    fitted
        Whether the starting features are fitted, rather than drawn.
    """

    inner: tuple[int, ...]
    widths: tuple[int, ...]
    scales: tuple[tuple[float, float], ...]
    activation: str
    iterations: int
    tolerance: float
    gap: float
    damping: float
    seed: int
    mixed: bool = False
    fitted: bool = True


Report = Callable[[int, Trained], None]


def first_state(problem: TrainingProblem, plan: Plan) -> tuple[Trained, Quadratures]:
    """Return starting features, with width and scale chosen by certified energy, and their points.

    Raises
    ------
    SolveFailure
        If no start agrees on two quadratures.
    """
    # Try widths from narrow to wide, until one gains too little over the one before, or can't gain more: gains shrink
    # like a geometric series.
    # 1. Take points for the width, and more of them as long as no start agrees on both sets.
    # 2. Take the start of most certified gain among all scales.
    # 3. For wider networks, try that scale and larger ones; with forces at points, that scale only.
    best: tuple[Trained, Quadratures] | None = None
    scales: Sequence[tuple[float, float]] = plan.scales
    former = gain = 0.0
    for width in plan.widths:
        if gain * gain < plan.tolerance * former:
            break
        found, refinement = None, 1.0
        while found is None and refinement < MOST_REFINED:
            points = Quadratures.for_width(problem, width, refinement)
            found = _best_start(problem, plan, points, width, scales)
            refinement *= REFINE
        if found is None:
            continue
        state, chosen = found
        if best is not None:
            former, gain = gain, state.check.relative_gain(best[0].check)
            if gain < plan.tolerance:
                break
        best = state, points
        scales = chosen if problem.singular else scales[scales.index(chosen[0]) :]
    if best is None:
        raise SolveFailure("no starting network agrees with itself on two quadratures")
    return best


def _best_start(
    problem: TrainingProblem, plan: Plan, points: Quadratures, width: int, scales: Sequence[tuple[float, float]]
) -> tuple[Trained, Sequence[tuple[float, float]]] | None:
    found = None
    stretched = np.asarray(problem.features.inputs.stretched)
    # With random hidden layers and a solved output layer, a start costs one linear solve. Therefore all scales can be
    # tried.
    for start in [scales] if plan.mixed else [(pair,) for pair in scales]:
        each = np.array([np.where(stretched, of_stretched, plain) for plain, of_stretched in start])
        by_input = problem.features.placement.tensor(each[np.arange(width) % len(each)])
        values = points.train.inputs[VALUE]
        layers = (*plan.inner, width)
        if plan.fitted:
            network = deep_random_features(values, by_input, layers, plan.seed, plan.activation)
        else:
            network = deep_random_network(values.shape[1], layers, plan.seed, plan.activation).to(values)
        state = points.evaluate(problem, network)
        trusted = state.gap < 10 * plan.gap
        if trusted and (found is None or state.check.gain > found[0].check.gain):
            found = state, start
    return found


def refine_points(problem: TrainingProblem, state: Trained, points: Quadratures) -> tuple[Trained, Quadratures]:
    """Take more points, and solve for the output layer again."""
    more = Quadratures.for_width(problem, state.network.width, points.refinement * REFINE)
    return more.evaluate(problem, state.network), more


def close_gap(problem: TrainingProblem, plan: Plan, state: Trained, points: Quadratures) -> tuple[Trained, Quadratures]:
    """Refine the points until the gap leaves room to grow."""
    while state.gap > plan.gap / 4 and points.refinement * REFINE < MOST_REFINED:
        state, points = refine_points(problem, state, points)
    return state, points


def train(
    problem: TrainingProblem, plan: Plan, state: Trained, points: Quadratures, report: Report
) -> tuple[Trained, str]:
    """Train all weights; return the last certified state and why training ended.

    `report` is called with each certified state, which stays valid if training fails later.
    """
    # Variable projection with Levenberg & Marquardt's damping, an iteration in five:
    # 1. Choose weights: the steepest ones of many, all of few.
    # 2. Take a sparse rule, one of three in turn, for the Gauss-Newton matrix.
    # 3. Compute the gradient on the training points, and the matrix on the sparse ones, with the output layer
    #    eliminated.
    # 4. Increase the damping until a step is certified: the energy falls on training and check points, with a new
    #    output layer.
    # 5. Without such a step: if only the training points show a gain, they are exploited, so take more. Else stop. Also
    #    stop if the most damped step predicts hardly any gain.
    # Textbooks accept a step that lowers the objective on its own points. A field can lower it without limit, by
    # displacements that cost energy only between the points. Independent points detect this.
    damping = plan.damping
    for iteration in range(1, plan.iterations + 1):
        weights = state.network.parameters
        slope = energy_gradient(points.train, points.tips, state.network, state.output)
        sketch = Sketch.from_steepest(state.network, slope, STEEPEST) if weights > MANY_WEIGHTS else None
        # Six strain rows a point, and twice as many rows as columns: the Gram matrix then has full rank.
        rows = COARSE_ROWS * (state.output.numel() + (sketch.count if sketch else weights))
        coarse = problem.sample(problem.rule_spec(rows / 6, COARSE_ORDER, more=iteration % 3))
        local = quadratic_model(points.train, points.tips, coarse, state.network, state.output, sketch, slope)
        found = _search(problem, plan, state, points, local, damping, sketch)
        damping, spent = found.damping, state.evaluations + 2 * (len(points.train) + len(coarse)) + found.evaluations
        if found.state is None:
            if not (found.exploited and points.refinement * REFINE < MOST_REFINED):
                return replace(state, evaluations=spent), "no further step is certified"
            state, points = refine_points(problem, state, points)
            state = replace(state, evaluations=spent + state.evaluations)
            if found.promised < NEGLIGIBLE * plan.tolerance * abs(state.check.potential):
                return state, "a further step is bound to gain next to nothing"
            continue
        gain, state = found.state.check.relative_gain(state.check), replace(found.state, evaluations=spent)
        report(iteration, state)
        if gain < plan.tolerance:
            return state, "the certified gain fell below the tolerance"
    return state, "all iterations were made"


class SearchResult(NamedTuple):
    """Result of a search with ever more damped steps.

    Attributes
    ----------
    state
        The first one that is certified, if any is.
    exploited
        Whether a gain exists on the training points alone.
    damping
        For the next iteration.
    evaluations
        Of the network.
    promised
        Decrease of the energy, J, that the model predicts for the last of these steps.
    """

    state: Trained | None
    exploited: bool
    damping: float
    evaluations: int
    promised: float


def _search(
    problem: TrainingProblem,
    plan: Plan,
    state: Trained,
    points: Quadratures,
    local: Quadratic,
    damping: float,
    sketch: Sketch | None,
) -> SearchResult:
    theta, exploited, spent, promised = flatten(state.network), False, 0, math.inf
    for attempt in range(ATTEMPTS):
        # A rejected step costs an evaluation, but no new model: the damping of the same matrix increases.
        step = local.step(damping)
        if step is not None:
            promised = local.decrease(step)
            change = sketch.extend(step) if sketch else step
            new = _try_network(problem, points, unflatten(theta + change, state.network))
            spent += len(points.train)
            if new is not None and new.train.gain > state.train.gain:
                new = points.check_state(new)
                spent += len(points.check)
                if gains_agree(new, state) and new.gap <= max(plan.gap, state.gap):
                    # Gain over prediction, as in a trust region: the energy falls by half of the rise of `gain`.
                    # Damping decreases only if the first attempt was accepted.
                    ratio = 0.5 * (new.train.gain - state.train.gain) / promised
                    ease = 1.0 if attempt or ratio <= FAIR else EASE_MORE if ratio > GOOD else EASE
                    return SearchResult(new, False, damping / ease, spent, promised)
                exploited = True
        damping *= HARDEN
    return SearchResult(None, exploited, damping / HARDEN, spent, promised)


def _try_network(problem: TrainingProblem, points: Quadratures, network: Network) -> Trained | None:
    """Return the state of a network with its output layer solved for; None if there is no solution."""
    try:
        return points.solve_output(problem, network)
    except SolveFailure:  # the step was too long: a shorter one is tried
        return None


def gains_agree(new: Trained, old: Trained) -> bool:
    """Return True if both point sets show a gain, of about the same size."""
    seen, certified = new.train.gain - old.train.gain, new.check.gain - old.check.gain
    # Each condition alone can be satisfied by chance or exploitation.
    return seen > 0 and certified > 0 and abs(seen - certified) <= AGREEMENT * min(seen, certified)


def default_plan_widths(
    case: Case, singular: bool, parts: int = 1
) -> tuple[tuple[int, ...], tuple[tuple[float, float], ...]]:
    """Return the default widths and scales of a case, chosen by certified energy on plates, roofs and cylinders.

    `parts` is the number of parts into which built-in planes of symmetry cut the shell.
    """
    if singular and is_flat(case):
        return (100, 200), SINGULAR_SCALES
    if singular:
        return (round(WIDEST_SINGULAR / math.sqrt(parts)),), MIXED_SCALES if parts == 1 else MIRRORED_SCALES
    return (40, 80, 160, 320), tuple((float(scale), 0.0) for scale in range(2, 6))
